r"""The bias of a statistic by an integrator at a step, with its statistical uncertainty over the ensemble.

Every orbit gives one average over its rows; their mean is the statistic, and its standard error is that of their
spread.  Rows of the last tenth give a second statistic: an error that grows with time shows there.  The step divides
the time between rows.
"""

from __future__ import annotations

from math import nan

import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import OK
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.registry import BY_ID
from phasebench.integrators.section import section

from . import scenes
from .scenes import FINE, SCENES, SECTION, Scene

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


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each scene and method, and one for each scene's reference; none if ``quick``."""
    if quick:
        return []
    return [*map(_reference_cell, SCENES), *(_cell(id, m) for id in SCENES for m in METHODS if able(id, m))]


def able(id: str, method: str) -> bool:
    """Whether a method can integrate a scene's problem."""
    coupled = SCENES[id].problem in scenes.COUPLED
    return not (coupled and {"separable", "quadratic kinetic energy"} & set(BY_ID[method].requires))


def _cell(id: str, method: str) -> Cell:
    scene = SCENES[id]
    needs = content(TABLE, BY_ID[method], BY_ID[FINE[0]], ProblemKey(scene.problem), repr(scene), code=[__name__])
    key = {"scene": id, "method": method}
    return Cell("statistics", (TABLE,), key, measure_rows, (id, method), needs, frozenset({method, scene.problem}))


def _reference_cell(id: str) -> Cell:
    scene = SCENES[id]
    needs = content(EXACT, BY_ID[FINE[0]], ProblemKey(scene.problem), repr(scene), code=[__name__])
    return Cell("statistics", (EXACT,), {"scene": id}, measure_reference, (id,), needs, frozenset({scene.problem}))


def averages(scene: Scene, method: str, k: int) -> tuple[np.ndarray, np.ndarray, float]:
    """(each orbit's average, that over the last tenth, evaluations of an orbit in the time of a row).

    Averages are arrays (orbits,), NaN for an orbit that ended early or without a crossing.
    """
    made, (q, p), of = problem(scene.problem), scenes.start(scene), scenes.quantity(scene)
    steps = round(scene.span / scene.row)
    size = {"h": scene.row / k, "steps": steps * k}
    if scene.kind == SECTION:
        found = section(made, method, q, p, of=scene.plane, **size)
        values, late = of(found.q, found.p), found.t > 0.9 * scene.span
        n = len(q)
        means = [
            np.bincount(found.orbit[part], values[part], n) / np.maximum(np.bincount(found.orbit[part], minlength=n), 1)
            for part in (np.ones(len(values), bool), late)
        ]
        for mean in means:
            mean[found.status != OK] = nan
        evaluations = evaluations_of(made, method) * k
        return means[0], means[1], evaluations
    run = integrate_ensemble(made, method, q, p, **size, save_every=k)
    rows = of(run.Q, run.P)
    first = round(SETTLING * rows.shape[1]) if scene.energy is None else 0
    rows[run.status != OK] = nan
    return (
        rows[:, first:].mean(axis=1),
        rows[:, -rows.shape[1] // 10 :].mean(axis=1),
        run.counts["gradient"] / len(q) / steps,
    )


def evaluations_of(made, method: str) -> float:
    """Evaluations of the gradient in a step."""
    q, p = np.array([made.q0]), np.array([made.p0])
    run = integrate_ensemble(made, method, q, p, h=made.pace.step, steps=50)
    return run.counts["gradient"] / 50


def statistic(found: np.ndarray) -> tuple[float, float]:
    """The mean over orbits, and its standard error; NaN if an orbit ended early."""
    return float(found.mean()), float(found.std(ddof=1) / np.sqrt(len(found)))


def measure_reference(id: str) -> Rows:
    """The exact statistic and its uncertainty, and the ensemble's own: a row."""
    scene = SCENES[id]
    mean, error = statistic(averages(scene, *FINE)[0])
    known = scene.energy is not None
    value = scenes.exact(scene) if known else mean
    row = {"scene": id, "exact": value, "uncertainty": 0.0 if known else error, "known": known}
    return {EXACT: [row | {"mean": mean, "standard error": error}]}


def measure_rows(id: str, method: str) -> Rows:
    """The statistic at every step of the ladder: a row for each."""
    scene = SCENES[id]
    rows, met = [], 0
    exact = scenes.exact(scene) if scene.energy is not None else statistic(averages(scene, *FINE)[0])[0]
    for k in LADDER:
        all_rows, late, evaluations = averages(scene, method, k)
        (mean, error), (mean_late, error_late) = statistic(all_rows), statistic(late)
        ended = int(np.isnan(all_rows).sum())
        row = {"scene": id, "method": method, "symplectic": method in SYMPLECTIC, "k": k, "h": scene.row / k}
        row |= {"evaluations": evaluations / scene.row, "mean": mean, "standard error": error, "ended": ended}
        rows.append(row | {"late": mean_late, "late error": error_late})
        met += abs(mean - exact) + SIGMAS * error <= WANTED * abs(exact)
        if evaluations > MOST or met >= ENOUGH:
            break
    return {TABLE: rows}
