"""Error against time of an integrator on any problem: from where it breaks to where its error falls no longer."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import inf
from typing import Any

from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.compilation import FAILED, compilation_error
from phasebench.benchmarks.measure.integrator import OURS, Integrator
from phasebench.benchmarks.measure.quantities import Quantity
from phasebench.integrators.errors import InvalidInput
from phasebench.reference.solvers.taylor import ReferenceFailed

from .ask import Ask
from .portfolio import portfolio
from .trial import MOST, Point, Trial

#: A step is so many times shorter than the one before, a tolerance so many times tighter.
FINER, TIGHTER = 1.6, 10.0
#: The ladder begins at a step that breaks, or an error above this share of the quantity; rungs at most.
BROKEN, RUNGS = 0.3, 40
#: It ends where a run takes longer, in seconds, or so many rungs brought no smaller error.
LONGEST, IDLE = 1.0, 3
#: The loosest tolerance, and the coarsest number of steps.
LOOSEST, FEWEST = 1e-1, 4
#: Of each side as many are taken where none is named.
CHOSEN = 4
#: For the expectation of whom to take: an accuracy in the middle.
MIDDLE = 1e-6


def asked(problem, t_end: float, quantity: Quantity) -> Ask:
    """The question that a ladder answers at every accuracy."""
    return Ask(problem, t_end, quantity, MIDDLE, None, (), LONGEST, lambda line: None)


def chosen(ask: Ask) -> list[Integrator]:
    """A few of each side that are to be expected to be cheap on a problem."""
    members = [i for i, _ in portfolio(ask, MIDDLE)[0]]
    own, others = ([i for i in members if (i.kind == OURS) is side][:CHOSEN] for side in (True, False))
    return [*own, *others]


def ladders(
    ask: Ask, integrators: Sequence[Integrator], progress: Callable[[str], None] = lambda line: None
) -> list[dict[str, Any]]:
    """The rows of integrators on a problem: problem, method, steps, h or tol, error, seconds, status, reason.

    Raises
    ------
    InvalidInput
        Where there is no reference, or an integrator cannot do the problem.
    """
    try:
        true = truths.truth(ask.problem, ask.quantity, ask.t_end)
    except ReferenceFailed as error:
        raise InvalidInput(f"there is no reference of {ask.problem.label} to t = {ask.t_end:g}: {error}") from None
    rows = []
    for integrator in integrators:
        lack = integrator.lacks(ask.problem)
        if lack:
            raise InvalidInput(lack)
        progress(integrator.label)
        trial = Trial(integrator, ask, true, 2 * LONGEST)
        rows += [_row(trial, point) for point in _points(trial)]
    return rows


def _points(trial: Trial) -> list[Point]:
    """The rungs; of an integrator that does not compile one point, with the status `FAILED` and the reason."""
    try:
        return list(rungs(trial))
    except Exception as error:
        why = compilation_error(error)
        if why is None:
            raise
        return [Point({}, inf, inf, 0, FAILED, why)]


def _row(trial: Trial, point: Point) -> dict[str, Any]:
    ask, steps = trial.ask, point.size.get("steps")
    return {
        "problem": ask.problem.label,
        "t_end": ask.t_end,
        "quantity": ask.quantity.name,
        "method": trial.integrator.label,
        "id": trial.integrator.id,
        "kind": trial.integrator.kind,
        "h": ask.t_end / steps if steps else None,
        "tol": point.size.get("tol"),
        "steps": point.steps,
        "error": point.error,
        "uncertainty": trial.true.uncertainty,
        "seconds": point.seconds,
        "shared": trial.sharing.told(),
        "status": point.status,
        "reason": point.reason,
    }


def rungs(trial: Trial) -> Iterator[Point]:
    """The runs of a trial, the coarsest first."""
    adaptive, best, idle = trial.integrator.adaptive, float("inf"), 0
    size = LOOSEST if adaptive else float(FEWEST)
    seen: set[float] = set()
    for _ in range(RUNGS):
        at = size if adaptive else float(trial.ask.quantity.steps(size))
        if at not in seen:
            seen.add(at)
            point = trial.at(at)
            yield point
            idle = idle + 1 if point.ok and point.error > 0.7 * best and best < BROKEN else 0
            best = min(best, point.error)
            if idle >= IDLE or point.seconds > LONGEST or point.error == 0:
                return
        size = size / TIGHTER if adaptive else size * FINER
        if (adaptive and size < trial.integrator.record.least) or size > MOST:
            return


__all__ = ["asked", "chosen", "ladders", "rungs"]
