"""Search over steps for a scene's fastest integrators at every accuracy, of this project and of peers (its front).

A scene is a problem, end time and quantity; peers are integrators of other packages.  Each integrator that can do the
problem runs at ever smaller steps or tolerances (a climb), until it is dropped (`ladder.race`); methods are compared
with methods and peers with peers.  For every accuracy the climbs are interpolated (`ladder.bracket`).  On each side at
most `FINALISTS` integrators whose cost is within the factor `MARGIN` of the best are refined (`ladder.refine`).  The
widest step is not always the fastest: implicit equations may take so many iterations there that shorter steps take
less time, and then a shorter one is used.  heyoka enters in each of its modes and forms of the equations, however long
they compile.  The finalists are timed in turns by `measure.clock`; medians and intervals here are those of one such
measurement (`settled` joins several).
"""

from __future__ import annotations

from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from phasebench.benchmarks.ladder import race
from phasebench.benchmarks.ladder.bracket import cost
from phasebench.benchmarks.ladder.final import rounds
from phasebench.benchmarks.ladder.race import Climb, Known
from phasebench.benchmarks.ladder.refine import refine
from phasebench.benchmarks.ladder.rung import Rung, Task
from phasebench.benchmarks.measure import timing, truths
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.problems.questions import BY_ID
from phasebench.benchmarks.store.cells import Rows
from phasebench.reference.peers import Peer, heyoka

from .field import able, ours

FINALISTS, MARGIN = 3, 1.4
#: Seconds for all rounds of a final, and the least and the largest number of rounds.
FINAL = (0.6, 6, 15)
#: A climb is stored if one of its runs takes at most this many times the least known time at its error.
NEAR = 2.0
#: If a round takes longer than this many seconds, a final has one finalist less on each side.
DEAR = 0.15
#: Peers with a loop over steps in Python, which cannot be stopped; the span above which they do not compete, in units
#: of the problem's own step, of which a revolution has about thirty.
LOOPED, FARTHEST = ("scipy-dop853-numba", "scipy-lsoda-numba", "scipy-radau-numba"), 1e5
#: How often another mode of heyoka that misses an accuracy is tried again at half the tolerance.
TIGHTENED = 3
CHOICES, FINALS, RUNGS, DROPPED = "front", "front_finals", "front_rungs", "front_dropped"
TABLES = (CHOICES, FINALS, RUNGS, DROPPED)


class Finalist(NamedTuple):
    """An integrator that may be the fastest at an accuracy, to be timed against others.

    Attributes
    ----------
    integrator : the integrator, with its settings
    rung : its run at the step or tolerance with which it meets the accuracy: size, error and seconds
    """

    integrator: Integrator
    rung: Rung


def task_of(scene: str) -> Task:
    """Build the `Task` of the scene with this id: its problem, end time, quantity, true value and accuracies."""
    question = BY_ID[scene]
    made = question.build_problem()
    wanted = quantity(made, question.quantity)
    return Task(made, question.t_end, wanted, truths.truth(made, wanted, question.t_end), question.accuracies)


def climbs(task: Task) -> tuple[list[Climb], dict[str, str], Known]:
    """Run all competitors at ever smaller steps or tolerances.

    Returns (for each competitor its runs, a `Climb`; label -> reason for those left out; the least cost known at each
    error, over all competitors).
    """
    can, cannot = entrants(task)
    known = {side: Known() for side in (True, False)}
    climbed = [race.enter(task, c, known[ours(c)]) for c in can]
    return climbed, cannot, Known([run for side in known.values() for run in side.runs])


def entrants(task: Task) -> tuple[list[Integrator], dict[str, str]]:
    """Select who competes: (integrators that can run this problem and time span, label -> reason for the others)."""
    can, cannot = able(task.problem)
    if task.t_end <= FARTHEST * task.problem.pace.step:
        return can, cannot
    why = "its loop over steps is Python's and cannot be stopped: the span is too long for it"
    return [c for c in can if c.id not in LOOPED], cannot | {c.label: why for c in can if c.id in LOOPED}


def near(task: Task, one: Climb, known: Known) -> bool:
    """Return whether a run of an integrator takes at most `NEAR` times the least time in which any reaches its error.

    Only then are its runs stored, unless it is a finalist.  ``one`` has its runs at ever smaller steps, ``known`` those
    of all competitors.  Always True for the method `race.REFERENCE`, whose runs are stored in any case.
    """
    if one.integrator.id == race.REFERENCE:
        return True
    told = (r for r in one.rungs if r.error <= task.testable_accuracies[0])
    return any(r.seconds <= NEAR * known.seconds(r.error) for r in told)


def finalists(task: Task, climbed: list[Climb], wanted: float) -> list[Finalist]:
    """Select the finalists at the accuracy ``wanted``: on each side the few integrators that may be the fastest.

    ``climbed`` has all runs of each integrator; the step or tolerance of each finalist is refined.
    """
    out = []
    for side in (True, False):
        costs = sorted(
            ((cost(k.rungs, wanted), i) for i, k in enumerate(climbed) if ours(k.integrator) == side),
        )
        searched = next(((s, i) for s, i in costs if isfinite(s) and is_heyoka(climbed[i].integrator)), None)
        costs = [(s, i) for s, i in costs if s <= MARGIN * costs[0][0] and isfinite(s)]
        most = FINALISTS if costs and costs[0][0] < DEAR / FINALISTS else FINALISTS - 1
        members = []
        # heyoka may be many times faster in a mode that was too slow to compile at every tolerance of the search
        for _, i in dict.fromkeys([*costs[:most], *([searched] if searched else [])]):
            members.append(
                Finalist(climbed[i].integrator, refine(task, climbed[i].integrator, climbed[i].rungs, wanted))
            )
        members += [twin for m in members for twin in twins(task, m, wanted)]
        out += quickest(members, most)
    return out


