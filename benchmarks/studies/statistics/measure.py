r"""Measure the bias that an integrator with a given step gives to a statistic, with the ensemble's uncertainty.

A row is a state of an orbit at an output time; the time between two rows is a whole number of steps.  Every orbit gives
the sum of a quantity over its rows, and their number.  The statistic is the ratio of the totals over orbits, and its
standard error that of a ratio estimate (W. G. Cochran, Sampling Techniques (1977), section 6.4).  Where the exact
statistic is not known, the standard error is that of the differences, orbit by orbit, from the reference run `FINE`.
Rows of the last tenth of the time give a second statistic, in which an error that grows with time shows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import nan
from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks.measure import lyapunov
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.driver import OK
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.registry import BY_ID
from phasebench.integrators.section import section

from . import scenes
from .scenes import EXPONENT, FINE, SCENES, SECTION, Scene

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.ensemble import Ensemble

TABLE, EXACT = "statistics", "statistics_exact"
#: Symplectic methods, by order, and methods that are not.
SYMPLECTIC = (
    "symplectic-euler-q",
    "stormer-verlet",
    "mclachlan-atela-2",
    "forest-ruth",
    "calvo-sanz-serna-4",
    "blanes-moan-srkn6b",
    "kahan-li-8",
    "implicit-midpoint",
    "gauss-4",
    "gauss-6",
)
OTHERS = ("rk4", "dop853", "avf")
METHODS = (*SYMPLECTIC, *OTHERS)
#: Steps between two rows.
LADDER = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
#: A ladder ends after a run of this many evaluations in a unit of time of a row, or after `ENOUGH` runs within 1 %.
MOST, ENOUGH = 192, 3
#: The largest error, as a share of the statistic; the first share of the rows, which is not counted for the atoms.
WANTED, SETTLING = 0.01, 0.2
#: Standard errors that an error's bound has on top.
SIGMAS = 2.0
#: Orbits that are integrated at once.
BLOCK = 4096


def able(id: str, method: str) -> bool:
    """Return True if the method can integrate the problem of the scene ``id``: some need a separable H."""
    coupled = SCENES[id].problem in scenes.COUPLED
    return not (coupled and {"separable", "quadratic kinetic energy"} & set(BY_ID[method].requires))


def needs(scene: str, method: str = FINE[0]) -> tuple:
    """What a row depends on."""
    return BY_ID[method], BY_ID[FINE[0]], ProblemKey(SCENES[scene].problem), repr(SCENES[scene])


@dataclass(frozen=True)
class Sums:
    """Sums of a quantity along every orbit of an ensemble, from which a statistic is computed.

    Attributes
    ----------
    total, number : arrays (orbits,), each orbit's sum over its output rows or crossings, and their number; the sum is
        NaN if the orbit ended early.  For Lyapunov exponents the sum is the exponent and the number 1
    late, late_number : the same over the last tenth of the time; NaN for exponents
    evaluations : gradient evaluations of one orbit in the time between two output rows
    """

    total: np.ndarray
    number: np.ndarray
    late: np.ndarray
    late_number: np.ndarray
    evaluations: float

    @property
    def ended(self) -> int:
        """The number of orbits that ended early."""
        return int(np.isnan(self.total).sum())


def sums(scene: Scene, method: str, k: int) -> Sums:
    """Integrate the ensemble of a scene by a method with k steps between output rows; return its sums along orbits."""
    measured = {SECTION: _crossings, EXPONENT: _exponents}.get(scene.kind, _rows)
    parts = [measured(scene, method, k, q, p) for q, p in _blocks(scene)]
    columns = [np.concatenate([getattr(s, name) for s in parts]) for name in ("total", "number", "late", "late_number")]
    return Sums(*columns, parts[0].evaluations)


def _blocks(scene: Scene) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    q, p = scenes.start(scene)
    for first in range(0, len(q), BLOCK):
        yield q[first : first + BLOCK], p[first : first + BLOCK]


def _integrated(scene: Scene, method: str, k: int, q: np.ndarray, p: np.ndarray) -> tuple[Ensemble, float]:
    """Integrate the initial states q, p, arrays (n, d), with k steps between output rows.

    Returns (the solution, gradient evaluations of one orbit between two rows).
    """
    steps = round(scene.span / scene.row)
    run = integrate_ensemble(problem(scene.problem), method, q, p, h=scene.row / k, steps=steps * k, save_every=k)
    return run, run.counts["gradient"] / len(q) / steps


def _rows(scene: Scene, method: str, k: int, q: np.ndarray, p: np.ndarray) -> Sums:
    run, evaluations = _integrated(scene, method, k, q, p)
    rows = scenes.quantity(scene)(run.Q, run.P)
    first = round(SETTLING * rows.shape[1]) if scene.energy is None else 0
    rows[run.status != OK] = nan
    rows, late = rows[:, first:], rows[:, -rows.shape[1] // 10 :]
    number = (np.full(len(q), float(x.shape[1])) for x in (rows, late))
    return Sums(rows.sum(axis=1), next(number), late.sum(axis=1), next(number), evaluations)


def _crossings(scene: Scene, method: str, k: int, q: np.ndarray, p: np.ndarray) -> Sums:
    made, steps = problem(scene.problem), round(scene.span / scene.row) * k
    found = section(made, method, q, p, of=scene.plane, h=scene.row / k, steps=steps)
    values, late, n, out = scenes.quantity(scene)(found.q, found.p), found.t > 0.9 * scene.span, len(q), []
    for part in (np.ones(len(values), bool), late):
        orbit = found.orbit[part]
        out += [np.bincount(orbit, values[part], n), np.bincount(orbit, minlength=n).astype(float)]
    for column in out:
        column[found.status != OK] = nan
    return Sums(*out, evaluations_of(made, method) * k)


def _exponents(scene: Scene, method: str, k: int, q: np.ndarray, p: np.ndarray) -> Sums:
    run, evaluations = _integrated(scene, method, k, q, p)
    system, t = problem(scene.problem).system, np.arange(run.Q.shape[1]) * scene.row
    found = np.array([lyapunov.exponent(system, t, Q, P) for Q, P in zip(run.Q, run.P, strict=True)])
    found[run.status != OK] = nan
    one, none = np.ones(len(q)), np.full(len(q), nan)
    return Sums(found, one, none, none, evaluations)


def evaluations_of(made: Problem, method: str) -> float:
    """Return how many gradients a step of a method evaluates on the problem ``made``, on average over 50 steps."""
    q, p = np.array([made.q0]), np.array([made.p0])
    run = integrate_ensemble(made, method, q, p, h=made.pace.step, steps=50)
    return run.counts["gradient"] / 50


def statistic(total: np.ndarray, number: np.ndarray) -> tuple[float, float]:
    """Return (statistic, its standard error): the sum of ``total`` over orbits divided by that of ``number``.

    Both arguments are arrays (orbits,).  The results are NaN if an orbit ended early.
    """
    value = total.sum() / number.sum()
    return float(value), float((total - value * number).std(ddof=1) / number.mean() / np.sqrt(len(total)))


@lru_cache(maxsize=2)
def _fine(scene: Scene) -> Sums:
    return sums(scene, *FINE)


def reference(scene: str) -> dict:
    """The exact statistic (that of `FINE` where none is known), and the mean of a run of `FINE` with its error."""
    of = SCENES[scene]
    fine = _fine(of)
    mean, error = statistic(fine.total, fine.number)
    row = {"exact": scenes.exact(of) if of.known else mean, "known": of.known}
    return row | {"mean": mean, "standard error": error}


def ladder(scene: str, method: str) -> list[dict]:
    """The statistic for decreasing steps, those of `LADDER`, until a run is dear or a few are within 1 %."""
    of = SCENES[scene]
    rows, met = [], 0
    exact = scenes.exact(of) if of.known else statistic(_fine(of).total, _fine(of).number)[0]
    for k in LADDER:
        found = sums(of, method, k)
        mean, error = statistic(found.total, found.number)
        if not of.known:
            error = statistic(found.total - _fine(of).total, found.number)[1]
        late, late_error = statistic(found.late, found.late_number)
        row = {"symplectic": method in SYMPLECTIC, "k": k, "h": of.row / k}
        row |= {"evaluations": found.evaluations / of.row, "mean": mean, "standard error": error}
        rows.append(row | {"ended": found.ended, "late": late, "late error": late_error})
        met += abs(mean - exact) + SIGMAS * error <= WANTED * abs(exact)
        if found.evaluations > MOST or met >= ENOUGH:
            break
    return rows
