r"""An orbit in long double at times of which no state is stored, with what tells its error.

It is followed twice, at two tolerances, and then `DRAWS` times displaced: at the start, and at `KICKS` ends of steps,
each component y is moved by

.. math:: s\,\sqrt{n/K}\;u\,\max(|y|, |y'|), \qquad u \sim U(-1, 1),

with n the steps of the run, K the kicks, y' the component at the kick before, and s = `DISPLACEMENT`.  The distance of
a displaced run, times `horizon.UNIT` / s, is what rounding to long double at each step grows to: also of an orbit on
which the two runs round alike at first, and that magnifies that rounding.

Taylor series come first; where they fail, or miss the energy, Gauss's method serves, on the steps of SciPy's DOP853.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from phasebench.reference.solvers import gauss, taylor
from phasebench.reference.solvers.taylor import ReferenceFailed

from . import horizon
from .along import upto

#: Displaced runs, the kicks of each, the seed; s is large against the run's own round-off.
DRAWS, KICKS, SEED = 5, 128, 1
DISPLACEMENT = 2.0**-52
#: Tolerances of the two Taylor runs; Gauss's steps are those of DOP853 at `ROUGH`, each in so many parts.
TOLERANCES = (1e-19, 1e-18)
PARTS, ROUGH = (3, 2), 1e-10
#: The horizon is looked for on as many times, on ever shorter spans, down to this share of the whole.
POINTS, SHORTEST = 100, 1e-9
#: Distances that relative displacements by s grow to are in proportion to s up to this share of the state's size.
LINEAR = 1e-3
#: A run whose energy has moved by more than this, in units of the sizes of H's terms, is not the orbit.
MISSED = 1e-6
TAYLOR, GAUSS = "long double", "long double, Gauss"


class Followed(NamedTuple):
    """An orbit in long double, with its displaced runs.

    Attributes
    ----------
    source : whose runs they are, `TAYLOR` or `GAUSS`
    times : increasing, positive
    one, other : the runs at two tolerances, arrays (n, 2 d) of long doubles
    displaced : a few more
    """

    source: str
    times: np.ndarray
    one: np.ndarray
    other: np.ndarray
    displaced: Sequence[np.ndarray]

    @property
    def share(self) -> float:
        """What rounding does, in units of what the displacement did; 1 where that is no longer in proportion."""
        far = self._apart().max(axis=0) > LINEAR * self._size()
        return 1.0 if far.any() else horizon.UNIT / DISPLACEMENT

    @property
    def rounding(self) -> horizon.Rounding:
        """The same as `horizon.rounding` tells, from fewer draws."""
        grown = np.maximum.accumulate(self._apart(), axis=1) * (horizon.UNIT / DISPLACEMENT)
        return horizon.Rounding([float(t) for t in self.times], self._size(), grown)

    def until(self) -> float:
        """The last of the times up to which the orbit can be followed: the horizon, if that is before the end."""
        apart = upto(np.abs(self.one - self.other).max(axis=1).astype(float))
        parted = horizon.within(self.times, apart, self._size())
        return min(self.rounding.span().horizon, parted)

    def _apart(self) -> np.ndarray:
        return np.array([np.abs(run - self.one).max(axis=1).astype(float) for run in self.displaced])

    def _size(self) -> np.ndarray:
        return np.abs(self.one).max(axis=1).astype(float)


def follow(problem, times) -> Followed:
    """Follow a problem's orbit to each of the times, increasing and positive.

    Raises
    ------
    ReferenceFailed
        Where neither solver comes to the end, saying what became of each.
    """
    times = np.asarray(times, dtype=float)
    why = []
    for runs in (_taylor, _gauss):
        try:
            with np.errstate(all="ignore"):
                return runs(problem, times)
        except ReferenceFailed as error:
            why.append(str(error))
    raise ReferenceFailed(f"the reference failed to t = {times[-1]:g}: {'; '.join(dict.fromkeys(why))}")


def reach(problem, t_end: float) -> float:
    """The horizon of a problem's orbit up to ``t_end``, to a part in `POINTS` of itself or two."""
    end = float(t_end)
    while True:
        times = [*(end * k / POINTS for k in range(1, POINTS)), end]
        until = follow(problem, times).until()
        if until >= end / 2 or end <= t_end * SHORTEST:
            return until
        end = next(t for t in times if t > until)


