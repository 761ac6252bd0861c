r"""The horizon: the time up to which an orbit can be followed, a property of the problem and not of the machine.

A run in long double rounds its state in every step, by up to half a unit in the last place: the relative `UNIT`.  The
effect depends on how the digits happen to fall, which differs between machines.  Rounding is therefore simulated: each
of `DRAWS` runs multiplies every component of its state, at the start and at the end of each step, by

.. math:: 1 + u\,s, \qquad u \sim U(-1, 1), \qquad s \gg \text{the run's own round-off},

and its distance from the undisplaced run, times `UNIT` / s, is the effect of rounding to long double: while small, it
grows as neighbouring orbits separate.  The draws are seeded, and s is large against the machine's round-off; hence the
distances depend on the problem, but not on the machine, the tolerance or s.

The horizon is the last time at which the median over the draws of the distance, each the largest so far, is within
`LIMIT` of the state's size.  A sum of many roundings along one growing direction is normally distributed, so that its
size is within the two multiples `CENTRAL` of the median in 95 of 100 draws.  The interval of the horizon runs from the
time at which the larger multiple leaves the limit to that at which the smaller one does: in it 95 of 100 runs in long
double leave the limit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from phasebench.reference.solvers import taylor, watch

from .along import upto

#: Distance relative to the state's size; once rounding has grown to it, errors of trajectories are no longer given.
LIMIT = 1e-13
#: Largest relative change by rounding to a long double with 64 bits.
UNIT = 2.0**-64
DRAWS, SEED = 32, 1
#: The 0.975 and 0.025 quantiles of |x|, x normal, in units of the median of |x|.
CENTRAL = 3.323, 0.04646
#: The displacement s; at the limit the runs are then 1e-8 of the state's size apart.
DISPLACEMENT = 2.0**-47
#: Displacement and tolerance of an independent check; the tolerance changes the order and the round-off.
OTHER = 2.0**-44, "1e-17"
#: Relative agreement of distances on different machines.
SHARE = 0.02
#: Relative displacement of one neighbour, relative distance at which it is lost, least exponent taken as exponential.
SHIFT, LOST, FASTEST = 2.0**-47, 1e-3, 3.0


class Span(NamedTuple):
    """The horizon, up to which an orbit can be followed, and the interval in which 95 of 100 runs leave the limit."""

    horizon: float
    earliest: float
    latest: float


class Rounding(NamedTuple):
    """The effect of rounding to long double along an orbit.

    Attributes
    ----------
    grid : increasing times
    size : the state's max norms at these times, array (n,)
    distances : array (draws, n): the largest distance so far by which rounding moves the state, estimated from each of
        the displaced runs (draws)
    """

    grid: Sequence[float]
    size: np.ndarray
    distances: np.ndarray

    def span(self, limit: float = LIMIT) -> Span:
        """The last time before the median effect exceeds ``limit`` of the state's size, and its interval."""
        median = np.median(self.distances, axis=0)
        return Span(*(within(self.grid, factor * median, self.size, limit) for factor in (1.0, *CENTRAL)))

    @property
    def band(self) -> tuple[Span, Span]:
        """The least and the largest span that another machine may find: limits by `SHARE` and one grid point apart."""
        less, more = (self.span(LIMIT * factor) for factor in (1 - SHARE, 1 + SHARE))
        return Span(*(self._beside(t, -1) for t in less)), Span(*(self._beside(t, 1) for t in more))

    def _beside(self, t: float, by: int) -> float:
        times = [0.0, *self.grid]
        return times[min(max(times.index(t) + by, 0), len(times) - 1)]


def rounding(
    problem: Any, grid: Sequence[float], run: tuple = (DISPLACEMENT, None), seed: int = SEED, draws: int = DRAWS
) -> Rounding:
    """Simulate rounding to long double along a problem's orbit by randomly displaced runs, and return the `Rounding`.

    ``grid`` are the times; ``run`` is (relative displacement, tolerance of the Taylor series), where None means the
    epsilon of long double; ``draws`` is the number of displaced runs.

    Raises
    ------
    ReferenceFailed
        If a run does not reach the end of the grid.
    """
    long, _ = taylor.extended_types()
    displacement, tol = run
    ta = taylor.integrator(problem.system, long, tol)
    steps = taylor.step_ends(problem.system, long, problem.q0, problem.p0, grid[-1])
    marks = _marks(grid, steps)
    base = _displaced_states(ta, problem, marks, np.random.default_rng(seed), 0.0)
    rows = []
    for k in range(draws):
        other = _displaced_states(ta, problem, marks, np.random.default_rng([seed, k]), displacement)
        apart = np.abs(other - base).max(axis=1).astype(float)
        rows.append(np.maximum.accumulate(apart) * (UNIT / displacement))
    return Rounding(list(grid), np.abs(base).max(axis=1).astype(float), np.array(rows))


