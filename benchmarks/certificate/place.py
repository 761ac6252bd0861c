"""The place of an integrator on two fronts of the trade: its evaluations over the fewest that are stored at its error.

A ladder of steps (or of tolerances) is run on a scene to its end, the number of steps doubled from rung to rung, until
the error is below the smallest that is compared, no longer falls, or a run would need more than `MOST` evaluations.
Evaluations are of the gradient by q or by p, whichever are more: they are what a step asks for, and the same whenever
it is run.  What it takes in time: `times`.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, isfinite

import numpy as np

from phasebench.benchmarks.measure import own_step, truths
from phasebench.benchmarks.measure.quantities import END_STATE
from phasebench.integrators.driver import OK
from phasebench.integrators.errors import InvalidInput

from . import fronts
from .battery import Entry
from .order import numerical
from .stepping import StepFailed, Stepper, told
from .subject import Subject
from .verdicts import Tables

#: The evaluations of the longest run, and so many rungs that bring nothing end a ladder.
MOST, IDLE = 40_000, 2
#: The widest step, in units of the problem's own.
WIDEST = 4.0
#: Those of an adaptive integrator.
TOLERANCES = tuple(10.0**-k for k in range(2, 14))


def scenes(subject: Subject) -> list[str]:
    """The first and the last of the stored scenes that it can do."""
    if set(subject.own.requires) & set(fronts.OTHER_WORK):
        return []
    able = [
        s for s in fronts.SCENES if s in fronts.stored() and subject.lacks(fronts.question(s).made().system) is None
    ]
    return able[:1] + able[1:][-1:]


def place(subject: Subject, scene: str) -> dict:
    """A row: for each error the evaluations that the integrator needs, and the cheapest stored."""
    question = fronts.question(scene)
    problem = question.made()
    entry = Entry(scene, problem.system, (*problem.q0, *problem.p0))
    truth = truths.truth(problem, END_STATE, question.t_end).values
    sizes = _tolerances() if subject.adaptive else _steps(question.t_end / (WIDEST * problem.pace.step))
    runs: list[tuple[float, float]] = []
    taken: list[float] = []
    for size in sizes:
        evaluations, end = measured(subject, entry, problem, question.t_end, size)
        off = inf if end is None else float(np.abs(end - truth).max())
        runs.append((evaluations, off if isfinite(off) else inf))
        taken.append(size)
        if _ended(runs) or 2 * max(evaluations, 0 if subject.adaptive else size) > MOST:
            break
    row: dict = {"on": scene, "problem": question.problem, "t_end": question.t_end, "about": question.about}
    row |= {"curve": [[x, e] for x, e in runs if isfinite(e)], "errors": []}
    row["sizes"] = [size for size, (_, e) in zip(taken, runs, strict=True) if isfinite(e)]
    for error, best in fronts.stored()[scene].items():
        mine = fronts.needed(runs, error)
        found = {"error": error, "evaluations": mine, "cheapest": best.integrator, "its evaluations": best.evaluations}
        row["errors"].append(found | {"factor": None if mine is None else mine / best.evaluations})
    return row


def measured(subject: Subject, entry: Entry, problem, t_end: float, size: float):
    """(evaluations, state at the end, or None) of a run of so many steps, or at that tolerance."""
    run = _registered if subject.integrator is not None else _tolerance if subject.adaptive else own
    return run(subject, entry, problem, t_end, size)


def _steps(first: float) -> Iterator[int]:
    steps = max(1, round(first))
    while True:
        yield steps
        steps *= 2


def _tolerances() -> Iterator[float]:
    return iter(TOLERANCES)


def own(subject: Subject, entry: Entry, problem, t_end: float, steps: int):
    """(evaluations, state at the end) of a step; None where the numbers do not come to it."""
    stepper = Stepper(subject, entry)
    try:
        rows = stepper.run(np.array(entry.state), t_end / steps, steps, every=steps)
    except StepFailed as failure:
        if not numerical(failure):
            raise
        rows = ()
    return float(max(stepper.system.evaluations)), rows[-1] if len(rows) == 2 else None


def _tolerance(subject: Subject, entry: Entry, problem, t_end: float, tol: float):
    """The same of an adaptive integrator."""
    system, y, d = own_step.System(entry.system), np.array(entry.state), entry.system.d
    with told(subject, f"the run on {entry.name} with tol = {tol:g}"):
        pair = subject.run(system, y[:d], y[d:], t_end, tol)
    try:
        return float(max(system.evaluations)), np.concatenate(own_step.returned(pair, d))
    except InvalidInput as error:
        raise StepFailed(str(error)) from None


def _registered(subject: Subject, entry: Entry, problem, t_end: float, size: float):
    """The same of a method or a peer, which counts its evaluations itself."""
    wanted = {"tol": max(size, subject.integrator.record.least)} if subject.adaptive else {"steps": size}
    end = subject.integrator.run(problem, t_end=t_end, save_every=0, **wanted)
    state = np.concatenate([end.q[-1], end.p[-1]]) if end.status == OK else None
    return float(end.counts.get("gradient", 0)), state


def _ended(runs) -> bool:
    """Whether the smallest error that is compared is met, or the last rungs brought nothing after others did."""
    errors = [e for _, e in runs]
    if errors[-1] <= fronts.ERRORS[-1]:
        return True
    best = min(errors)
    return best < fronts.ERRORS[0] and len(errors) - 1 - errors.index(best) >= IDLE


def placed(tables: Tables) -> list[str]:
    """A line a scene: how many times the fewest stored evaluations it takes."""
    return [f"evaluations on {row['on']}: {_told(row['errors'])}" for row in tables.of("place")]


def _told(errors: list[dict]) -> str:
    met = [e for e in errors if e["factor"] is not None]
    if not met:
        return f"none of the errors that are compared is met, from {errors[0]['error']:.0e} on"
    times = [f"{e['factor']:.2g} times" for e in met]
    times[0] += " the fewest stored"
    factors = ", ".join(f"{t} for an error of {e['error']:.0e}" for t, e in zip(times, met, strict=True))
    return factors + ("; smaller errors are not met" if len(met) < len(errors) else "")
