"""Work-precision curves: rows of error against time, from the coarsest steps until the error no longer falls.

The runs of one integrator are those of a `climb`; they do not depend on other integrators.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import dropwhile
from math import inf
from typing import Any

from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.compilation import FAILED, compilation_error
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.quantities import Quantity, Truth
from phasebench.benchmarks.problems.base import Problem
from phasebench.integrators.errors import InvalidInput
from phasebench.reference.solvers.taylor import ReferenceFailed

from .climb import climb, idle, numbers_of_steps, tolerances
from .rung import Rung, Task
from .trial import MOST, Trial

#: Ratio of successive numbers of steps.
FINER = 1.6
#: Rungs before the first with an error below this share of the quantity have steps that are too wide, and do not count.
BROKEN = 0.3
#: A climb ends if a run takes more than `LONGEST` seconds, or if `IDLE` rungs brought no smaller error.
LONGEST, IDLE = 1.0, 3
#: The loosest tolerance, and the coarsest number of steps.
LOOSEST, FEWEST = 1e-1, 4


def curves(
    problem: Problem,
    t_end: float,
    quantity: Quantity,
    integrators: Sequence[Integrator],
    progress: Callable[[str], None] = lambda line: None,
    true: Truth | None = None,
) -> list[dict[str, Any]]:
    """Measure work-precision curves: a row for each integrator and number of steps or tolerance.

    ``true`` is the true value of the quantity; by default it is looked up, or computed.  Raises InvalidInput if there
    is no reference solution, or an integrator is not applicable to the problem.
    """
    try:
        true = truths.truth(problem, quantity, t_end) if true is None else true
    except ReferenceFailed as error:
        raise InvalidInput(f"there is no reference of {problem.label} to t = {t_end:g}: {error}") from None
    rows = []
    for integrator in integrators:
        lack = integrator.lacks(problem)
        if lack:
            raise InvalidInput(lack)
        progress(integrator.label)
        trial = Trial(integrator, Task(problem, t_end, quantity, true), 2 * LONGEST)
        rows += [_row(trial, rung) for rung in _rungs(trial)]
    return rows


def _rungs(trial: Trial) -> list[Rung]:
    """Run an integrator from coarse to fine; one run of status `FAILED`, with the reason, if it does not compile."""
    try:
        return rungs(trial)
    except Exception as error:
        why = compilation_error(error)
        if why is None:
            raise
        return [Rung(None, None, FAILED, inf, inf, reason=why)]


def rungs(trial: Trial) -> list[Rung]:
    """Run an integrator at ever more steps or tighter tolerances until its error no longer falls."""
    if trial.integrator.adaptive:
        sizes = tolerances(LOOSEST, trial.integrator.record.least)
    else:
        sizes = numbers_of_steps(FEWEST, FINER, trial.task.quantity.steps, MOST)
    return climb(sizes, trial.at, _end_reason)[0]


def _end_reason(rungs: Sequence[Rung]) -> str:
    last = rungs[-1]
    if last.seconds > LONGEST:
        return "a run takes too long"
    told = dropwhile(lambda error: error >= BROKEN, (r.error for r in rungs if r.ok))
    return "its error falls no longer" if last.error == 0 or idle(told) >= IDLE else ""


def _row(trial: Trial, rung: Rung) -> dict[str, Any]:
    task = trial.task
    return {
        "problem": task.problem.label,
        "t_end": task.t_end,
        "quantity": task.quantity.name,
        "method": trial.integrator.label,
        "id": trial.integrator.id,
        "kind": trial.integrator.kind,
        "h": task.t_end / rung.steps if rung.steps else None,
        "tol": rung.tol,
        "steps": rung.taken,
        "error": rung.error,
        "uncertainty": task.truth.uncertainty,
        "seconds": rung.seconds,
        "shared": task.clocks.sharing.summary(),
        "status": rung.status,
        "reason": rung.reason,
    }
