"""`Solution` with its error and a frame: what `phasebench.integrate` returns."""

from __future__ import annotations

from dataclasses import fields
from math import nan
from typing import NamedTuple

import numpy as np

from phasebench.benchmarks.problems.base import Orbit, Problem
from phasebench.integrators import solution
from phasebench.integrators.errors import InvalidInput


class GlobalError(NamedTuple):
    """The error of a solution at its end, and how well it is known.

    Attributes
    ----------
    error : max norm over (q, p) against the reference; NaN where there is none
    uncertainty : of the reference, in the same unit: an error below it tells nothing
    horizon : the time up to which the reference follows the orbit; of a chaotic orbit it may lie before the end
    source : "certified" (a stored state) or "long double" (computed now)
    reason : why there is no error, or nothing
    """

    error: float
    uncertainty: float
    horizon: float
    source: str
    reason: str = ""


class Solution(solution.Solution):
    """A trajectory and how it was made; its attributes are those of `integrators.solution.Solution`."""

    @classmethod
    def of(cls, found: solution.Solution) -> Solution:
        """The same solution, which can tell its error."""
        return cls(**{f.name: getattr(found, f.name) for f in fields(found)})

    def error(self) -> GlobalError:
        """The error at the end, against a certified state or a run of heyoka in long double from the same start.

        Raises InvalidInput where the solution did not come to its end, or does not know its problem.
        """
        from . import global_error

        if self.status not in ("ok", "inaccurate", "unstable"):
            raise InvalidInput(f"the run ended as {self.status} at t = {self.t[-1]:.6g}: it has no error at its end")
        found = global_error.end_error(self._started(), self, float(self.t[-1] - self.t[0]))
        reference = found["reference"]
        return GlobalError(
            *(nan if x is None else x for x in (found["global_error"], reference["uncertainty"], reference["horizon"])),
            reference.get("source", ""),
            reference.get("reason", ""),
        )

    def to_frame(self):
        """A pandas DataFrame: t, the coordinates and momenta by name, and the energy where there is one."""
        import pandas as pd

        columns = {"t": self.t}
        for symbols, rows in ((self.system.q, self.q), (self.system.p, self.p)):
            columns |= {str(symbol): rows[:, k] for k, symbol in enumerate(symbols)}
        if self.system.has_energy and "energy" not in columns:
            columns["energy"] = self.energy()
        return pd.DataFrame(columns)

    def _started(self):
        """The problem, from the first row."""
        from .global_error import started

        q, p = self.q[0], self.p[0]
        if not isinstance(self.problem, Problem):
            orbit = Orbit("given", tuple(map(float, q)), tuple(map(float, p)))
            return Problem("given", "a system of one's own", "", self.system, (orbit,))
        own = np.array_equal(q, self.problem.q0) and np.array_equal(p, self.problem.p0)
        return self.problem if own else started(self.problem, q, p)
