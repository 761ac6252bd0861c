"""The true value of a quantity, with its uncertainty.

- For a quantity of the end state alone, the certified state if one is stored for that time.  The uncertainty is the
  effect on the quantity of moving each component by one unit in the last place of a double, or by the state's own
  uncertainty if that is larger, plus rounding of the values.
- For other quantities, two runs in long double and a few displaced ones (`reference.certificates.followed`).  The
  uncertainty is `SAFETY` times the difference between the two, plus `GROWN` times the largest effect of rounding,
  plus rounding of the values to double.
- For a statistical quantity, the mean over `NEIGHBOURS` orbits with seeded displacements of relative size `SHIFT`.  The
  uncertainty is twice their standard deviation, since an exact integration would be just one more of them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from math import pi
from types import SimpleNamespace

import numpy as np
import sympy as sp

from phasebench.benchmarks.problems.base import Problem
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.hamiltonian import Hamiltonian, PartitionedSystem
from phasebench.reference.certificates import followed, stored
from phasebench.reference.certificates.followed import FollowedOrbit

from .quantities import Quantity, Truth, distance, values

#: Safety factor: one of two runs with independent errors is off by more than three times their distance in few cases.
SAFETY = 3.0
#: Factor for rounding: a step rounds in many operations, a displaced run once, and all of a few draws may be small.
GROWN = 16.0
#: For statistical quantities: number of orbits, relative displacement, seed, and tolerance (statistics need no more).
NEIGHBOURS, SHIFT, SEED, ENOUGH = 24, 1e-6, 1, 1e-12
CERTIFIED, LONG_DOUBLE, ENSEMBLE, NONE = "certified", followed.TAYLOR, "ensemble", "not needed"
EPS = float(np.finfo(float).eps)


def truth(problem: Problem, quantity: Quantity, t_end: float) -> Truth:
    """Return the true value of a quantity of a problem's orbit at, or up to, ``t_end``, with its uncertainty.

    A conserved quantity is given by its error, whose true value is 0.  ``t_end`` may be negative.

    Raises
    ------
    reference.solvers.taylor.ReferenceFailed
        If no reference reaches the end; the message has the times reached.
    InvalidInput
        For a negative ``t_end`` of a system that is not canonical or has no formula of H.
    """
    if quantity.kept:
        return Truth(np.zeros(1), 0.0, NONE)
    if quantity.statistical:
        return _ensemble(problem, quantity, t_end)
    if quantity.rows == 1 and (end := _certified_end(problem, t_end)) is not None:
        return _at_certified(problem, quantity, t_end, end)
    times = abs(t_end) / quantity.rows * np.arange(1, quantity.rows + 1)
    return of_runs(problem, quantity, followed.follow(onwards(problem, t_end), times))


def onwards(problem: Problem, t_end: float) -> Problem:
    """Return a problem whose orbit to ``|t_end|`` is that of ``problem`` to ``t_end``: with -H, if that is negative."""
    if t_end > 0:
        return problem
    system = problem.system
    if not (system.canonical and isinstance(system.H, sp.Basic)):
        raise InvalidInput("the error of a span back in time is told of canonical systems with a formula of H alone")
    return replace(problem, id=f"{problem.id} back in time", system=_reversed(system))


@lru_cache(maxsize=8)
def _reversed(system: PartitionedSystem) -> Hamiltonian:
    return Hamiltonian(q=system.q, p=system.p, H=-system.H)


def of_runs(problem: Problem, quantity: Quantity, runs: FollowedOrbit) -> Truth:
    """Return the true value from two runs in long double, whose distance shows the error, and some displaced ones."""
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


def _at_certified(problem: Problem, quantity: Quantity, t_end: float, end: stored.End) -> Truth:
    d, state = problem.system.d, np.concatenate([end.q, end.p])

    def at(y: np.ndarray) -> np.ndarray:
        return values(problem, quantity, _rows(t_end, problem, y[:d], y[d:]))

    found, apart = at(state), 0.0
    for i, unit in enumerate(np.maximum(np.spacing(np.abs(state)), end.uncertainty)):
        moved = at(state + unit * (np.arange(2 * d) == i)) - found
        apart = apart + np.abs((moved + pi) % (2 * pi) - pi if quantity.angle else moved)
    return Truth(found, float(np.max(apart)) + _rounding(quantity, found), CERTIFIED)


def _certified_end(problem: Problem, t_end: float) -> stored.End | None:
    return stored.end(problem, t_end) if hasattr(problem, "orbits") else None


def _rows(t: float | np.ndarray, problem: Problem, q: np.ndarray, p: np.ndarray) -> SimpleNamespace:
    t = np.concatenate([[0.0], np.atleast_1d(t)])
    return SimpleNamespace(t=t, q=np.vstack([[problem.q0], q]), p=np.vstack([[problem.p0], p]))


def _ensemble(problem: Problem, quantity: Quantity, t_end: float) -> Truth:
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
