"""How many gradient evaluations an integrator needs for an error, relative to the fewest known (`fronts`).

On each of two scenes (a problem, a span and the end state as the quantity) the integrator runs to the end with ever
doubled numbers of steps (or ever smaller tolerances), until the error is below the smallest that is compared, no longer
falls, or a run would need more than `MOST` evaluations.  Evaluations are those of the gradient by q or by p, whichever
are more; unlike times (`times`) they do not depend on the machine.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import NamedTuple

import numpy as np

from phasebench.benchmarks.ladder.bracket import evaluations_for
from phasebench.benchmarks.ladder.climb import climb, idle, numbers_of_steps, tolerances
from phasebench.benchmarks.measure import own_step, truths
from phasebench.benchmarks.measure.quantities import END_STATE
from phasebench.benchmarks.problems.base import Problem
from phasebench.benchmarks.problems.questions import BY_ID as QUESTIONS
from phasebench.benchmarks.problems.questions import Question
from phasebench.integrators.driver import OK

from . import adaptive, fronts
from .battery import Entry
from .stepping import Stepper, numerical_failures
from .subject import Subject

#: The most evaluations of a run; the number of runs without a smaller error that ends a ladder.
MOST, IDLE = 40_000, 2
#: The widest step, in units of the problem's usual step (`Pace.step`).
WIDEST = 4.0
#: The tolerances of an adaptive integrator.
LOOSEST, TIGHTEST = 1e-2, 1e-13


class Run(NamedTuple):
    """A run of ``size`` steps, or at this tolerance; its error is infinite if it did not reach the end."""

    size: float
    evaluations: float
    error: float


def scenes(subject: Subject) -> list[str]:
    """Return the ids of the first and the last stored scene (problem, span, quantity) that an integrator can run."""
    if set(subject.own.requires) & set(fronts.OTHER_WORK):
        return []
    stored = [scene for scene in fronts.SCENES if scene in fronts.TABLE.load()]
    able = [scene for scene in stored if subject.lacks(scene_parts(scene)[1].system) is None]
    return able[:1] + able[1:][-1:]


def scene_parts(scene: str) -> tuple[Question, Problem, Entry]:
    """The question of a scene, its problem, and this as a system with its initial state."""
    question = QUESTIONS[scene]
    problem = question.build_problem()
    return question, problem, Entry(scene, problem.system, (*problem.q0, *problem.p0))


def place(subject: Subject, scene: str) -> dict:
    """Compare the integrator's gradient evaluations on a scene with the fewest stored ones, at several errors: a row.

    ``curve`` are (evaluations, error) of the runs that reached the end, ``sizes`` their steps or tolerances; each of
    ``errors`` has the evaluations needed (None if it is not met), the fewest stored ones, and their ratio (``factor``).
    """
    question, problem, entry = scene_parts(scene)
    truth = truths.truth(problem, END_STATE, question.t_end).values
    widest = max(1, round(question.t_end / (WIDEST * problem.pace.step)))
    sizes = tolerances(LOOSEST, TIGHTEST) if subject.adaptive else numbers_of_steps(widest, 2)

    def run(size: float) -> Run:
        evaluations, end = run_subject(subject, entry, problem, question.t_end, size)
        error = inf if end is None else float(np.abs(end - truth).max())
        return Run(size, evaluations, error if isfinite(error) else inf)

    runs, _ = climb(sizes, run, lambda runs: end_reason(runs, subject.adaptive))
    arrived = [r for r in runs if isfinite(r.error)]
    row: dict = {"on": scene, "problem": question.problem, "t_end": question.t_end, "about": question.about}
    row |= {"curve": [[r.evaluations, r.error] for r in arrived], "errors": [], "sizes": [r.size for r in arrived]}
    for error, best in fronts.TABLE.load()[scene].items():
        mine = evaluations_for(((r.evaluations, r.error) for r in arrived), error)
        found = {"error": error, "evaluations": mine, "cheapest": best.integrator, "its evaluations": best.evaluations}
        row["errors"].append(found | {"factor": None if mine is None else mine / best.evaluations})
    return row


def run_subject(
    subject: Subject, entry: Entry, problem: Problem, t_end: float, size: float
) -> tuple[float, np.ndarray | None]:
    """Run an integrator from t = 0 to ``t_end``: (gradient evaluations, end state (2 d,) or None if the run fails).

    ``entry`` is the problem for a user's own integrator; ``size`` the number of steps or the tolerance.
    """
    run = _run_registered if subject.integrator is not None else _tolerance if subject.adaptive else own
    return run(subject, entry, problem, t_end, size)


def own(subject: Subject, entry: Entry, problem: Problem, t_end: float, steps: int) -> tuple[float, np.ndarray | None]:
    """Run a user's step, as `run_subject`."""
    stepper = Stepper(subject, entry)
    rows = ()
    with numerical_failures():
        rows = stepper.run(np.array(entry.state), t_end / steps, steps, every=steps)
    return float(max(stepper.system.evaluations)), rows[-1] if len(rows) == 2 else None


def _tolerance(
    subject: Subject, entry: Entry, problem: Problem, t_end: float, tol: float
) -> tuple[float, np.ndarray | None]:
    system, state = own_step.System(entry.system), None
    with numerical_failures():
        state = adaptive.run(subject, entry, system, np.split(np.array(entry.state), 2), t_end, tol)
    return float(max(system.evaluations)), state


def _run_registered(
    subject: Subject, entry: Entry, problem: Problem, t_end: float, size: float
) -> tuple[float, np.ndarray | None]:
    wanted = {"tol": max(size, subject.integrator.record.least)} if subject.adaptive else {"steps": size}
    end = subject.integrator.run(problem, t_end=t_end, save_every=0, **wanted)
    state = np.concatenate([end.q[-1], end.p[-1]]) if end.status == OK else None
    return float(end.counts.get("gradient", 0)), state


def end_reason(runs: list[Run], adaptive: bool) -> str:
    """Return why the sequence of ever finer runs ends with the last of ``runs``; "" if another run is to follow."""
    last, errors = runs[-1], [r.error for r in runs]
    if last.error <= fronts.ERRORS[-1]:
        return "the smallest error is met"
    if min(errors) < fronts.ERRORS[0] and idle(errors) >= IDLE:
        return "the error falls no longer"
    return "too many evaluations" if 2 * max(last.evaluations, 0 if adaptive else last.size) > MOST else ""
