r"""How far an orbit can be followed: a property of the problem, the same on every machine.

A run in long double rounds its state at every step, by up to half a unit in the last place: the relative `UNIT`.  What
becomes of that depends on which way the digits happen to fall, and that is another's on another machine.  So the
rounding is drawn: of `DRAWS` runs each multiplies every component of its state, at the start and at the end of each
step, by

.. math:: 1 + u\,s, \qquad u \sim U(-1, 1), \qquad s \gg \text{the run's own round-off},

and its distance from the run that is not displaced, times `UNIT` / s, is what rounding to long double does: while that
is small it grows as the neighbours of the orbit part.  The draws are seeded, and s is large against the machine's
round-off; so the distances are the problem's, whatever the machine, the tolerance and s.

The horizon is the last time at which the median distance over the draws, each the largest so far, is within `LIMIT` of
the state's size.  A sum of many roundings along one growing direction is normally distributed, and its size is within
`CENTRAL` times the median in 95 of 100 draws: the interval runs from where the larger multiple of the median leaves the
limit to where the smaller one does, and holds where 95 in 100 runs in long double leave it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phasebench.reference.solvers import taylor, watch

#: A distance relative to the state's size: errors of trajectories are not told once rounding has grown to it.
LIMIT = 1e-13
#: What rounding to a long double of 64 bits changes at most, relative to a number.
UNIT = 2.0**-64
DRAWS, SEED = 32, 1
#: The 0.975 and the 0.025 quantile of the size of a normal variable in units of its median.
CENTRAL = 3.323, 0.04646
#: s: by what the runs are displaced; at the limit they are 1e-8 of the state apart.
DISPLACEMENT = 2.0**-47
#: Another run for the same horizon: the displacement and the tolerance, whose order and round-off are others.
OTHER = 2.0**-44, "1e-17"
#: Distances are the same on another machine within this share.
SHARE = 0.02
#: The relative displacement of one neighbour, the relative distance at which it is lost, and the exponent of growth.
SHIFT, LOST, FASTEST = 2.0**-47, 1e-3, 3.0


class Span(NamedTuple):
    """The horizon, and the interval in which 95 of 100 runs in long double leave the limit."""

    horizon: float
    earliest: float
    latest: float


class Rounding(NamedTuple):
    """What rounding to long double does along an orbit.

    Attributes
    ----------
    grid : times, increasing
    size : the state's max norm at these
    distances : array (draws, times), the largest up to each time
    """

    grid: Sequence[float]
    size: np.ndarray
    distances: np.ndarray

    def span(self, limit: float = LIMIT) -> Span:
        """The horizon with its interval."""
        median = np.median(self.distances, axis=0)
        return Span(*(within(self.grid, factor * median, self.size, limit) for factor in (1.0, *CENTRAL)))

    @property
    def band(self) -> tuple[Span, Span]:
        """The spans at a `SHARE` of the limit less and more, and a grid point further: what is the same anywhere."""
        less, more = (self.span(LIMIT * factor) for factor in (1 - SHARE, 1 + SHARE))
        return Span(*(self._beside(t, -1) for t in less)), Span(*(self._beside(t, 1) for t in more))

    def _beside(self, t: float, by: int) -> float:
        times = [0.0, *self.grid]
        return times[min(max(times.index(t) + by, 0), len(times) - 1)]


def rounding(problem, grid: Sequence[float], run: tuple = (DISPLACEMENT, None), seed: int = SEED, draws: int = DRAWS):
    """The `Rounding` of a problem's orbit on a grid; ``run`` is the displacement and the tolerance (None: epsilon's).

    Raises
    ------
    ReferenceFailed
        Where a run does not reach the end of the grid.
    """
    long, _ = taylor.extended()
    displacement, tol = run
    ta = taylor.integrator(problem.system, long, tol)
    steps = taylor.step_ends(problem.system, long, problem.q0, problem.p0, grid[-1])
    marks = _marks(grid, steps)
    base = _displaced(ta, problem, marks, np.random.default_rng(seed), 0.0)
    rows = []
    for k in range(draws):
        other = _displaced(ta, problem, marks, np.random.default_rng([seed, k]), displacement)
        apart = np.abs(other - base).max(axis=1).astype(float)
        rows.append(np.maximum.accumulate(apart) * (UNIT / displacement))
    return Rounding(list(grid), np.abs(base).max(axis=1).astype(float), np.array(rows))


def span(problem, t_end: float, points: int = 100) -> Span:
    """The horizon of a problem's orbit up to ``t_end`` with its interval, on a grid of so many points."""
    return rounding(problem, [t_end * (i + 1) / points for i in range(points)]).span()


def _marks(grid, steps) -> list[tuple[float, bool, bool]]:
    """(time, whether it is of the grid, whether a step ends there), by time."""
    kept, ends = set(grid), set(steps)
    return [(t, t in kept, t in ends) for t in sorted(kept | ends)]


def _displaced(ta, problem, marks, random, by: float) -> np.ndarray:
    """The states on the grid of a run that is displaced, relatively by up to ``by``, at the start and at each step."""
    long = np.longdouble

    def factors():
        return long(1) + long(by) * random.uniform(-1, 1, len(ta.state))

    taylor.start(ta, long, problem.q0, problem.p0)
    ta.state[:] *= factors()
    rows = []
    for t, wanted, ends in marks:
        watch.seen("displaced run", t, marks[-1][0])
        ta.propagate_until(long(t), max_steps=taylor.STEP_LIMIT)
        if float(ta.time) != t or not np.isfinite(ta.state).all():
            raise taylor.ReferenceFailed(f"a displaced run stopped at t = {float(ta.time):.6g}")
        if wanted:
            rows.append(ta.state.copy())
        if ends:
            ta.state[:] *= factors()
    return np.array(rows)


def within(grid, distance, size, limit: float = LIMIT) -> float:
    """The last time of the grid before a distance first leaves the limit relative to the size; else 0."""
    bad = np.flatnonzero(~(distance <= limit * size))
    last = bad[0] - 1 if len(bad) else len(grid) - 1
    return float(grid[last]) if last >= 0 else 0.0


def neighbour(problem, grid, near) -> np.ndarray:
    """The largest distance so far of a trajectory that starts with relative displacements of `SHIFT`, array (n,)."""
    start = np.array([float(x) for x in (*problem.q0, *problem.p0)])
    shifted = start * (1 + SHIFT * (-1.0) ** np.arange(len(start)))
    d = problem.system.d
    other = taylor.states(problem.system, np.longdouble, shifted[:d], shifted[d:], grid)
    return np.maximum.accumulate(np.abs(other - near).max(axis=1).astype(float))


def growth(grid, apart, size) -> tuple[float, float | None]:
    """(exponent of t over the later three quarters until the neighbour is lost, rate where that is exponential)."""
    lost = np.flatnonzero(apart > LOST * size)
    last = max(1, (lost[0] if len(lost) else len(grid)) - 1)
    first = int(np.searchsorted(grid, grid[last] / 4))
    if first >= last or not apart[first] > 0:
        return float("nan"), None
    gained = float(np.log(apart[last] / apart[first]))
    exponent = gained / float(np.log(grid[last] / grid[first]))
    return exponent, gained / (grid[last] - grid[first]) if exponent > FASTEST else None
