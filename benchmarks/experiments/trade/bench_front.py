"""Measure the fastest integrators of every scene (problem, end time, quantity) at every accuracy; check the rows."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import ModuleType

from phasebench.benchmarks.experiments.trade import again, field, front, retime
from phasebench.benchmarks.problems.questions import BY_ID, QUESTIONS, Question
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, content, exact, states


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`) of the fastest integrators of all scenes; none if ``quick``.

    A scene is a problem, end time and quantity.  Some scenes are measured a second time from scratch, which comes first
    in the list; then all scenes; last, the few fastest integrators of each scene, as an earlier run stored them, are
    timed again.
    """
    if quick:
        return []
    second = [_cell(BY_ID[id], (again.TABLE,), again) for id in again.scenes()]
    first = [_cell(q, front.TABLES, front) for q in QUESTIONS]
    return second + first + [_later(q, k) for k in retime.SWEEPS for q in QUESTIONS if retime.finals(q.id)]


def _later(question: Question, sweep: int) -> Cell:
    finals, made = retime.finals(question.id), ProblemKey(question.problem)
    return Cell(
        "trade",
        (retime.TABLE,),
        {"scene": question.id, "sweep": sweep},
        retime.measure_rows,
        (question.id, sweep, finals),
        content(
            "front", exact((question.id, question.t_end, sweep, finals)), made, *_competitors(), code=[retime.__name__]
        ),
        frozenset({question.id, made.id}),
        ALONE,
        own=True,
    )


@cache
def _competitors() -> tuple:
    return tuple(c.record for c in field.competitors())


def _cell(question: Question, tables: tuple[str, ...], sweep: ModuleType) -> Cell:
    made = ProblemKey(question.problem)
    asked = (question.id, question.t_end, question.quantity, question.accuracies)
    return Cell(
        "trade",
        tables,
        {"scene": question.id},
        sweep.measure_rows,
        (question.id,),
        content("front", exact(asked), made, states(made.id), *_competitors(), code=[sweep.__name__]),
        frozenset({question.id, made.id}),
        ALONE,
        own=True,
    )


def bench_front(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that every finalist (an integrator timed at an accuracy) meets it, and that its time is in its interval.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    rows = measured_rows(front.FINALS) + measured_rows(again.TABLE)
    wrong = [r for r in rows if not (r["error"] <= r["accuracy"] and 0 < r["low"] <= r["seconds"] <= r["high"])]
    assert not wrong, wrong
