"""What was measured of an integrator and what that says of its claims, as one object."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from phasebench.benchmarks.rows.provenance import versions

from .stepping import DIGITS
from .verdicts import Judged, Tables

if TYPE_CHECKING:
    import pandas as pd

#: What is told of the versions.
PACKAGES = ("phasebench", "python", "numpy", "numba", "sympy", "mpmath")
#: Rows have these for figures alone.
CURVES = ("curve", "sizes", "radius")


@dataclass(frozen=True)
class Certificate:
    """What was measured of an integrator, and what that says of its claims.

    Attributes
    ----------
    integrator : its name, or the path of its file
    claims : the verdicts, first on what every integrator is held to
    offers : claims that would hold and are not made
    verdict : "pass", "fail" or "not-judged"
    tables : the rows of every measure
    doubles : why it was measured in doubles alone; "" where it was in many digits
    requires : traits that it requires of a system
    seed : of the states
    seconds : that it took
    times : of each scene on which it has a place, what it takes beside the fastest stored
    """

    integrator: str
    claims: list[Judged]
    offers: list[str]
    verdict: str
    tables: Tables
    doubles: str
    requires: tuple[str, ...]
    seed: int
    seconds: float
    times: list[dict] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """As JSON has it; ``seconds`` and ``times`` alone differ when it is made again."""
        rows = {name: [_without_curves(r) for r in part] for name, part in self.tables.rows.items()}
        return {
            "integrator": self.integrator,
            "claims": [j.row() for j in self.claims],
            "measured": rows,
            "verdict": self.verdict,
            "offers": self.offers,
            "failed": dict(self.tables.failed),
            "arithmetic": f"doubles: {self.doubles}" if self.doubles else f"{DIGITS} digits, long runs in doubles",
            "requires": list(self.requires),
            "seed": self.seed,
            "versions": {name: versions().get(name, "absent") for name in PACKAGES},
            "seconds": self.seconds,
            "times": self.times,
        }

    def frame(self) -> pd.DataFrame:
        """A row a claim: claim, verdict, measured, interval, on, why; ``attrs`` has the verdict and the offers."""
        import pandas as pd

        frame = pd.DataFrame([j.row() for j in self.claims])
        frame.attrs |= {"integrator": self.integrator, "verdict": self.verdict, "offers": self.offers}
        return frame

    def summary(self) -> str:
        """Lines of text: the verdict, each claim, what could be claimed."""
        lines = [f"{self.integrator}: {self.verdict}"]
        for j in self.claims:
            measured = f" ({j.measured:.3g})" if isinstance(j.measured, float) else ""
            lines.append(f"  {j.claim}: {j.verdict}{measured}{f'; {j.why}' if j.why else ''}")
        if self.offers:
            lines.append(f"  measured and not claimed: {self.offered()}")
        return "\n".join(lines)

    def offered(self) -> str:
        """What could be claimed, as options of the command."""
        return " ".join(f"--claim {offer}" for offer in self.offers)


def _without_curves(row: dict) -> dict:
    return {key: value for key, value in row.items() if key not in CURVES}
