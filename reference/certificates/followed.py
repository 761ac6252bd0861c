r"""Reference orbits in long double at times without a stored state, with runs that estimate the error.

The orbit is integrated at two tolerances, and then `DRAWS` times with random displacements: at the start, and at
`KICKS` ends of steps, each component y is moved by

.. math:: s\,\sqrt{n/K}\;u\,\max(|y|, |y'|), \qquad u \sim U(-1, 1),

with n the number of steps, K the number of kicks (n in Gauss's method, which has one in every step), y' the component
at the previous kick, and s = `DISPLACEMENT`.  The distance of a displaced run, times `horizon.UNIT` / s, is the effect
of rounding to long double in each step.  It shows rounding that the orbit magnifies even where the two runs round
alike at first, so that their difference does not show it.

Taylor series are tried first; if they fail or lose the energy, or if H has a function that has none, such as abs(q),
Gauss's method runs on the steps of SciPy's DOP853.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasebench.integrators.errors import InvalidInput
from phasebench.reference.solvers import gauss, taylor
from phasebench.reference.solvers.taylor import ReferenceFailed

from . import horizon
from .along import upto

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

#: Number of displaced runs, kicks in each, and seed.  s, in `DISPLACEMENT`, is large against the runs' own round-off.
DRAWS, KICKS, SEED = 5, 128, 1
DISPLACEMENT = 2.0**-52
#: Tolerances of the two Taylor runs.  Gauss's two runs divide each step of DOP853, at tolerance `ROUGH`, into `PARTS`.
TOLERANCES = (1e-19, 1e-18)
PARTS, ROUGH = (3, 2), 1e-10
#: Number of times for the horizon; spans are shortened to locate it, down to this share of the whole.
POINTS, SHORTEST = 100, 1e-9
#: Up to this share of the state's size, distances are proportional to the relative displacement s.
LINEAR = 1e-3
#: A run whose energy changes by more than this, relative to the terms of H, has left the orbit.
MISSED = 1e-6
TAYLOR, GAUSS = "long double", "long double, Gauss"


class FollowedOrbit(NamedTuple):
    """An orbit in long double: two runs, whose difference shows their error, and randomly displaced runs.

    Attributes
    ----------
    source : the name of the solver, `TAYLOR` or `GAUSS`
    times : increasing, positive, array (n,)
    one, other : the states (q, p) of the two runs at these times, arrays (n, 2 d) of long doubles; Taylor series have
        two tolerances, Gauss's method has two step sizes
    displaced : the states of the displaced runs, a list of such arrays; their distances from ``one`` show how the orbit
        magnifies rounding
    """

    source: str
    times: np.ndarray
    one: np.ndarray
    other: np.ndarray
    displaced: Sequence[np.ndarray]

    @property
    def share(self) -> float:
        """Factor that turns distances of displaced runs into the effect of rounding to long double.

        It is `horizon.UNIT` / `DISPLACEMENT`, or 1 if a distance is too large to be proportional to the displacement.
        """
        far = self._distances().max(axis=0) > LINEAR * self._size()
        return 1.0 if far.any() else horizon.UNIT / DISPLACEMENT

    @property
    def rounding(self) -> horizon.Rounding:
        """The effect of rounding to long double along the orbit, estimated from the displaced runs."""
        grown = np.maximum.accumulate(self._distances(), axis=1) * (horizon.UNIT / DISPLACEMENT)
        return horizon.Rounding([float(t) for t in self.times], self._size(), grown)

    def until(self) -> float:
        """The last time at which the effect of rounding and the difference of the two runs are within the limit."""
        apart = upto(np.abs(self.one - self.other).max(axis=1).astype(float))
        parted = horizon.within(self.times, apart, self._size())
        return min(self.rounding.span().horizon, parted)

    def _distances(self) -> np.ndarray:
        return np.array([np.abs(run - self.one).max(axis=1).astype(float) for run in self.displaced])

    def _size(self) -> np.ndarray:
        return np.abs(self.one).max(axis=1).astype(float)


def follow(problem: Any, times: Sequence[float] | np.ndarray) -> FollowedOrbit:
    """Integrate a problem's orbit to each of the times, which are positive and increasing, in long double.

    Raises
    ------
    ReferenceFailed
        If neither solver, Taylor series and Gauss's method, reaches the end; the message has both reasons.
    """
    times = np.asarray(times, dtype=float)
    why = []
    for runs in (_taylor, _gauss):
        try:
            with np.errstate(all="ignore"):
                return runs(problem, times)
        except (ReferenceFailed, InvalidInput) as error:
            why.append(str(error))
    raise ReferenceFailed(f"the reference failed to t = {times[-1]:g}: {'; '.join(dict.fromkeys(why))}")


def reach(problem: Any, t_end: float) -> float:
    """The horizon: the time, at most ``t_end``, up to which a problem's orbit can be followed in long double.

    Its relative error is about 2 / `POINTS`.
    """
    end = float(t_end)
    while True:
        times = [*(end * k / POINTS for k in range(1, POINTS)), end]
        until = follow(problem, times).until()
        if until >= end / 2 or end <= t_end * SHORTEST:
            return until
        end = next(t for t in times if t > until)


def _kicks(seed: int, steps: int) -> Callable[[np.ndarray], np.ndarray]:
    """Make a function that displaces a state, array (2 d,), at random, and returns the displaced state.

    A run that calls the function after about `KICKS` of its steps passes its number of ``steps``, one that calls it
    after every step passes `KICKS`.  Displacements grow with the square root of ``steps`` / `KICKS`, so that fewer
    calls have the effect of a relative displacement by up to `DISPLACEMENT` after every step.  ``seed`` is the number
    of the run.
    """
    random = np.random.default_rng([SEED, seed])
    by = np.longdouble(DISPLACEMENT * max(1.0, steps / KICKS) ** 0.5)
    before: list[np.ndarray] = []

    def kick(y: np.ndarray) -> np.ndarray:
        size = np.maximum(np.abs(y), before[-1]) if before else np.abs(y)
        before[:] = [np.abs(y)]
        return y + by * size * random.uniform(-1, 1, len(y))

    return kick


def _sound(problem: Any, rows: np.ndarray, times: Sequence[float] | np.ndarray, what: str) -> np.ndarray:
    """The states ``rows`` of the solver ``what``; raises ReferenceFailed unless they are finite and keep the energy."""
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
def _flows(system: PartitionedSystem) -> list[Any]:
    long, _ = taylor.extended_types()
    return [taylor.integrator(system, long, tol) for tol in TOLERANCES]


def _taylor(problem: Any, times: np.ndarray) -> FollowedOrbit:
    flows = _flows(problem.system)
    ends: list[float] = []
    one = _propagate(flows[0], problem, times, ends)
    other = _propagate(flows[1], problem, times)
    draws = [_propagate_displaced(flows[0], problem, times, ends, k) for k in range(DRAWS)]
    return FollowedOrbit(TAYLOR, times, one, other, draws)


def _propagate(flow: Any, problem: Any, times: np.ndarray, ends: list[float] | None = None) -> np.ndarray:
    long = np.longdouble
    taylor.start(flow, long, problem.q0, problem.p0)
    rows, _, failure = taylor.propagate(flow, np.array([0.0, *times], dtype=long), "reference", ends)
    if failure is not None:
        raise ReferenceFailed(f"the Taylor series in long double stopped at t = {float(flow.time):.6g}: {failure}")
    return _sound(problem, rows[1:], times, "the Taylor series in long double")


def _propagate_displaced(flow: Any, problem: Any, times: np.ndarray, ends: Sequence[float], seed: int) -> np.ndarray:
    at = set(ends[:: max(1, len(ends) // KICKS)])  # about `KICKS` of the ends of steps
    kick, wanted, long = _kicks(seed, len(ends)), set(times), np.longdouble
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


# -- Gauss's method ---------------------------------------------------------------------------------------------------


def _gauss(problem: Any, times: np.ndarray) -> FollowedOrbit:
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
    return FollowedOrbit(GAUSS, times, run(PARTS[0]), run(PARTS[1]), displaced)
