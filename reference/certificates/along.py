"""An orbit followed in many bits, with what is measured beside it on the same grid of times.

All distances are max norms over (q, p), each the largest at any time of the grid so far.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phasebench.integrators.errors import InvalidInput
from phasebench.reference.solvers import taylor

#: Points of the grid on which distances are followed.
GRID = 400


class Precision(NamedTuple):
    """Bits of a Taylor run and its tolerance, which sets its order."""

    bits: int
    tolerance: str


class Along(NamedTuple):
    """An orbit in many bits, beside it in long double.

    Attributes
    ----------
    precision : of the run
    grid : times, increasing, with those that were asked for
    rows : the states at these, of many bits
    near : the same in long double
    size : their max norms
    """

    precision: Precision
    grid: list[float]
    rows: Sequence
    near: np.ndarray
    size: np.ndarray

    def row(self, t: float):
        """The state at a time of the grid."""
        return self.rows[self.grid.index(t)]

    def distances(self, rows) -> np.ndarray:
        """The largest distances so far of rows of any precision on the grid, array (n,)."""
        number = taylor.Bits(self.precision.bits)
        return upto([norm(x, y, number) for x, y in zip(rows, self.rows, strict=True)])


def along(problem, times: Sequence[float], precision: Precision, points: int = GRID) -> Along:
    """Follow a problem's orbit to the last of the ``times``, on a grid of so many points and these times.

    Raises
    ------
    InvalidInput
        For times that do not increase from above 0.
    ReferenceFailed
        Where a run does not reach the end.
    """
    times = [float(t) for t in times]
    if not times or not np.isfinite(times).all() or times[0] <= 0 or (np.diff(times) <= 0).any():
        raise InvalidInput(f"the times are {times}; they must be positive, finite and increase")
    long, _ = taylor.extended()
    grid = sorted({*times, *(times[-1] * (i + 1) / points for i in range(points - 1))})
    system, q0, p0 = problem.system, problem.q0, problem.p0
    rows = taylor.states(system, taylor.Bits(precision.bits), q0, p0, grid, precision.tolerance)
    near = taylor.states(system, long, q0, p0, grid)
    size = np.array([max(abs(float(x)) for x in row) for row in near])
    return Along(precision, grid, rows, near, size)


def norm(x, y, number) -> float:
    """The max norm of a state x of any precision minus y, taken in the precision ``number``."""
    return max(abs(float(number(a) - b)) for a, b in zip(x, y, strict=True))


def upto(values) -> np.ndarray:
    """The largest value so far, array (n,)."""
    return np.maximum.accumulate(values)
