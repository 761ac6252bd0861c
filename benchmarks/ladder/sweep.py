"""Measure all methods and peers on all scenes: a row for each (scene, method, parameters, h or tolerance).

A scene is a problem, a time span and a list of steps; peers are integrators of other packages.

A row has two error columns: ``global_error``, the maximum norm over (q, p) of the difference from the reference at
``global_error_time``, with the reference's uncertainty there; and ``refinement_difference``, the difference from the
same method at twice the step.  ``seconds`` is the median of warm integrations without output; a long
integration is timed only once.

Errors and invariants come from `accuracy`; peers are measured by `peer_rows`.  Scenes on which costs are compared
(`questions`) have no list of steps: there an integrator runs from wide steps to round-off.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.measure.accuracy import end_state, head, invariants, trajectory_error
from phasebench.benchmarks.measure.integrator import OURS, integrator
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.measure.variants import variants
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.questions import BY_ID as QUESTIONS
from phasebench.benchmarks.problems.questions import Question
from phasebench.benchmarks.problems.scenes import BY_ID, DRIFT, ORDER, SCENES, Scene
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, content, states
from phasebench.integrators.driver import OK, SKIPPED, Solution, integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import Method
from phasebench.integrators.registry import METHODS, method
from phasebench.reference.peers import Peer

from . import peer_rows
from .curves import curves

REPEATS = 3
#: The value of the column ``purpose`` of a scene on which costs are compared, as in `list scenes`.
PURPOSE = "trade"
#: On long scenes, methods of a higher order run only at the largest step: at smaller ones they show round-off.
HIGH = 4
#: A run of more seconds than this is timed only once.
LONG = 1.0
#: The scenes and the integrators of the quick tier.
HANDFUL_SCENES = ("kepler-t1",)
HANDFUL = ("explicit-euler", "stormer-verlet", "rk4", "pefrl", "implicit-midpoint", "heyoka", "rebound-leapfrog")


@dataclass(frozen=True)
class Task:
    """One row to be measured, as data that can be sent to another process; of h and tol one is None."""

    scene: str
    method: str
    parameters: tuple[tuple[str, str], ...]
    h: float | None
    quick: bool = False
    tol: float | None = None

    def build(self) -> Method | Peer:
        """The method with its parameters, or the peer, of this task."""
        return integrator(self.method, parameters=dict(self.parameters)).record


def tasks(
    scenes: Iterable[Scene] = SCENES, quick: bool = False, only: Callable[[Method | Peer], bool] | None = None
) -> list[Task]:
    """The rows to be measured: for each scene the methods, then the peers; ``only`` selects among these."""
    found = []
    for scene in scenes:
        for id, parameters in variants():
            chosen = method(id)
            if only is None or only(chosen):
                steps = scene.ladder(quick)
                if scene.purpose == DRIFT and chosen.order > HIGH:
                    steps = steps[:1]
                found += [Task(scene.id, id, parameters, h, quick) for h in steps]
        for peer in peer_rows.swept():
            if only is None or only(peer):
                found += [Task(scene.id, peer.id, (), h, quick, tol) for h, tol in peer_rows.sizes(peer, scene, quick)]
    return found


@cache
def _twice(scene: str, id: str, parameters: tuple, h: float) -> np.ndarray | None:
    """The end state (q, p), array (2 d,), of a method with the step 2 h; None if the run fails."""
    of = BY_ID[scene]
    found = integrate(
        problem_of(of.problem),
        method(id, **dict(parameters)),
        t_end=of.t_end,
        steps=max(1, round(of.t_end / (2 * h))),
        save_every=0,
    )
    return end_state(found) if found.status == OK else None


def measure(task: Task, repeats: int = REPEATS) -> dict[str, Any]:
    """The row of a task: errors, invariants, and time as the median of up to ``repeats`` runs."""
    scene, chosen = BY_ID[task.scene], task.build()
    tier = {"tier": "quick" if task.quick else "full"}
    if isinstance(chosen, Peer):
        return peer_rows.measure(scene, chosen, task.h, task.tol, repeats) | tier
    problem = problem_of(scene.problem)
    row = head(scene, problem, chosen, OURS) | {"h": task.h} | tier
    lack = chosen.lacks(problem.system)
    if lack:
        return row | {"status": SKIPPED, "reason": lack}
    try:
        solution = integrate(problem, chosen, h=task.h, t_end=scene.t_end)
    except InvalidInput as error:
        return row | {"status": "invalid", "reason": str(error)}
    row |= {"status": solution.status, "reason": solution.reason} | solution.counts
    row |= invariants(problem, solution, scene.t_end)
    if solution.status != OK:
        return row
    row |= _errors(scene, task, solution)
    timed = {"h": task.h, "t_end": scene.t_end, "save_every": 0}
    runs = [integrate(problem, chosen, **timed).seconds for _ in range(repeats if solution.seconds < LONG else 1)]
    return row | {"seconds": statistics.median(runs)}


def _errors(scene: Scene, task: Task, solution: Solution) -> dict[str, float]:
    out = trajectory_error(scene, solution)
    if scene.purpose == ORDER and task.h < scene.steps[0]:
        twice = _twice(task.scene, task.method, task.parameters, task.h)
        if twice is not None:
            out["refinement_difference"] = float(metrics.refinement_difference(twice, end_state(solution)))
    return out


def measure_rows(todo: Iterable[Task], repeats: int) -> Rows:
    """Measure tasks one after the other, each timed ``repeats`` times: {"rows": a row for each}."""
    return {"rows": [measure(task, repeats) for task in todo]}


def cells(
    quick: bool = False, scenes: Iterable[Scene] = SCENES, only: Callable[[Method | Peer], bool] | None = None
) -> list[Cell]:
    """A measurement of each integrator that ``only`` selects on each scene, over its steps or tolerances."""
    groups: dict[tuple[str, str, tuple], list[Task]] = {}
    for task in tasks(scenes, quick, only):
        groups.setdefault((task.scene, task.method, task.parameters), []).append(task)
    return [_cell(tuple(members), quick) for members in groups.values()]


def _cell(todo: tuple[Task, ...], quick: bool) -> Cell:
    scene, chosen = BY_ID[todo[0].scene], todo[0].build()
    made = ProblemKey(scene.problem)
    setting = (scene.id, scene.purpose, scene.t_end, scene.regular, *((t.h, t.tol) for t in todo))
    return Cell(
        "trade",
        ("rows",),
        {"scene": scene.id, "method": chosen.label},
        measure_rows,
        (todo, 1 if quick else REPEATS),
        content("rows", quick, chosen, made, states(made.id), setting, code=[__name__]),
        frozenset({scene.id, made.id, chosen.id, getattr(chosen, "package", OURS)}),
        ALONE,
        quick=scene.id in HANDFUL_SCENES and chosen.id in HANDFUL,
    )


# -- scenes on which costs are compared --------------------------------------------------------------------------------


def swept() -> list[Method | Peer]:
    """All methods and peers that a user's run can measure."""
    return [*METHODS, *peer_rows.swept()]


