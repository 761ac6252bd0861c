"""Which integrator for which accuracy: the front of every scene, and a few scenes once more."""

from __future__ import annotations

from functools import cache
from types import ModuleType

from phasebench.benchmarks.experiments.trade import again, field, front, retime
from phasebench.benchmarks.problems.questions import BY_ID, QUESTIONS, Question
from phasebench.benchmarks.rows.cells import ALONE, Cell, Problem, content, exact, states


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each scene, and before them, since they are the cheap ones, for each that is measured twice.

    After them one for each further sweep of the finals that are stored; those of finals that this run measures anew are
    of the next run.
    """
    if quick:
        return []
    second = [_cell(BY_ID[id], (again.TABLE,), again) for id in again.scenes()]
    first = [_cell(q, front.TABLES, front) for q in QUESTIONS]
    return second + first + [_later(q, k) for k in retime.SWEEPS for q in QUESTIONS if retime.finals(q.id)]


def _later(question: Question, sweep: int) -> Cell:
    finals, made = retime.finals(question.id), Problem(question.problem)
    return Cell(
        "trade",
        (retime.TABLE,),
        {"scene": question.id, "sweep": sweep},
        retime.measured,
        (question.id, sweep, finals),
        content(_competitors(retime.__name__), made, exact((question.id, question.t_end, sweep, finals))),
        frozenset({question.id, made.id}),
        ALONE,
        own=True,
    )


@cache
def _competitors(code: str) -> str:
    return content("front", *(c.record for c in field.competitors()), code=[code])


def _cell(question: Question, tables: tuple[str, ...], sweep: ModuleType) -> Cell:
    made = Problem(question.problem)
    asked = (question.id, question.t_end, question.quantity, question.accuracies)
    return Cell(
        "trade",
        tables,
        {"scene": question.id},
        sweep.measured,
        (question.id,),
        content(_competitors(sweep.__name__), made, states(made.id), exact(asked)),
        frozenset({question.id, made.id}),
        ALONE,
        own=True,
    )


def bench_front(measured):
    """Whoever is named meets the accuracy, and has a time with an interval about it."""
    rows = measured(front.FINALS) + measured(again.TABLE)
    wrong = [r for r in rows if not (r["error"] <= r["accuracy"] and 0 < r["low"] <= r["seconds"] <= r["high"])]
    assert not wrong, wrong
