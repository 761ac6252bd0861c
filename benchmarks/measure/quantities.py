r"""What is wanted of an integration: a quantity, told from the rows of a solution, and its error against what is true.

- ``end-state``: the max norm over (q, p) at the end;
- ``trajectory``: the same, the largest at `PARTS` equidistant times;
- ``energy``: :math:`\max_t |H - H_0|` over the rows, in units of the sum of the sizes of H's terms at the start;
- and what a problem's own users ask for, by name (`named_quantities`): an angle, an adiabatic invariant, an average.

A quantity that is kept (the energy) is compared with its own first value and needs no reference; any other with what is
true (`truths.truth`), which has an uncertainty of its own: an error below it tells nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, pi
from typing import Any, NamedTuple

import numpy as np
import sympy as sp

from phasebench.integrators.driver import OK
from phasebench.integrators.errors import unknown

#: Times at which the error of a trajectory is looked at, and rows from which a greatest error or an average is told.
PARTS, ROWS = 20, 997  # a prime, so that no period is looked at in few phases
#: Of a time that is a product n h.
ROUND_OFF = 16 * float(np.finfo(float).eps)
#: (problem, t (n,), q (n, d), p (n, d)) -> what is compared, array (m,).
Values = Callable[[Any, np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Quantity:
    """Something that is wanted of a solution.

    Attributes
    ----------
    name, about, unit : kebab-case name; what it is, in a line; the unit of its error
    values : (problem, t, q, p) of rows -> what is compared, array (m,); of one that is `kept`, its error
    rows : how many rows it is told from, besides the first; 1: the end alone
    aligned : whether these must be the ends of as many equal parts of the span, as those of the reference are
    angle : whether values are compared modulo 2 pi
    kept : whether it is compared with its own first value
    statistical : whether nearby orbits have other values: a chaotic orbit's average, a Lyapunov exponent
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
        """The nearest number of steps that gives its rows."""
        unit = self.rows if self.aligned else 1
        return max(1, round(wanted / unit)) * unit

    def save_every(self, steps: int) -> int:
        """How many steps its rows are apart in a run of so many: 0 where the end is enough."""
        return 0 if self.rows == 1 else max(1, steps // self.rows)

    def grid(self, steps: int | None = None, tol: float | None = None) -> dict[str, Any]:
        """Arguments of `Integrator.run` that give its rows: with a number of `steps`, or with a tolerance."""
        if steps is not None:
            return {"steps": steps, "save_every": self.save_every(steps)}
        return {"tol": tol, "save_every": 0} if self.rows == 1 else {"tol": tol, "steps": self.rows, "save_every": 1}


class Truth(NamedTuple):
    """What is true of a quantity.

    Attributes
    ----------
    values : array (m,)
    uncertainty : of these, in the unit of errors
    source : whence they are
    rounding : what rounding to long double grows to by then, in the same unit; 0 where that is not asked
    """

    values: np.ndarray
    uncertainty: float
    source: str
    rounding: float = 0.0


def _end_state(problem, t, q, p) -> np.ndarray:
    return np.concatenate([q[-1], p[-1]])


def _trajectory(problem, t, q, p) -> np.ndarray:
    return np.concatenate([q[1:], p[1:]], axis=1).ravel()


def scale(problem) -> float:
    """The sum of the sizes of H's terms at the start: energy errors are in units of it."""
    system = problem.system
    start = np.array([problem.q0]), np.array([problem.p0])
    return float(sum(abs(system.observe(term, *start)[0]) for term in sp.Add.make_args(system.H)))


def _energy(problem, t, q, p) -> np.ndarray:
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
#: Those of every problem.
GENERAL = (END_STATE, TRAJECTORY, ENERGY)


def quantities(problem) -> Mapping[str, Quantity]:
    """Those of a problem by name: the general ones, then its own."""
    from .named_quantities import named

    general = [x for x in GENERAL if x is not ENERGY or getattr(problem.system, "H", None) is not None]
    return {x.name: x for x in (*general, *named(problem))}


def quantity(problem, name: str) -> Quantity:
    """The quantity of that name; raises InvalidInput naming those there are."""
    known = quantities(problem)
    if name not in known:
        raise unknown(f"quantity of '{getattr(problem, 'label', problem)}'", name, known)
    return known[name]


def rows_of(quantity: Quantity, solution) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(t, q, p) of the first row and those that a quantity is told from; raises ValueError where they are missing."""
    t, q, p = solution.t, solution.q, solution.p
    if not quantity.aligned:
        return t, q, p
    wanted = t[-1] / quantity.rows * np.arange(quantity.rows + 1)
    at = np.clip(np.searchsorted(t, wanted - ROUND_OFF * t[-1]), 0, len(t) - 1)
    if np.abs(t[at] - wanted).max() > ROUND_OFF * t[-1]:
        raise ValueError(f"{quantity.name} needs {quantity.rows} equidistant rows")
    return t[at], q[at], p[at]


def values(problem, quantity: Quantity, solution) -> np.ndarray:
    """What is compared, of anything with rows ``t``, ``q``, ``p``."""
    with np.errstate(all="ignore"):
        return np.asarray(quantity.values(problem, *rows_of(quantity, solution)), float)


def distance(quantity: Quantity, one: np.ndarray, other: np.ndarray) -> float:
    """The largest difference of two arrays of values, modulo a turn where they are angles."""
    apart = one - other
    if quantity.angle:
        apart = (apart + pi) % (2 * pi) - pi
    worst = float(np.abs(apart).max())
    return worst if np.isfinite(worst) else inf


def error(problem, quantity: Quantity, solution, reference: Truth | None = None) -> float:
    """The error of a quantity in a solution; infinite where it did not come to the end.

    Parameters
    ----------
    solution : with status, t (n,), q and p (n, d): run with `Quantity.grid`
    reference : what is true; none of a quantity that is kept
    """
    if getattr(solution, "status", OK) != OK:
        return inf
    found = values(problem, quantity, solution)
    if quantity.kept:
        worst = float(np.abs(found).max())
        return worst if np.isfinite(worst) else inf
    return distance(quantity, found, reference.values)
