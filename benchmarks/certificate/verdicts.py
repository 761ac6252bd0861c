"""A verdict on a claim, and the tables that verdicts are from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

HOLDS, CONTRADICTED, UNJUDGED = "holds", "contradicted", "not-judged"
PASS, FAIL = "pass", "fail"
#: What an integrator may keep.
CONSERVED = ("energy", "bilinear", "quadratic")


@dataclass(frozen=True)
class Judged:
    """A claim with its verdict.

    Attributes
    ----------
    name, claim : of what, and in words
    verdict : `HOLDS`, `CONTRADICTED` or `UNJUDGED`
    measured, interval : what was measured, a number or words, and its interval
    on : the systems that decide
    why : what the verdict is from
    """

    name: str
    claim: str
    verdict: str
    measured: Any = None
    interval: tuple[float, float] | None = None
    on: tuple[str, ...] = ()
    why: str = ""

    def row(self) -> dict[str, Any]:
        """As JSON has it."""
        interval = list(self.interval) if self.interval else None
        return {
            "claim": self.claim,
            "verdict": self.verdict,
            "measured": self.measured,
            "interval": interval,
            "on": list(self.on),
            "why": self.why,
        }


@dataclass
class Tables:
    """What was measured, a list of rows for each measure, why a measure was not made, and which were to their end."""

    rows: dict[str, list[dict]] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    done: set[str] = field(default_factory=set)

    def of(self, name: str) -> list[dict]:
        """The rows of a measure."""
        return self.rows.get(name, [])


def in_words(name: str, value) -> str:
    """A claim in words."""
    if name in ("order", "stability", "tolerance"):
        return f"{name} {value:g}" if isinstance(value, (int, float)) else f"{name} {value}"
    if name in CONSERVED:
        what = "energy" if name == "energy" else f"{name} invariants"
        return f"{what}: {value}"
    return name if value else f"not {name}"
