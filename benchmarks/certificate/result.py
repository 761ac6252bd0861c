"""`Certificate`: what was measured of an integrator, and the verdicts on its claims."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from phasebench.benchmarks.judge.evidence import Tables
from phasebench.benchmarks.judge.verdict import Judgement
from phasebench.benchmarks.measure.tabular import TabularResult
from phasebench.benchmarks.store.provenance import versions
from phasebench.integrators.errors import InvalidInput, unknown_name

from .stepping import DIGITS

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

#: Packages whose versions a certificate states.
PACKAGES = ("phasebench", "python", "numpy", "numba", "sympy", "mpmath")
#: Columns that only figures use.
CURVES = ("curve", "sizes", "radius")


@dataclass(frozen=True, repr=False)
class Certificate(TabularResult):
    """What was measured of an integrator, and the verdicts on its claims.

    Attributes
    ----------
    integrator : its name, or the path of its file
    claims, verdict : the judgements, first on what is required of all; "pass", "fail" or "not-judged"
    offers : claims that would hold but are not made
    tables : the rows of every measure
    doubles : why it was measured in doubles only; "" if it was measured in many digits
    requires, seed : traits that a system must have, and the seed of the random states
    seconds, times : the duration, and rows of its times relative to the fastest stored integrator
    """

    integrator: str
    claims: list[Judgement]
    offers: list[str]
    verdict: str
    tables: Tables
    doubles: str
    requires: tuple[str, ...]
    seed: int
    seconds: float
    times: list[dict] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """The certificate as a dict for JSON; only ``seconds`` and ``times`` differ if it is certified again."""
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

    def to_frame(self) -> pd.DataFrame:
        """A row for each claim; ``attrs`` have the integrator, the verdict on the whole, and the offers."""
        import pandas as pd

        frame = pd.DataFrame([j.row() for j in self.claims])
        frame.attrs |= {"integrator": self.integrator, "verdict": self.verdict, "offers": self.offers}
        return frame

    def plot(self, what: Literal["order", "energy", "stability", "place"] = "order") -> Figure:
        """A figure of the order, the energy in long runs, linear stability, or ("place") error against evaluations."""
        from .figures import DRAWINGS

        if what not in DRAWINGS:
            raise unknown_name("figure of a certificate", str(what), DRAWINGS)
        drawing = DRAWINGS[what](self.tables)
        if drawing is None:
            raise InvalidInput(f"nothing was measured of '{self.integrator}' for the figure '{what}'")
        return drawing.figure

    def _heading(self) -> list[str]:
        offers = [f"measured and not claimed: {', '.join(self.offers)}"] if self.offers else []
        return [f"{self.integrator}: {self.verdict}", *offers]

    def _printed(self) -> pd.DataFrame:
        return self.to_frame()[["claim", "verdict", "measured", "why"]].fillna("")

    def summary(self) -> str:
        """Lines of text: the verdict, each claim, what could be claimed."""
        lines = [f"{self.integrator}: {self.verdict}"]
        for j in self.claims:
            measured = f" (measured {j.measured:.3g})" if isinstance(j.measured, float) else ""
            lines.append(f"  {j.claim}: {j.verdict}{measured}{f'; {j.why}' if j.why else ''}")
        if self.offers:
            lines.append(f"  measured and not claimed: {self.claim_options()}")
        return "\n".join(lines)

    def claim_options(self) -> str:
        """The claims that would hold but are not made, as options of the command."""
        return " ".join(f"--claim {offer}" for offer in self.offers)


def _without_curves(row: dict) -> dict:
    return {key: value for key, value in row.items() if key not in CURVES}
