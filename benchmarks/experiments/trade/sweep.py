"""METHODS and peers x SCENES -> tidy rows: one for each (scene, method, parameters, h or tolerance).

A row has both error columns: ``global_error``, the maximum norm of (q, p) at ``global_error_time`` against the
reference, with the reference's own uncertainty there; and ``refinement_difference``, against the same method at twice
the step, which is what the talk's tables print.  ``seconds`` is the median of warm integrations without output.

Errors and invariants are those of `accuracy`; how peers are measured is in `peer_rows`.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.measure.accuracy import end_state, head, invariants, trajectory_error
from phasebench.benchmarks.measure.integrator import OURS, integrator
from phasebench.benchmarks.problems.scenes import BY_ID, DRIFT, ORDER, SCENES, Scene
from phasebench.benchmarks.rows.cells import ALONE, Cell, Problem, Rows, content, states
from phasebench.integrators.driver import OK, SKIPPED, Solution, integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import Method
from phasebench.integrators.registry import METHODS, method
from phasebench.reference.peers import Peer

from . import peer_rows

#: The talk's values of lambda, for the schemes that it tabulates over lambda.
LAMBDAS = ("-1", "1/3", "3/2", "2")
TABULATED = ("scheme-i", "scheme-ii", "scheme-iii")
REPEATS = 3
#: Methods of a higher order run the long scenes at the largest step only: at smaller ones they show round-off.
HIGH = 4
#: A run of more seconds is not repeated for its time.
LONG = 1.0
#: The handful of the quick tier.
HANDFUL_SCENES = ("kepler-t1",)
HANDFUL = ("explicit-euler", "stormer-verlet", "rk4", "pefrl", "implicit-midpoint", "heyoka", "rebound-leapfrog")


@dataclass(frozen=True)
class Task:
    """One row to be measured; plain text and numbers, so that it can travel to another process."""

    scene: str
    method: str
    parameters: tuple[tuple[str, str], ...]
    h: float | None
    quick: bool = False
    tol: float | None = None

    def made(self) -> Method | Peer:
        """The method with its parameters, or the peer."""
        return integrator(self.method, **dict(self.parameters)).record


def variants(methods: Iterable[Method] = METHODS) -> Iterator[tuple[str, tuple[tuple[str, str], ...]]]:
    """(id, parameters) of every method, the tabulated schemes at the talk's values of lambda."""
    for m in methods:
        if m.id in TABULATED:
            yield from ((m.id, (("lam", lam),)) for lam in LAMBDAS)
        elif "order" in m.parameters:
            yield from ((m.id, (("order", str(r)),)) for r in (3, 4))
        else:
            yield m.id, ()


def tasks(
    scenes: Iterable[Scene] = SCENES, quick: bool = False, only: Callable[[Method | Peer], bool] | None = None
) -> list[Task]:
    """The rows of a sweep, in the order in which they are measured: of each scene the methods, then the peers.

    ``only`` chooses among all; without it a quick sweep has a few of the peers.
    """
    found = []
    for scene in scenes:
        for id, parameters in variants():
            chosen = method(id)
            if only is None or only(chosen):
                steps = scene.ladder(quick)
                if scene.purpose == DRIFT and chosen.order > HIGH:
                    steps = steps[:1]
                found += [Task(scene.id, id, parameters, h, quick) for h in steps]
        for peer in peer_rows.swept(quick and only is None):
            if only is None or only(peer):
                found += [Task(scene.id, peer.id, (), h, quick, tol) for h, tol in peer_rows.sizes(peer, scene, quick)]
    return found


@cache
def _twice(scene: str, id: str, parameters: tuple, h: float) -> np.ndarray | None:
    """The end state at twice the step, for the refinement difference."""
    made = BY_ID[scene]
    found = integrate(
        made.made(),
        method(id, **dict(parameters)),
        t_end=made.t_end,
        steps=max(1, round(made.t_end / (2 * h))),
        save_every=0,
    )
    return end_state(found) if found.status == OK else None


