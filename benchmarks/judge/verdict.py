"""The outcomes of a claim, and `Judgement`: an outcome with its number, interval, systems and reason."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

HOLDS, CONTRADICTED, UNJUDGED = "holds", "contradicted", "not judged"
#: The property exceeds the claim; it holds on some systems only; it holds under a condition.
UNDERSTATED, IN_PART, WHERE = "understated", "holds in part", "holds where"
#: No number could decide it; the rows that could are missing.
UNTESTABLE, MISSING = "not testable", "not measured"
#: Outcomes, the worst first.
_ORDER = (MISSING, CONTRADICTED, UNJUDGED, UNTESTABLE, UNDERSTATED, IN_PART, WHERE, HOLDS)
#: Outcomes of an integrator, over all its claims.
PASS, FAIL, OPEN = "pass", "fail", "not-judged"


@dataclass(frozen=True)
class Judgement:
    """The outcome of one claim: the measured number (or words), its interval, the systems that decide, the reason."""

    verdict: str
    measured: Any = None
    interval: tuple[float, float] | None = None
    on: tuple[str, ...] = ()
    why: str = ""
    name: str = ""
    claim: str = ""

    def row(self) -> dict[str, Any]:
        """The judgement as a JSON object; verdicts have hyphens instead of spaces."""
        return {
            "claim": self.claim,
            "verdict": self.verdict.replace(" ", "-"),
            "measured": self.measured,
            "interval": list(self.interval) if self.interval else None,
            "on": list(self.on),
            "why": self.why,
        }


def systems(rows: Iterable[dict]) -> tuple[str, ...]:
    """The names of the systems on which the rows were measured, one for each row."""
    return tuple(r["on"] for r in rows)


def worst(verdicts: Iterable[str]) -> str:
    """The worst of several verdicts: not measured is the worst, then contradicted, not judged, ...; holds the best."""
    return min(verdicts, key=_ORDER.index)
