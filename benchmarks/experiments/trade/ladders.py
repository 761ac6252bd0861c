"""The long scenes once more, for the choice alone: steps wider and finer than a scene's own, and every tolerance.

Nothing but the state at the end is taken, so that a row costs what it says.  A ladder ends where it can no longer
decide who is cheapest: going wider, once the error is beyond every accuracy that is asked for; going finer or tighter,
once it is below all of them, or a run takes LONGEST seconds, many times what the cheapest need for the finest.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from functools import cache

from phasebench.benchmarks.measure.accuracy import head, trajectory_error
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.problems.scenes import BY_ID, DRIFT, SCENES, Scene
from phasebench.benchmarks.rows.cells import ALONE, Cell, Problem, Rows, content, states
from phasebench.integrators.driver import OK

from . import peer_rows, sweep

#: Errors of the state at the end for which the cheapest is named.
ACCURACIES = (1e-3, 1e-6, 1e-9)
#: A step is so many times the one before.
FACTOR = 1.5
#: The tolerances of adaptive peers, as far as each goes.
TOLERANCES = tuple(10.0**-k for k in range(3, 16))
LONGEST, REPEATS = 0.02, 3
TABLE = "trade_ladders"
KIND = "phasebench"


@cache
def integrators() -> tuple[Integrator, ...]:
    """The methods of a sweep and its peers."""
    ours = [integrator(id, **dict(parameters)) for id, parameters in sweep.variants()]
    return (*ours, *(Integrator(p) for p in peer_rows.swept()))


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each integrator on each long regular scene that it can do; none of the quick tier."""
    scenes = [s for s in SCENES if s.purpose == DRIFT and s.regular]
    able = [(s, k) for s in scenes for k, c in enumerate(integrators()) if not (quick or c.lacks(s.made()))]
    return [_cell(*of) for of in able]


def _cell(scene: Scene, position: int) -> Cell:
    c, made = integrators()[position], Problem(scene.problem)
    setting = (scene.id, scene.t_end, scene.steps[0], ACCURACIES)
    return Cell(
        "trade",
        (TABLE,),
        {"scene": scene.id, "method": c.label},
        measured,
        (scene.id, position),
        content("ladders", c.record, made, states(made.id), setting, code=[__name__]),
        frozenset({scene.id, made.id, c.id, c.kind}),
        ALONE,
        own=True,
    )


def measured(scene: str, position: int) -> Rows:
    """The rows of an integrator on a scene."""
    found, c = BY_ID[scene], integrators()[position]
    return {TABLE: list(_tolerances(found, c) if c.adaptive else _steps(found, c))}


def _tolerances(scene: Scene, c: Integrator) -> Iterator[dict]:
    for tol in TOLERANCES:
        if tol < c.record.least:
            return
        yield (row := measure(scene, c, tol=tol))
        if _enough(row):
            return


def _steps(scene: Scene, c: Integrator) -> Iterator[dict]:
    """From the scene's widest step on wider, and of methods of high order, which its table has there alone, finer."""
    base = round(scene.t_end / scene.steps[0])
    yield (first := measure(scene, c, steps=base))
    row, steps = first, base
    while row.get("global_error", float("inf")) <= ACCURACIES[0] and steps > 1:  # a method may be exact at every step
        steps = round(steps / FACTOR)
        yield (row := measure(scene, c, steps=steps))
    row, steps = first, base
    while (c.order or 0) > sweep.HIGH and not _enough(row):
        steps = round(steps * FACTOR)
        yield (row := measure(scene, c, steps=steps))


def _enough(row: dict) -> bool:
    """Whether finer or tighter could not matter."""
    return row.get("global_error", float("inf")) <= ACCURACIES[-1] or row["first run"] > LONGEST


def measure(scene: Scene, c: Integrator, steps: int | None = None, tol: float | None = None) -> dict:
    """The row of an integrator at a number of steps, or at a tolerance."""
    made = scene.made()
    size = {"tol": tol} if steps is None else {"steps": steps}

    def run():
        return c.run(made, t_end=scene.t_end, save_every=0, **size)

    first = run()
    row = head(scene, made, c.record, c.kind, *(() if c.kind == KIND else (c.kind,)))
    row |= {"h": scene.t_end / steps if steps else None, "tol": tol, "status": first.status, "reason": first.reason}
    row |= {"steps": first.counts.get("steps", 0), "first run": first.seconds}
    if first.status != OK:
        return row
    again = [run().seconds for _ in range(REPEATS - 1 if first.seconds < LONGEST else 0)]
    return row | trajectory_error(scene, first) | {"seconds": statistics.median([first.seconds, *again])}
