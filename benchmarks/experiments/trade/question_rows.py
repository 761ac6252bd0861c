"""Measure an integrator's errors and times on a scene, from wide steps to round-off, for a run that a user asks for.

A scene is a problem, end time and quantity.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from phasebench.benchmarks.ladder.curves import curves
from phasebench.benchmarks.measure.integrator import OURS, integrator
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.problems.questions import BY_ID, Question
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, content, states
from phasebench.integrators.driver import SKIPPED
from phasebench.integrators.record import Method
from phasebench.integrators.registry import METHODS
from phasebench.reference.peers import Peer

from . import peer_rows

#: The value of the column ``purpose``, as in `list scenes`.
PURPOSE = "trade"


def swept() -> list[Method | Peer]:
    """List all methods, and peers (other packages' integrators), that a user's run can measure."""
    return [*METHODS, *peer_rows.swept()]


def cells(questions: Iterable[Question], only: Callable[[Method | Peer], bool] | None = None) -> list[Cell]:
    """List the measurements (`Cell`), one for each scene and each method or peer for which ``only`` returns True.

    ``questions`` are the scenes; without ``only`` all methods and peers are measured.
    """
    chosen = [m for m in swept() if only is None or only(m)]
    return [_cell(question, m) for question in questions for m in chosen]


def _cell(question: Question, chosen: Method | Peer) -> Cell:
    made = ProblemKey(question.problem)
    return Cell(
        "trade",
        ("rows",),
        {"scene": question.id, "method": chosen.id},
        measure_rows,
        (question.id, chosen.id),
        content("question", chosen, made, states(made.id), question.t_end, question.quantity, code=[__name__]),
        frozenset({question.id, made.id, chosen.id, getattr(chosen, "package", OURS)}),
        ALONE,
    )


def measure_rows(question_id: str, method_id: str) -> Rows:
    """Measure errors and times of an integrator on a scene, over its steps or tolerances.

    The arguments are the ids of the scene and of the method or peer.  Returns {"rows": a row for each step or
    tolerance}, or one row with the reason if the integrator cannot run.
    """
    question = BY_ID[question_id]
    problem, chosen = question.build_problem(), integrator(method_id)
    head = {"scene": question.id, "purpose": PURPOSE}
    lack = chosen.lacks(problem)
    if lack:
        return {"rows": [head | {"problem": problem.label, "method": chosen.label, "status": SKIPPED, "reason": lack}]}
    wanted = quantity(problem, question.quantity)
    return {"rows": [head | row for row in curves(problem, question.t_end, wanted, [chosen])]}
