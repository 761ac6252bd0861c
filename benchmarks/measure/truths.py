"""What is true of a quantity, with its own uncertainty, found once for a problem, a quantity and a span.

Of a state at the end: the certified one, where one is stored at that time; the uncertainty is what moving each of its
components by a unit in the last place of a double, and rounding the values, makes of the quantity.  Of anything else:
two runs in long double and a few displaced ones (`reference.certificates.followed`); the uncertainty is `SAFETY` times
what the quantity differs by in the two, `GROWN` times the most that a rounding grows to, and what rounding the values
to double makes.  Of a statistical quantity: the mean over `NEIGHBOURS` orbits displaced by `SHIFT`, seeded; the
uncertainty is twice their standard deviation, since an exact integration is but one more of them.
"""

from __future__ import annotations

from math import pi
from types import SimpleNamespace

import numpy as np

from phasebench.reference.certificates import followed, stored
from phasebench.reference.certificates.followed import Followed

from .quantities import Quantity, Truth, distance, values

#: Two runs of independent errors: one of them is off by more than three times their distance in a few of 100 cases.
SAFETY = 3.0
#: A step rounds in many operations, a displaced run in one, and the worst of a few draws may still be a lucky one.
GROWN = 16.0
#: Orbits of a statistical quantity, what they are displaced by, the seed, and their tolerance: statistics need no more.
NEIGHBOURS, SHIFT, SEED, ENOUGH = 24, 1e-6, 1, 1e-12
CERTIFIED, LONG_DOUBLE, ENSEMBLE, NONE = "certified", followed.TAYLOR, "ensemble", "not needed"
EPS = float(np.finfo(float).eps)


def truth(problem, quantity: Quantity, t_end: float) -> Truth:
    """What is true at, or up to, ``t_end``.

    Raises
    ------
    reference.solvers.taylor.ReferenceFailed
        Where no reference comes to the end, naming the times they reached.
    """
    if quantity.kept:
        return Truth(np.zeros(1), 0.0, NONE)
    if quantity.statistical:
        return _ensemble(problem, quantity, t_end)
    if quantity.rows == 1 and (end := _certified(problem, t_end)) is not None:
        return _at_certified(problem, quantity, t_end, end)
    times = t_end / quantity.rows * np.arange(1, quantity.rows + 1)
    return of_runs(problem, quantity, followed.follow(problem, times))


def of_runs(problem, quantity: Quantity, runs: Followed) -> Truth:
    """What runs in long double, at the quantity's times, say of it."""
    d = problem.system.d

    def at(rows: np.ndarray) -> np.ndarray:
        return values(
            problem, quantity, _rows(runs.times, problem, rows[:, :d].astype(float), rows[:, d:].astype(float))
        )

    one = at(runs.one)
    apart = SAFETY * distance(quantity, one, at(runs.other))
    grown = runs.share * max(distance(quantity, one, at(rows)) for rows in runs.displaced)
    return Truth(one, apart + GROWN * grown + _rounding(quantity, one), runs.source, grown)


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


def _ensemble(problem, quantity: Quantity, t_end: float) -> Truth:
    from phasebench.reference.solvers import taylor

    flow, rng = taylor.integrator(problem.system, float, ENOUGH), np.random.default_rng(SEED)
    times = t_end / quantity.rows * np.arange(1, quantity.rows + 1)
    d, found = problem.system.d, []
    for _ in range(NEIGHBOURS):
        start = np.array([*problem.q0, *problem.p0]) * (1 + SHIFT * rng.uniform(-1, 1, 2 * d))
        taylor.start(flow, float, start[:d], start[d:])
        rows, _, failure = taylor.propagate(flow, np.array([0.0, *times]))
        if failure is not None or not np.isfinite(rows).all():
            why = failure or "the state is no longer finite"
            raise taylor.ReferenceFailed(f"the reference of orbits nearby stopped at t = {float(flow.time):.6g}: {why}")
        whole = SimpleNamespace(
            t=np.concatenate([[0.0], times]),
            q=rows[:, :d],
            p=rows[:, d:],
        )
        found.append(values(problem, quantity, whole))
    spread = np.std(found, axis=0, ddof=1)
    return Truth(np.mean(found, axis=0), float(2 * spread.max()), ENSEMBLE)
