"""`Solution`: a trajectory, its status, and quantities computed from its rows."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InvalidInput

#: Components of the end state that a `Solution` prints.
SHOWN = 4
Floats = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Solution:
    """The trajectory of an integration, its status, and how it was computed.

    Attributes
    ----------
    t : array (n,), the times of the rows: the start time plus whole numbers of steps times h
    q, p : arrays (n, d), the states; row 0 is the initial one
    status, reason : "ok", or what went wrong and what to do.  Rows end before the failure; in a run that is "unstable"
        or "inaccurate" they go on to the end, but are not the orbit
    counts : steps, evaluations of the gradient and of higher derivatives, stage iterations, Newton solves, fallbacks
        (steps without the property that the method promises)
    h, method : the step that was taken and the method
    parameter : array (n - 1,), for methods that choose a parameter in each step to keep the energy: that of the last
        step before each row after the first; NaN if none was found, and for all other methods
    seconds : time of the kernel (the compiled loop over steps) alone, without compilation
    problem : what was integrated, a problem or a system
    """

    t: Floats
    q: Floats
    p: Floats
    status: str
    reason: str
    counts: dict[str, int]
    h: float
    method: Any
    parameter: Floats | None = None
    seconds: float = 0.0
    problem: Any = field(default=None, compare=False)

    @property
    def system(self) -> Any:
        """The system that was integrated; raises InvalidInput if the solution does not hold it."""
        if self.problem is None:
            raise InvalidInput("this solution does not know its problem: pass problem= when you make it")
        return getattr(self.problem, "system", self.problem)

    def energy(self) -> Floats:
        """H of each row, array (n,); raises InvalidInput if the system has no energy."""
        if not self.system.has_energy:
            raise InvalidInput("the system has no energy")
        return self.system.energies(self.q, self.p)

    def invariants(self) -> dict[str, Floats]:
        """The problem's invariants besides the energy: by name, arrays (n,) of their values."""
        if hasattr(self.problem, "invariants") and hasattr(self.problem, "invariant"):
            return {name: self.problem.invariant(name, self.q, self.p) for name in self.problem.invariants}
        kept = {str(e): e for e in self.system.invariants} | self.system.bound
        return {name: self.system.observe(e, self.q, self.p) for name, e in kept.items()}

    def __repr__(self) -> str:
        """A few lines of text: the method, how the run ended, the time span and the last state."""
        rows, d = self.q.shape
        problem = getattr(self.problem, "label", "")
        lines = [f"{type(self).__name__}: {self.method.label}{f' on {problem}' if problem else ''}, {self.status}"]
        if self.reason:
            lines.append(f"  {self.reason}")
        span = f"t = {float(self.t[0]):.6g} to {float(self.t[-1]):.6g}"
        lines.append(f"  {span}, {self.counts.get('steps', 0)} steps, h = {float(self.h):.6g}, {rows} rows of d = {d}")
        lines.append(f"  q = {_shorten(self.q[-1])}, p = {_shorten(self.p[-1])} at the end")
        return "\n".join(lines)


def _shorten(state: Floats) -> str:
    """The first components of a state, as text."""
    more = ", ..." if len(state) > SHOWN else ""
    return f"[{', '.join(f'{float(x):.6g}' for x in state[:SHOWN])}{more}]"
