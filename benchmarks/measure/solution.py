"""`Solution`, the result of `phasebench.integrate`: a trajectory with its error and as a data frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from math import nan
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasebench.benchmarks.problems.base import Problem
from phasebench.integrators import solution
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.statuses import UNSTABLE

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from phasebench.integrators.solution import Floats

    from .ensembles import Section

#: Rows that a notebook shows.
HEAD = 6
#: The name of what is conserved if H depends on time, with p_t' = -dH/dt.
DRIVEN = "H + p_t"


class GlobalError(NamedTuple):
    """The error of a solution at its end, and the accuracy of the reference that it is measured against.

    Attributes
    ----------
    error : max norm over (q, p) of the difference from the reference; NaN if no error can be given
    uncertainty : of the reference, in the same unit: a smaller error is not meaningful
    horizon : the time up to which the reference follows the orbit; for a chaotic orbit it may lie before the end
    source : "certified" (a stored state), or "long double" or "long double, Gauss" (computed now)
    reason : why there is no error, or ""
    """

    error: float
    uncertainty: float
    horizon: float
    source: str
    reason: str = ""


def stability_hint(status: str, method: str) -> str:
    """Return a hint on stable steps for a run with status "unstable"; "" for other runs."""
    where = f"`phasebench stability {method}` prints the steps that are stable on an oscillator"
    return where if status == UNSTABLE else ""


@dataclass(frozen=True, repr=False)
class Solution(solution.Solution):
    """The result of an integration: a trajectory (t, q, p) with its method, status and counts.

    Attributes are those of `integrators.solution.Solution`, and

    events : name -> `Section`, where the function of the state with that name vanishes
    whole : the same solution with the time as the last coordinate, and its momentum, if H depends on time; else None
    """

    events: Mapping[str, Section] = field(default_factory=dict, compare=False)
    whole: solution.Solution | None = field(default=None, compare=False)

    @classmethod
    def of(cls, found: solution.Solution, **more: Any) -> Solution:
        """Make a solution with the methods of this class from one of the base class."""
        given = {f.name: getattr(found, f.name) for f in fields(solution.Solution)}
        hint = stability_hint(found.status, found.method.id)
        if getattr(found.problem, "system", found.problem).driven:
            more |= {"q": found.q[:, :-1], "p": found.p[:, :-1], "whole": found}
        return cls(**given | {"reason": "; ".join(filter(None, (found.reason, hint)))} | more)

    def energy(self) -> Floats:
        """H of each row, array (n,), which varies if it depends on time; InvalidInput if the system has no energy."""
        return super().energy() if self.whole is None else self.whole.energy() - self.whole.p[:, -1]

    def invariants(self) -> dict[str, Floats]:
        """The problem's invariants besides the energy, name -> array (n,); H + p_t if H depends on time."""
        if self.whole is None:
            return super().invariants()
        return {DRIVEN: self.whole.energy()} | self.whole.invariants()

    def error(self) -> GlobalError:
        """Compute the error at the end, against a certified state or a run in long double from the same start.

        Raises InvalidInput if the solution did not reach its end, or does not hold its problem.
        """
        from . import global_error

        if self.status not in ("ok", "inaccurate", "unstable"):
            raise InvalidInput(f"the run ended as {self.status} at t = {self.t[-1]:.6g}: it has no error at its end")
        found = global_error.end_error(self._started(), self.whole or self, float(self.t[-1] - self.t[0]))
        reference = found["reference"]
        return GlobalError(
            *(nan if x is None else x for x in (found["global_error"], reference["uncertainty"], reference["horizon"])),
            reference.get("source", ""),
            reference.get("reason", ""),
        )

    def to_frame(self) -> pd.DataFrame:
        """Return a pandas DataFrame: t, the coordinates and momenta by name, and the energy if the system has one."""
        import pandas as pd

        columns = {"t": self.t}
        for symbols, rows in ((self.system.q, self.q), (self.system.p, self.p)):
            columns |= {str(symbol): x for symbol, x in zip(symbols, rows.T, strict=False)}
        if self.system.has_energy and "energy" not in columns:
            columns["energy"] = self.energy()
        return pd.DataFrame(columns)

    def plot(self) -> Figure:
        """Return a figure of the energy's change and of the orbit; it shows itself in a notebook."""
        from .figures import solution

        return solution(self)

    def _repr_html_(self) -> str:
        from html import escape

        return f"<pre>{escape(repr(self))}</pre>{self.to_frame().to_html(index=False, max_rows=HEAD)}"

    def _started(self) -> Any:
        """The problem with the solution's first row as its initial state."""
        from .global_error import with_start

        q, p = (self.whole or self).q[0], (self.whole or self).p[0]
        if not isinstance(self.problem, Problem):
            return with_start(self.system, q, p, tangent=False)
        own = np.array_equal(q, self.problem.q0) and np.array_equal(p, self.problem.p0)
        return self.problem if own else with_start(self.problem, q, p, tangent=False)
