r"""`Quantity`: a number or array computed from a solution, with its error against a reference.

- ``end-state``: (q, p) at the end, in the max norm;
- ``trajectory``: the same, the largest error at `PARTS` equidistant times;
- ``energy``: :math:`\max_t |H - H_0|` over the rows, divided by the sum of the absolute terms of H at the start;
- further quantities of particular problems (`named_quantities`): an angle, an adiabatic invariant, an average.

A conserved quantity (the energy) is compared with its own first value and needs no reference.  Others are compared with
a reference value (`truths.truth`); an error below the uncertainty of that value is not meaningful.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, pi
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import sympy as sp

from phasebench.integrators.driver import OK

if TYPE_CHECKING:
    from types import SimpleNamespace

    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.solution import Solution

#: Number of times for the error of a trajectory, and number of rows for a maximum or an average.
PARTS, ROWS = 20, 997  # a prime, so that no period is looked at in few phases
#: Relative round-off of a time computed as a product n h.
ROUND_OFF = 16 * float(np.finfo(float).eps)
#: Type of (problem, t (n,), q (n, d), p (n, d)) -> the values to compare, array (m,).
Values = Callable[[Any, np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Quantity:
    """A quantity computed from a solution, such as the end state or an angle, and how its error is measured.

    Attributes
    ----------
    name, about, unit : kebab-case name; description in a line; unit of its error
    values : function (problem, t (n,), q (n, d), p (n, d)) -> the values to compare, array (m,)
    rows, aligned : number of rows that it needs besides the first (1: the end only), and if they are equidistant
    angle : True if values are compared modulo 2 pi
    kept : True for a conserved quantity, compared with its own first value; its values are its error
    statistical : True if it differs between nearby orbits, such as an average or an exponent of a chaotic orbit
    """

    name: str
    about: str
    unit: str
    values: Values
    rows: int = 1
    aligned: bool = True
    angle: bool = False
    kept: bool = False
    statistical: bool = False

    def steps(self, wanted: float) -> int:
        """Return the permitted number of steps nearest to ``wanted``: a multiple of `rows` if it is `aligned`."""
        unit = self.rows if self.aligned else 1
        return max(1, round(wanted / unit)) * unit

    def save_every(self, steps: int) -> int:
        """Return the ``save_every`` for a run of ``steps`` steps; 0 saves the end alone."""
        return 0 if self.rows == 1 else max(1, steps // self.rows)

    def grid(self, steps: int | None = None, tol: float | None = None) -> dict[str, Any]:
        """Return arguments for `Integrator.run` with a number of steps or a tolerance, so that it saves the rows."""
        if steps is not None:
            return {"steps": steps, "save_every": self.save_every(steps)}
        return {"tol": tol, "save_every": 0} if self.rows == 1 else {"tol": tol, "steps": self.rows, "save_every": 1}


class Truth(NamedTuple):
    """The true value of a quantity, with its uncertainty.

    Attributes
    ----------
    values, uncertainty : array (m,), and its uncertainty in the unit of the quantity's errors
    source : origin of the values, in words: such as "certified" (a stored state) or "long double" (runs made for it)
    rounding : change of the values if the orbit is rounded to long double, in the same unit; 0 if not computed
    """

    values: np.ndarray
    uncertainty: float
    source: str
    rounding: float = 0.0


def _end_state(problem: Problem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    return np.concatenate([x[-1] for x in _states(problem, q, p)])


def _trajectory(problem: Problem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    return np.concatenate([x[1:] for x in _states(problem, q, p)], axis=1).ravel()


def _states(problem: Problem, q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The states without the time and its momentum, which are the last components if H depends on time."""
    return (q[:, :-1], p[:, :-1]) if problem.system.driven else (q, p)


def scale(problem: Problem) -> float:
    """Return the sum of the absolute values of the terms of a problem's H at the start, the unit of energy errors."""
    system = problem.system
    start = np.array([problem.q0]), np.array([problem.p0])
    return float(sum(abs(system.observe(term, *start)[0]) for term in sp.Add.make_args(system.H)))


def _energy(problem: Problem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    H = problem.system.observe(problem.system.H, q, p)
    return np.array([np.abs(H - H[0]).max() / scale(problem)])


END_STATE = Quantity("end-state", "the state at the end, max norm over (q, p)", "as (q, p)", _end_state)
TRAJECTORY = Quantity(
    "trajectory", f"the state at {PARTS} equidistant times, the worst in max norm", "as (q, p)", _trajectory, rows=PARTS
)
ENERGY = Quantity(
    "energy",
    "max |H - H0| over the rows, relative to the sum of the sizes of H's terms at the start",
    "relative",
    _energy,
    rows=ROWS,
    aligned=False,
    kept=True,
)
#: Quantities of every problem.
GENERAL = (END_STATE, TRAJECTORY, ENERGY)


def rows_of(quantity: Quantity, solution: Solution | SimpleNamespace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (t since the start, q, p) of a solution's first row and of the rows a quantity needs.

    These are all rows if the quantity needs no equidistant ones.  Raises ValueError if equidistant rows are missing.
    """
    t, q, p = solution.t - solution.t[0], solution.q, solution.p
    if not quantity.aligned:
        return t, q, p
    wanted = t[-1] / quantity.rows * np.arange(quantity.rows + 1)
    at = np.clip(np.searchsorted(np.abs(t), np.abs(wanted) - ROUND_OFF * np.abs(t[-1])), 0, len(t) - 1)
    if np.abs(t[at] - wanted).max() > ROUND_OFF * np.abs(t[-1]):
        raise ValueError(f"{quantity.name} needs {quantity.rows} equidistant rows")
    return t[at], q[at], p[at]


def values(problem: Problem, quantity: Quantity, solution: Solution | SimpleNamespace) -> np.ndarray:
    """Compute the values of a quantity, array (m,), from a solution with rows ``t``, ``q``, ``p``."""
    with np.errstate(all="ignore"):
        return np.asarray(quantity.values(problem, *rows_of(quantity, solution)), float)


def distance(quantity: Quantity, one: np.ndarray, other: np.ndarray) -> float:
    """Return the max norm of the difference of two arrays of values, modulo 2 pi for angles; infinite if not finite."""
    apart = one - other
    if quantity.angle:
        apart = (apart + pi) % (2 * pi) - pi
    worst = float(np.abs(apart).max())
    return worst if np.isfinite(worst) else inf


def error(
    problem: Problem, quantity: Quantity, solution: Solution | SimpleNamespace, reference: Truth | None = None
) -> float:
    """Return the error of a quantity computed from a solution; infinite if the run did not reach its end.

    The solution is of a run with `Quantity.grid`; a conserved quantity needs no reference.
    """
    if getattr(solution, "status", OK) != OK:
        return inf
    found = values(problem, quantity, solution)
    if quantity.kept:
        worst = float(np.abs(found).max())
        return worst if np.isfinite(worst) else inf
    return distance(quantity, found, reference.values)