def measure(task: Task, repeats: int = REPEATS) -> dict[str, Any]:
    """The row of a task."""
    scene, chosen = BY_ID[task.scene], task.made()
    tier = {"tier": "quick" if task.quick else "full"}
    if isinstance(chosen, Peer):
        return peer_rows.measure(scene, chosen, task.h, task.tol, repeats) | tier
    problem = scene.made()
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
    runs = [solution.seconds]
    if solution.seconds < LONG:
        runs += [
            integrate(problem, chosen, h=task.h, t_end=scene.t_end, save_every=0).seconds for _ in range(repeats - 1)
        ]
    return row | {"seconds": statistics.median(runs)}


def _errors(scene: Scene, task: Task, solution: Solution) -> dict[str, float]:
    out = trajectory_error(scene, solution)
    if scene.purpose == ORDER and task.h < scene.steps[0]:
        twice = _twice(task.scene, task.method, task.parameters, task.h)
        if twice is not None:
            out["refinement_difference"] = float(metrics.refinement_difference(twice, end_state(solution)))
    return out


def run(todo: list[Task], repeats: int = REPEATS) -> list[dict[str, Any]]:
    """The rows of tasks."""
    return [measure(task, repeats) for task in todo]


def measured(todo: tuple[Task, ...], repeats: int) -> Rows:
    """The rows of a cell, by table."""
    return {"rows": run(list(todo), repeats)}


def cells(
    quick: bool = False, scenes: Iterable[Scene] = SCENES, only: Callable[[Method | Peer], bool] | None = None
) -> list[Cell]:
    """A cell for each method and peer on each scene, with its rows over the steps or tolerances."""
    groups: dict[tuple[str, str, tuple], list[Task]] = {}
    for task in tasks(scenes, quick, only or (lambda chosen: True)):
        groups.setdefault((task.scene, task.method, task.parameters), []).append(task)
    return [_cell(tuple(members), quick) for members in groups.values()]


def _cell(todo: tuple[Task, ...], quick: bool) -> Cell:
    scene, chosen = BY_ID[todo[0].scene], todo[0].made()
    made = Problem(scene.problem)
    setting = (scene.id, scene.purpose, scene.t_end, scene.regular, *((t.h, t.tol) for t in todo))
    return Cell(
        "trade",
        ("rows",),
        {"scene": scene.id, "method": chosen.label},
        measured,
        (todo, 1 if quick else REPEATS),
        content("rows", quick, chosen, made, states(made.id), setting, code=[__name__]),
        frozenset({scene.id, scene.problem.partition(":")[0], chosen.id, getattr(chosen, "package", OURS)}),
        ALONE,
        quick=scene.id in HANDFUL_SCENES and chosen.id in HANDFUL,
    )


def orders(rows: list[dict[str, Any]], column: str = "global_error") -> list[dict[str, Any]]:
    """The measured order of each (scene, method) of the order scenes, with its window and 95 % interval.

    Only ``ok`` rows of a fixed step above the noise (the reference's uncertainty and round-off) enter.
    """
    groups: dict[tuple[str, str], list[dict]] = {}
    for r in rows:
        if r["purpose"] == ORDER and r["status"] == OK and r.get(column) is not None and r["h"] is not None:
            groups.setdefault((r["scene"], r["method"]), []).append(r)
    out = []
    for (scene, label), members in groups.items():
        members.sort(key=lambda r: -r["h"])
        noise = 100 * max(np.finfo(float).eps * 4, *(r["reference_uncertainty"] for r in members))
        found = metrics.order([r["h"] for r in members], [r[column] for r in members], noise=noise)
        out.append(
            {
                "scene": scene,
                "problem": members[0]["problem"],
                "method": label,
                "kind": members[0].get("kind", OURS),
                "declared": members[0]["declared_order"],
                "order": found.value,
                "low": found.low,
                "high": found.high,
                "points": found.points,
                "h_first": found.first,
                "h_last": found.last,
            }
        )
    return out


__all__ = ["DRIFT", "LAMBDAS", "ORDER", "Task", "cells", "measure", "orders", "run", "tasks", "variants"]
