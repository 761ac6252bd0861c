"""Rows of a user's own on the scenes of the trade: each integrator from where it breaks to round-off, a cell each."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from phasebench.benchmarks.advice import ladder
from phasebench.benchmarks.measure.integrator import OURS, integrator
from phasebench.benchmarks.measure.quantities import quantity
from phasebench.benchmarks.problems.questions import BY_ID, Question
from phasebench.benchmarks.rows.cells import ALONE, Cell, Problem, Rows, content, states
from phasebench.integrators.driver import SKIPPED
from phasebench.integrators.record import Method
from phasebench.integrators.registry import METHODS
from phasebench.reference.peers import Peer

from . import peer_rows

#: What the rows say of their purpose, as `list scenes` does.
PURPOSE = "trade"


def swept() -> list[Method | Peer]:
    """The methods and peers that a run measures."""
    return [*METHODS, *peer_rows.swept()]


def cells(questions: Iterable[Question], only: Callable[[Method | Peer], bool] | None = None) -> list[Cell]:
    """A cell for each method and peer on each scene."""
    chosen = [m for m in swept() if only is None or only(m)]
    return [_cell(question, m) for question in questions for m in chosen]


def _cell(question: Question, chosen: Method | Peer) -> Cell:
    made = Problem(question.problem)
    return Cell(
        "trade",
        ("rows",),
        {"scene": question.id, "method": chosen.id},
        measured,
        (question.id, chosen.id),
        content("question", chosen, made, states(made.id), question.t_end, question.quantity, code=[__name__]),
        frozenset({question.id, made.id, chosen.id, getattr(chosen, "package", OURS)}),
        ALONE,
    )


def measured(question_id: str, method_id: str) -> Rows:
    """The rows of a cell, by table."""
    question = BY_ID[question_id]
    problem, chosen = question.made(), integrator(method_id)
    head = {"scene": question.id, "purpose": PURPOSE}
    lack = chosen.lacks(problem)
    if lack:
        return {"rows": [head | {"problem": problem.label, "method": chosen.label, "status": SKIPPED, "reason": lack}]}
    ask = ladder.asked(problem, question.t_end, quantity(problem, question.quantity))
    return {"rows": [head | row for row in ladder.ladders(ask, [chosen])]}
