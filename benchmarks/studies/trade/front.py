"""Search over steps for a scene's fastest integrators at every accuracy, of this project and of peers (its front).

A scene is a problem, end time and quantity; peers are integrators of other packages.  Each integrator that can do the
problem runs at ever smaller steps or tolerances (a climb), until it is dropped (`ladder.race`); methods are compared
with methods and peers with peers.  For every accuracy the climbs are interpolated (`ladder.bracket`).  On each side at
most `FINALISTS` integrators whose cost is within the factor `MARGIN` of the best are refined (`ladder.refine`).  The
widest step is not always the fastest: implicit equations may take so many iterations there that shorter steps take
less time, and then a shorter one is used.  heyoka enters in each of its modes and forms of the equations, however long
they compile.  The finalists are timed in turns by `measure.clock`, and again later, at their stored steps and
tolerances, in other processes (`sweep_again`; `joined` joins several such sweeps).  Of a few scenes all is measured a
second time from scratch (`again`).
"""

from __future__ import annotations

import random
from functools import cache
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from phasebench.benchmarks.ladder import race
from phasebench.benchmarks.ladder.bracket import cost
from phasebench.benchmarks.ladder.competitors import able, competitors, ours
from phasebench.benchmarks.ladder.final import rounds
from phasebench.benchmarks.ladder.race import Climb, Known
from phasebench.benchmarks.ladder.refine import refine
from phasebench.benchmarks.ladder.rung import Rung, Task
from phasebench.benchmarks.measure import clock, timing, truths
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.problems.questions import BY_ID
from phasebench.benchmarks.store import tables
from phasebench.benchmarks.store.cells import ProblemKey, Rows, Unavailable, states
from phasebench.reference.peers import Peer, heyoka

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
TIMES, AGAIN = "front_times", "front_again"
#: The sweeps after the first; the last one checks the intervals from the others.
SWEEPS = (2, 3)
#: Folder of the stored finals of the first sweep.
DATA = Path(__file__).resolve().parents[3] / "reports" / "data"
#: A final: accuracy, side, label, steps or None, tolerance or None, seconds in the first sweep.
Final = tuple[float, str, str, int | None, float | None, float]
#: Scenes whose sweep takes about 15 seconds or less, of which some, drawn with a seed, are measured a second time.
CHEAP = (
    *("oscillator-phase", "pendulum-short", "pendulum-long", "kepler-orbit", "kepler-phase", "perturbed-kepler-short"),
    *("henon-heiles-box-short", "henon-heiles-box-long", "henon-heiles-section", "henon-heiles-chaotic"),
    *("lotka-volterra", "lotka-volterra-log", "double-pendulum-chaotic", "duffing", "quadrupole-boson", "toda"),
    *("rigid-body", "schwarzschild-azimuth"),
)
COUNT, SEED = 8, 11
TWICE = sorted(random.Random(SEED).sample(CHEAP, COUNT))


class Finalist(NamedTuple):
    """An integrator that may be the fastest at an accuracy, and its run that meets it."""

    integrator: Integrator
    rung: Rung


def task_of(scene: str) -> Task:
    """The `Task` of a scene: its problem, end time, quantity, true value and accuracies."""
    question = BY_ID[scene]
    made = question.build_problem()
    wanted = quantity(made, question.quantity)
    return Task(made, question.t_end, wanted, truths.truth(made, wanted, question.t_end), question.accuracies)


def climbs(task: Task) -> tuple[list[Climb], dict[str, str], Known]:
    """(The runs of each competitor, label -> reason for those left out, the least cost known at each error)."""
    can, cannot = entrants(task)
    known = {side: Known() for side in (True, False)}
    climbed = [race.enter(task, c, known[ours(c)]) for c in can]
    return climbed, cannot, Known([run for side in known.values() for run in side.runs])


def entrants(task: Task) -> tuple[list[Integrator], dict[str, str]]:
    """(The integrators that can run this problem and time span, label -> reason for the others)."""
    can, cannot = able(task.problem)
    if task.t_end <= FARTHEST * task.problem.pace.step:
        return can, cannot
    why = "its loop over steps is Python's and cannot be stopped: the span is too long for it"
    return [c for c in can if c.id not in LOOPED], cannot | {c.label: why for c in can if c.id in LOOPED}