def span(problem: Any, t_end: float, points: int = 100) -> Span:
    """How long a problem's orbit can be followed: its horizon, and the interval of that estimate.

    Past the horizon rounding to long double moves the orbit by more than `LIMIT` times its size.  The search covers
    ``points`` equidistant times up to ``t_end``.
    """
    return rounding(problem, [t_end * (i + 1) / points for i in range(points)]).span()


def _marks(grid: Iterable[float], steps: Iterable[float]) -> list[tuple[float, bool, bool]]:
    """Merge a grid with the ends of steps: (time, True if in the grid, True if a step ends there), sorted by time."""
    kept, ends = set(grid), set(steps)
    return [(t, t in kept, t in ends) for t in sorted(kept | ends)]


def _displaced_states(
    ta: Any, problem: Any, marks: Sequence[tuple[float, bool, bool]], random: np.random.Generator, by: float
) -> np.ndarray:
    """Integrate a problem's orbit with random relative displacements up to ``by``, at the start and after each step.

    ``ta`` is heyoka's integrator; ``marks`` are the times of a grid and the ends of steps, as from `_marks`.  Returns
    the states on the grid, array (n, 2 d).
    """
    long = np.longdouble

    def factors() -> np.ndarray:
        return long(1) + long(by) * random.uniform(-1, 1, len(ta.state))

    taylor.start(ta, long, problem.q0, problem.p0)
    ta.state[:] *= factors()
    rows = []
    for t, wanted, ends in marks:
        watch.report_time("displaced run", t, marks[-1][0])
        ta.propagate_until(long(t), max_steps=taylor.STEP_LIMIT)
        if float(ta.time) != t or not np.isfinite(ta.state).all():
            raise taylor.ReferenceFailed(f"a displaced run stopped at t = {float(ta.time):.6g}")
        if wanted:
            rows.append(ta.state.copy())
        if ends:
            ta.state[:] *= factors()
    return np.array(rows)


def within(grid: Sequence[float] | np.ndarray, distance: np.ndarray, size: np.ndarray, limit: float = LIMIT) -> float:
    """The last time of the grid before the distance first exceeds ``limit`` times the size; 0 if there is none."""
    bad = np.flatnonzero(~(distance <= limit * size))
    last = bad[0] - 1 if len(bad) else len(grid) - 1
    return float(grid[last]) if last >= 0 else 0.0


def neighbour(problem: Any, grid: Sequence[float], near: np.ndarray, everywhere: bool = False) -> np.ndarray:
    """Integrate an orbit whose start is displaced by the relative `SHIFT`; return its distance from a problem's orbit.

    Each component is displaced in proportion to itself; if ``everywhere``, to the largest, also one that is 0.
    ``near`` are the states of the undisplaced orbit in long double at the times of the grid.  The result, array (n,),
    is at each of these times the largest distance so far.
    """
    start = np.array([float(x) for x in (*problem.q0, *problem.p0)])
    size, d = np.abs(start).max() if everywhere else start, problem.system.d
    shifted = start + SHIFT * size * (-1.0) ** np.arange(2 * d)
    other = taylor.states(problem.system, np.longdouble, shifted[:d], shifted[d:], grid)
    return upto(np.abs(other - near).max(axis=1).astype(float))


def growth(grid: Sequence[float] | np.ndarray, apart: np.ndarray, size: np.ndarray) -> tuple[float, float | None]:
    """Fit (k, r): the distance of neighbouring orbits grows as t^k, or as exp(r t); r is None if k is small.

    ``apart`` is this distance and ``size`` the state's max norm, at the times of the grid.  Both k and r are from the
    last three quarters of the time until ``apart`` exceeds `LOST` times ``size``; (NaN, None) if that cannot be fitted.
    """
    lost = np.flatnonzero(apart > LOST * size)
    last = max(1, (lost[0] if len(lost) else len(grid)) - 1)
    first = int(np.searchsorted(grid, grid[last] / 4))
    if first >= last or not apart[first] > 0:
        return float("nan"), None
    gained = float(np.log(apart[last] / apart[first]))
    exponent = gained / float(np.log(grid[last] / grid[first]))
    return exponent, gained / (grid[last] - grid[first]) if exponent > FASTEST else None