def question_cells(questions: Iterable[Question], only: Callable[[Method | Peer], bool] | None = None) -> list[Cell]:
    """A measurement of each integrator that ``only`` selects on each scene, from wide steps to round-off."""
    return [_question_cell(question, m) for question in questions for m in swept() if only is None or only(m)]


def _question_cell(question: Question, chosen: Method | Peer) -> Cell:
    made = ProblemKey(question.problem)
    return Cell(
        "trade",
        ("rows",),
        {"scene": question.id, "method": chosen.id},
        measure_question,
        (question.id, chosen.id),
        content("question", chosen, made, states(made.id), question.t_end, question.quantity, code=[__name__]),
        frozenset({question.id, made.id, chosen.id, getattr(chosen, "package", OURS)}),
        ALONE,
    )


def measure_question(question_id: str, method_id: str) -> Rows:
    """{"rows": a row for each step or tolerance of an integrator on a scene, or one that says why it cannot run}."""
    question = QUESTIONS[question_id]
    problem, chosen = question.build_problem(), integrator(method_id)
    head = {"scene": question.id, "purpose": PURPOSE}
    lack = chosen.lacks(problem)
    if lack:
        return {"rows": [head | {"problem": problem.label, "method": chosen.label, "status": SKIPPED, "reason": lack}]}
    wanted = quantity(problem, question.quantity)
    return {"rows": [head | row for row in curves(problem, question.t_end, wanted, [chosen])]}