def _kicks(seed: int, steps: int) -> Callable[[np.ndarray], np.ndarray]:
    """A function that displaces a state, seeded; ``steps`` of the run that the kicks stand for."""
    random = np.random.default_rng([SEED, seed])
    by = np.longdouble(DISPLACEMENT * max(1.0, steps / KICKS) ** 0.5)
    before: list[np.ndarray] = []

    def kick(y: np.ndarray) -> np.ndarray:
        size = np.maximum(np.abs(y), before[-1]) if before else np.abs(y)
        before[:] = [np.abs(y)]
        return y + by * size * random.uniform(-1, 1, len(y))

    return kick


def _sound(problem, rows: np.ndarray, times, what: str) -> np.ndarray:
    """The rows, if they are finite and keep the energy."""
    doubles = rows.astype(float)
    if not np.isfinite(doubles).all():
        bad = int(np.flatnonzero(~np.isfinite(doubles).all(axis=1))[0])
        raise ReferenceFailed(f"{what} is no longer finite at t = {times[bad]:.6g}")
    system, d = problem.system, problem.system.d
    if system.H is None:
        return rows
    states = np.vstack([[*problem.q0, *problem.p0], doubles])
    Q, P = np.ascontiguousarray(states[:, :d]), np.ascontiguousarray(states[:, d:])
    H, scale = system.energies(Q, P), system.scale(Q, P)
    missed = ~(np.abs(H - H[0]) <= MISSED * np.maximum(scale, scale[0]))
    if missed.any():
        raise ReferenceFailed(f"{what} has lost the energy by t = {times[max(int(missed.argmax()) - 1, 0)]:.6g}")
    return rows


# -- Taylor series ----------------------------------------------------------------------------------------------------


@lru_cache(maxsize=8)
def _flows(system):
    long, _ = taylor.extended()
    return [taylor.integrator(system, long, tol) for tol in TOLERANCES]


def _taylor(problem, times) -> Followed:
    flows = _flows(problem.system)
    ends: list[float] = []
    one = _propagated(flows[0], problem, times, ends)
    other = _propagated(flows[1], problem, times)
    draws = [_displaced(flows[0], problem, times, ends, k) for k in range(DRAWS)]
    return Followed(TAYLOR, times, one, other, draws)


def _propagated(flow, problem, times, ends: list[float] | None = None) -> np.ndarray:
    long = np.longdouble
    taylor.start(flow, long, problem.q0, problem.p0)
    rows, _, failure = taylor.propagate(flow, np.array([0.0, *times], dtype=long), "reference", ends)
    if failure is not None:
        raise ReferenceFailed(f"the Taylor series in long double stopped at t = {float(flow.time):.6g}: {failure}")
    return _sound(problem, rows[1:], times, "the Taylor series in long double")


def _displaced(flow, problem, times, ends: Sequence[float], seed: int) -> np.ndarray:
    kick, at, long = _kicks(seed, len(ends)), set(_some(ends)), np.longdouble
    wanted = set(times)
    taylor.start(flow, long, problem.q0, problem.p0)
    flow.state[:] = kick(flow.state)
    rows = []
    for t in sorted(wanted | {x for x in at if x < times[-1]}):
        rows_, _, failure = taylor.propagate(flow, np.array([flow.time, long(t)]), "displaced reference")
        if failure is not None:
            raise ReferenceFailed(f"a displaced Taylor series stopped at t = {float(flow.time):.6g}: {failure}")
        if t in wanted:
            rows.append(rows_[-1].copy())
        if t in at:
            flow.state[:] = kick(flow.state)
    return np.array(rows)


def _some(ends: Sequence[float]) -> Sequence[float]:
    """About `KICKS` of the ends of steps."""
    return ends[:: max(1, len(ends) // KICKS)]


# -- Gauss's method ---------------------------------------------------------------------------------------------------


def _gauss(problem, times) -> Followed:
    from scipy.integrate import solve_ivp

    system, q0, p0 = problem.system, problem.q0, problem.p0
    rough = solve_ivp(
        system.vector_field(), (0.0, times[-1]), [*q0, *p0], method="DOP853", rtol=ROUGH, atol=ROUGH * ROUGH
    )
    if not rough.success:
        raise ReferenceFailed(f"DOP853, whose steps Gauss's method takes, stopped at t = {rough.t[-1]:.6g}")

    def run(parts: int, disturb: Callable[[np.ndarray], np.ndarray] = lambda y: y) -> np.ndarray:
        marks = [
            a + (b - a) * (k + 1) / parts for a, b in zip(rough.t[:-1], rough.t[1:], strict=True) for k in range(parts)
        ]
        return _sound(problem, gauss.run(system, q0, p0, marks, times, disturb), times, "Gauss's method")

    displaced = [run(PARTS[1], _kicks(k, KICKS)) for k in range(DRAWS)]
    return Followed(GAUSS, times, run(PARTS[0]), run(PARTS[1]), displaced)