def near(task: Task, one: Climb, known: Known) -> bool:
    """True if the runs of an integrator are stored though it is no finalist.

    One of them takes at most `NEAR` times the least known time at its error, or it is the method `race.REFERENCE`.
    """
    if one.integrator.id == race.REFERENCE:
        return True
    told = (r for r in one.rungs if r.error <= task.testable_accuracies[0])
    return any(r.seconds <= NEAR * known.seconds(r.error) for r in told)


def finalists(task: Task, climbed: list[Climb], wanted: float) -> list[Finalist]:
    """On each side the few integrators that may be the fastest at an accuracy, each with its refined run."""
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
    """At most so many finalists, each with its fastest run, within the factor `MARGIN` of the fastest one."""
    ordered = list({m.integrator.label: m for m in sorted(members, key=lambda m: -m.rung.seconds)}.values())
    ordered.sort(key=lambda m: m.rung.seconds)
    return [m for m in ordered[:most] if m.rung.seconds <= MARGIN * ordered[0].rung.seconds]


def is_heyoka(c: Integrator) -> bool:
    """True for heyoka's integrator in any of its modes."""
    return isinstance(c.record, Peer) and c.record.package == "heyoka"


def twins(task: Task, member: Finalist, wanted: float) -> list[Finalist]:
    """heyoka's other modes and forms of the equations, if a finalist is heyoka's, at a tolerance that suffices."""
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
    """Time the finalists at an accuracy in turns: (a row of each, a row of the fastest of each side and the ratio)."""
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
    """Columns of a run: integrator, step or tolerance, error and counts."""
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


def measure(scene: str) -> Rows:
    """The fastest of each side at each accuracy, all integrators timed, their runs, and who was dropped and why."""
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


def again(scene: str) -> list[dict]:
    """The rows of all finalists of a second measurement, from scratch."""
    return measure(scene)[FINALS]


@cache
def _stored_finals(folder: Path) -> dict[str, tuple[Final, ...]]:
    out: dict[str, list[Final]] = {}
    for row in tables.Table(folder, FINALS).rows:
        steps = round(BY_ID[row["scene"]].t_end / float(row["h"])) if row["h"] else None
        tol = float(row["tol"]) if row["tol"] else None
        line = (float(row["accuracy"]), row["side"], row["integrator"], steps, tol, float(row["seconds"]))
        out.setdefault(row["scene"], []).append(line)
    return {scene: tuple(lines) for scene, lines in out.items()}


def stored_finals(scene: str, folder: Path | None = None) -> tuple[Final, ...]:
    """The stored finalists of a scene at each accuracy; empty if it was not measured."""
    return _stored_finals(folder or DATA).get(scene, ())


def sweep_again(scene: str, sweep: int) -> list[dict]:
    """Time the stored finalists of a scene again, in turns at each accuracy: their medians with intervals."""
    question, by_label = BY_ID[scene], {c.label: c for c in competitors()}
    stored = stored_finals(scene)
    if not stored:
        raise Unavailable(f"no finalists of {scene} are stored")
    made = question.build_problem()
    task = Task(made, question.t_end, quantity(made, question.quantity))
    rows = []
    for accuracy in dict.fromkeys(line[0] for line in stored):
        members = [line for line in stored if line[0] == accuracy]
        task.clocks.sharing = sharing = clock.Sharing()
        sizes = ({"tol": tol} if steps is None else {"steps": steps} for *_, steps, tol, _ in members)
        work = {k: task.timer(by_label[m[2]], size) for k, (m, size) in enumerate(zip(members, sizes, strict=True))}
        found = timing.in_turns(work, rounds((line[-1] for line in members), *FINAL))
        for k, (_, side, label, *_) in enumerate(members):
            told = timing.median(found[k])
            row = {"scene": scene, "sweep": sweep, "accuracy": accuracy, "side": side, "integrator": label}
            row |= {"seconds": told.value, "low": told.low, "high": told.high, "disturbed": sharing.disturbed}
            rows.append(row)
    return rows


@cache
def _records() -> tuple:
    return tuple(c.record for c in competitors())


def needs(scene: str, **key: object) -> list[object]:
    """What the rows of a scene depend on: the question and all competitors; later sweeps on the stored finalists."""
    q = BY_ID[scene]
    made = ProblemKey(q.problem)
    asked = (q.id, q.t_end, stored_finals(scene)) if key else (q.id, q.t_end, q.quantity, q.accuracies, states(made.id))
    return [asked, made, *_records()]


def names(scene: str, **key: object) -> list[str]:
    """The names by which the rows of a scene are selected: its own, and its problem's."""
    return [scene, ProblemKey(BY_ID[scene].problem).id]
