"""An orbit integrated in high precision and in long double on the same grid of times (`Along`).

The distance of two states is the max norm over (q, p) of their difference; arrays of distances hold running maxima.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from phasebench.integrators.errors import InvalidInput
from phasebench.reference.solvers import taylor

#: Number of grid points for distances.
GRID = 400


class Precision(NamedTuple):
    """The precision of a Taylor series run: mantissa bits, and the tolerance as decimal text, which sets the order."""

    bits: int
    tolerance: str


class Along(NamedTuple):
    """An orbit in high precision, and the same orbit in long double.

    Attributes
    ----------
    precision : bits and tolerance of the run in high precision
    grid : increasing times, including the requested ones
    rows : the high-precision states at these times, n rows of 2 d numbers
    near : the states in long double, array (n, 2 d)
    size : the max norms of the states, array (n,)
    """

    precision: Precision
    grid: list[float]
    rows: Sequence
    near: np.ndarray
    size: np.ndarray

    def row(self, t: float) -> np.ndarray:
        """The high-precision state at the time t, which is in the grid."""
        return self.rows[self.grid.index(t)]

    def distances(self, rows: Sequence | np.ndarray) -> np.ndarray:
        """The distances of other states ``rows`` on the grid from this orbit's, as a running maximum: array (n,)."""
        number = taylor.Bits(self.precision.bits)
        return upto([norm(x, y, number) for x, y in zip(rows, self.rows, strict=True)])


def along(problem: Any, times: Sequence[float], precision: Precision, points: int = GRID) -> Along:
    """Integrate a problem's orbit in high precision and in long double, on one grid of times (`Along`).

    The grid is ``points`` equidistant times up to the last of ``times``, and ``times`` themselves; ``precision`` is
    that of the run in high precision.

    Raises
    ------
    InvalidInput
        If the times are not positive, finite and increasing.
    ReferenceFailed
        If a run does not reach the end.
    """
    times = [float(t) for t in times]
    if not times or not np.isfinite(times).all() or times[0] <= 0 or (np.diff(times) <= 0).any():
        raise InvalidInput(f"the times are {times}; they must be positive, finite and increase")
    long, _ = taylor.extended_types()
    grid = sorted({*times, *(times[-1] * (i + 1) / points for i in range(points - 1))})
    system, q0, p0 = problem.system, problem.q0, problem.p0
    rows = taylor.states(system, taylor.Bits(precision.bits), q0, p0, grid, precision.tolerance)
    near = taylor.states(system, long, q0, p0, grid)
    size = np.array([max(abs(float(x)) for x in row) for row in near])
    return Along(precision, grid, rows, near, size)


def norm(x: Iterable[Any], y: Iterable[Any], number: Callable[[Any], Any]) -> float:
    """The max norm of x - y for states of any precision; ``number`` converts to the type in which it is computed."""
    return max(abs(float(number(a) - b)) for a, b in zip(x, y, strict=True))


def upto(values: Sequence[float] | np.ndarray) -> np.ndarray:
    """The running maximum of values, array (n,)."""
    return np.maximum.accumulate(values)
