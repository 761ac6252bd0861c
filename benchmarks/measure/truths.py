"""What is true of a quantity, with its own uncertainty, found once for a problem, a quantity and a span.

Of a state at the end: the certified one, where one is stored at that time; the uncertainty is what moving each of its
components by a unit in the last place of a double, and rounding the values, makes of the quantity.  Of anything else:
heyoka's Taylor series in long double, run at two tolerances, whose orders and roundings are others; the uncertainty is
`SAFETY` times what the quantity differs by, and what rounding the values to double makes.  Of a statistical quantity:
the mean over `NEIGHBOURS` orbits displaced by `SHIFT`, seeded; the uncertainty is twice their standard deviation, since
an exact integration is but one more of them.
"""

from __future__ import annotations

from functools import lru_cache
from math import pi
from types import SimpleNamespace

import numpy as np

from phasebench.reference.certificates import stored

from .quantities import Quantity, Truth, distance, values

#: Two runs of independent errors: one of them is off by more than three times their distance in a few of 100 cases.
SAFETY = 3.0
#: Tolerances of the long double runs.
TOLERANCES = (1e-19, 1e-18)
#: Orbits of a statistical quantity, what they are displaced by, the seed, and their tolerance: statistics need no more.
NEIGHBOURS, SHIFT, SEED, ENOUGH = 24, 1e-6, 1, 1e-12
CERTIFIED, LONG_DOUBLE, ENSEMBLE, NONE = "certified", "long double", "ensemble", "not needed"
EPS = float(np.finfo(float).eps)


def truth(problem, quantity: Quantity, t_end: float) -> Truth:
    """What is true at, or up to, ``t_end``.

    Raises
    ------
    reference.solvers.taylor.ReferenceFailed
        Where the reference does not come to the end, naming the time it reached.
    """
    if quantity.kept:
        return Truth(np.zeros(1), 0.0, NONE)
    if quantity.statistical:
        return _ensemble(problem, quantity, t_end)
    if quantity.rows == 1 and (end := _certified(problem, t_end)) is not None:
        return _at_certified(problem, quantity, t_end, end)
    one, other = (values(problem, quantity, run) for run in _runs(problem, quantity.rows, t_end))
    return Truth(one, SAFETY * distance(quantity, one, other) + _rounding(quantity, one), LONG_DOUBLE)


def _rounding(quantity: Quantity, values: np.ndarray) -> float:
    return EPS * max(float(np.abs(values).max()), pi if quantity.angle else 0.0)


def _at_certified(problem, quantity: Quantity, t_end: float, end) -> Truth:
    d, state = problem.system.d, np.concatenate([end.q, end.p])

    def at(y) -> np.ndarray:
        return values(problem, quantity, _rows(t_end, problem, y[:d], y[d:]))

    found, apart = at(state), 0.0
    for i, unit in enumerate(np.maximum(np.spacing(np.abs(state)), end.uncertainty)):
        moved = at(state + unit * (np.arange(2 * d) == i)) - found
        apart = apart + np.abs((moved + pi) % (2 * pi) - pi if quantity.angle else moved)
    return Truth(found, float(np.max(apart)) + _rounding(quantity, found), CERTIFIED)


def _certified(problem, t_end: float):
    return stored.end(problem, t_end) if hasattr(problem, "orbits") else None


def _rows(t, problem, q, p) -> SimpleNamespace:
    """Rows with the initial one before them."""
    t = np.concatenate([[0.0], np.atleast_1d(t)])
    return SimpleNamespace(t=t, q=np.vstack([[problem.q0], q]), p=np.vstack([[problem.p0], p]))


@lru_cache(maxsize=8)
def _flows(system):
    from phasebench.reference.solvers import taylor

    long, _ = taylor.extended()
    return [taylor.integrator(system, long, tol) for tol in TOLERANCES]


def _runs(problem, parts: int, t_end: float):
    from phasebench.reference.solvers import taylor

    long, _ = taylor.extended()
    times = t_end / parts * np.arange(1, parts + 1)
    d = problem.system.d
    for flow in _flows(problem.system):
        rows = _propagated(flow, long, problem.q0, problem.p0, times)
        yield _rows(times, problem, rows[:, :d].astype(float), rows[:, d:].astype(float))


def _propagated(flow, number, q, p, times) -> np.ndarray:
    from phasebench.reference.solvers import taylor

    taylor.start(flow, number, q, p)
    grid = np.array([number(0.0), *(number(float(t)) for t in times)], dtype=number)
    rows, _, failure = taylor.propagate(flow, grid)
    if failure is None and not np.isfinite(rows.astype(float)).all():
        failure = "the state is no longer finite"
    if failure is not None:
        raise taylor.ReferenceFailed(f"the {number.__name__} run stopped at t = {float(flow.time):.6g}: {failure}")
    return rows[1:]


def _ensemble(problem, quantity: Quantity, t_end: float) -> Truth:
    from phasebench.reference.solvers import taylor

    flow, rng = taylor.integrator(problem.system, float, ENOUGH), np.random.default_rng(SEED)
    times = t_end / quantity.rows * np.arange(1, quantity.rows + 1)
    d, found = problem.system.d, []
    for _ in range(NEIGHBOURS):
        start = np.array([*problem.q0, *problem.p0]) * (1 + SHIFT * rng.uniform(-1, 1, 2 * d))
        rows = _propagated(flow, float, start[:d], start[d:], times)
        whole = SimpleNamespace(
            t=np.concatenate([[0.0], times]),
            q=np.vstack([start[:d], rows[:, :d]]),
            p=np.vstack([start[d:], rows[:, d:]]),
        )
        found.append(values(problem, quantity, whole))
    spread = np.std(found, axis=0, ddof=1)
    return Truth(np.mean(found, axis=0), float(2 * spread.max()), ENSEMBLE)