def quickest(members: list[Finalist], most: int) -> list[Finalist]:
    """Select at most ``most`` finalists whose time is within the factor `MARGIN` of the fastest one's.

    An integrator that occurs several times counts with its fastest run.
    """
    ordered = list({m.integrator.label: m for m in sorted(members, key=lambda m: -m.rung.seconds)}.values())
    ordered.sort(key=lambda m: m.rung.seconds)
    return [m for m in ordered[:most] if m.rung.seconds <= MARGIN * ordered[0].rung.seconds]


def is_heyoka(c: Integrator) -> bool:
    """True for heyoka's integrator in any of its modes."""
    return isinstance(c.record, Peer) and c.record.package == "heyoka"


def twins(task: Task, member: Finalist, wanted: float) -> list[Finalist]:
    """Return further finalists for a finalist of the package heyoka: its other modes and forms of the equations.

    Each runs at the finalist's tolerance, or at a tighter one that meets the error ``wanted``.  Empty if ``member`` is
    not heyoka.
    """
    if not is_heyoka(member.integrator):
        return []
    out = []
    for record in heyoka.twins(member.integrator.record):
        c, tol = Integrator(record), member.rung.tol
        if c.lacks(task.problem):
            continue
        for _ in range(TIGHTENED):
            rung = task.measure(c, tol=tol)
            if rung.ok and rung.error <= wanted:
                out.append(Finalist(c, rung))
                break
            tol = max(tol / 2, record.least)
    return out


def time_finalists(task: Task, members: list[Finalist]) -> list[np.ndarray]:
    """Time the finalists in turns: for each an array of its seconds in every round."""
    work = {k: task.timer(m.integrator, m.rung.size) for k, m in enumerate(members)}
    found = timing.in_turns(work, rounds((m.rung.seconds for m in members), *FINAL))
    return [found[k] for k in range(len(members))]


def final(task: Task, members: list[Finalist], wanted: float) -> tuple[list[dict], dict]:
    """Time the finalists at the accuracy ``wanted`` in turns.

    Returns (a row for each finalist, a row with the fastest of each side, ours and the peers', and their ratio).
    """
    seconds = time_finalists(task, members) if members else []
    rows = []
    for m, s in zip(members, seconds, strict=True):
        median = timing.median(s)
        rows.append(
            {"accuracy": wanted, "side": timing.OURS if ours(m.integrator) else timing.PEERS}
            | _run_columns(task, m.integrator, m.rung)
            | {
                "seconds": median.value,
                "low": median.low,
                "high": median.high,
                "call": task.clocks.call(m.integrator, **m.rung.size),
            }
        )
    choice: dict[str, Any] = {"accuracy": wanted}
    best = {}
    for side in (timing.OURS, timing.PEERS):
        found = sorted((r["seconds"], k) for k, r in enumerate(rows) if r["side"] == side)
        if found:
            best[side] = k = found[0][1]
            choice |= {f"{side} {name}": rows[k][name] for name in SHOWN}
    if len(best) == 2:
        ratio = timing.ratio(seconds[best[timing.OURS]], seconds[best[timing.PEERS]])
        choice |= {"ratio": ratio.value, "ratio low": ratio.low, "ratio high": ratio.high}
    return rows, choice


SHOWN = ("integrator", "h", "tol", "steps", "evaluations", "error", "seconds", "low", "high")


def _run_columns(task: Task, c: Integrator, rung: Rung) -> dict[str, Any]:
    """Return the columns of a row that describe a run of the integrator ``c``: step or tolerance, error and counts."""
    h = task.t_end / rung.steps if rung.steps else None
    return {
        "integrator": c.label,
        "id": c.id,
        "kind": c.kind,
        "h": h,
        "tol": rung.tol,
        "steps": rung.taken,
        "evaluations": rung.evaluations,
        "status": rung.status,
        "error": rung.error,
    }


def measure_rows(scene: str) -> Rows:
    """Measure the fastest integrators of the scene with this id, at each of its accuracies.

    Returns four tables, table name -> rows: the fastest of each side, all integrators timed, their runs at all steps,
    and the integrators dropped or left out with the reason.
    """
    task = task_of(scene)
    climbed, cannot, known = climbs(task)
    # Finest accuracy first: a wide step that meets it is then known for the coarser ones too.
    members = {wanted: finalists(task, climbed, wanted) for wanted in reversed(task.testable_accuracies)}
    finals, choices = [], []
    for wanted in task.testable_accuracies:
        rows, choice = final(task, members[wanted], wanted)
        finals += rows
        choices.append(choice)
    reference = {"reference": task.truth.source, "reference uncertainty": task.truth.uncertainty}
    asked = {"problem": task.problem.label, "quantity": task.quantity.name, "t_end": task.t_end}
    dropped = [{"integrator": k.integrator.label, "why": k.why} for k in climbed if k.dropped]
    dropped += [{"integrator": label, "why": why} for label, why in cannot.items()]
    kept = {r["integrator"] for r in finals}
    rungs = [
        _run_columns(task, k.integrator, r) | {"seconds": r.seconds}
        for k in climbed
        if k.integrator.label in kept or near(task, k, known)
        for r in sorted(k.rungs, key=lambda r: r.fineness)
        if isfinite(r.error)
    ]
    of = {"scene": scene}
    return {
        CHOICES: [of | asked | c | reference for c in choices],
        FINALS: [of | f for f in finals],
        RUNGS: [of | r for r in rungs] or [of],
        DROPPED: [of | d for d in dropped] or [of],
    }
