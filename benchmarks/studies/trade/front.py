"""Search over steps for a scene's fastest integrators at every accuracy, of this project and of peers (its front).

A scene is a problem, end time and quantity; peers are integrators of other packages.  Each integrator that can do the
problem runs at ever smaller steps or tolerances (a climb), until it is dropped (`ladder.race`); methods are compared
with methods and peers with peers.  For every accuracy the climbs are interpolated (`ladder.bracket`), and on each side
the finalists, at most `FINALISTS` within the factor `MARGIN` of the least cost, are refined (`race.refine`).  The
widest step is not always the fastest: implicit equations may take so many iterations there that a shorter one is used.
The finalists are timed in turns, and again later, at their stored sizes, in other processes (`sweep_again`; `joined`
joins such sweeps).  Of a few scenes all is measured a second time from scratch (`again`).
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
from phasebench.benchmarks.ladder.race import Climb, Known, refine, rounds
from phasebench.benchmarks.ladder.rung import Rung, Task
from phasebench.benchmarks.measure import clock, timing, truths
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.problems.questions import BY_ID
from phasebench.benchmarks.store import tables
from phasebench.benchmarks.store.cells import ProblemKey, Rows, Unavailable, states
from phasebench.integrators.driver import OK
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
#: What is stored of the fastest integrator of a side.
SHOWN = ("integrator", "h", "tol", "steps", "evaluations", "error", "seconds", "low", "high")
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
    asked = _timed_task(scene)
    true = truths.truth(asked.problem, asked.quantity, asked.t_end)
    return Task(asked.problem, asked.t_end, asked.quantity, true, BY_ID[scene].accuracies)


def _timed_task(scene: str) -> Task:
    made = BY_ID[scene].build_problem()
    return Task(made, BY_ID[scene].t_end, quantity(made, BY_ID[scene].quantity))


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
    told = (r for r in one.rungs if r.error <= task.testable_accuracies[0])
    return one.integrator.id == race.REFERENCE or any(r.seconds <= NEAR * known.seconds(r.error) for r in told)


def finalists(task: Task, climbed: list[Climb], wanted: float) -> list[Finalist]:
    """On each side the few integrators that may be the fastest at an accuracy, each with its refined run."""
    out = []
    for side in (True, False):
        costs = sorted((cost(k.rungs, wanted), i) for i, k in enumerate(climbed) if ours(k.integrator) == side)
        costs = [(s, i) for s, i in costs if isfinite(s)]
        most = FINALISTS if costs and costs[0][0] < DEAR / FINALISTS else FINALISTS - 1
        best = [i for s, i in costs if s <= MARGIN * costs[0][0]][:most]
        # heyoka may be many times faster in a mode that was too slow to compile at every tolerance of the search
        best += [i for _, i in costs if is_heyoka(climbed[i].integrator)][:1]
        chosen = [climbed[i] for i in dict.fromkeys(best)]
        members = [Finalist(k.integrator, refine(task, k.integrator, k.rungs, wanted)) for k in chosen]
        members += [twin for m in members for twin in twins(task, m, wanted)]
        out += _quickest(members, most)
    return out


def _quickest(members: list[Finalist], most: int) -> list[Finalist]:
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


def _times(seconds: np.ndarray) -> dict[str, float]:
    return dict(zip(("seconds", "low", "high"), timing.median(seconds), strict=True))


def final(task: Task, members: list[Finalist], wanted: float) -> tuple[list[dict], dict]:
    """Time the finalists at an accuracy in turns: (a row of each, a row of the fastest of each side and the ratio)."""
    seconds = time_finalists(task, members) if members else []
    rows = []
    for m, s in zip(members, seconds, strict=True):
        about = {"accuracy": wanted, "side": timing.OURS if ours(m.integrator) else timing.PEERS}
        call = task.clocks.call(m.integrator, **m.rung.size)
        rows.append(about | _run_columns(task, m.integrator, m.rung) | _times(s) | {"call": call})
    choice: dict[str, Any] = {"accuracy": wanted}
    best = []
    for side in (timing.OURS, timing.PEERS):
        if found := [k for k, r in enumerate(rows) if r["side"] == side]:
            best.append(k := min(found, key=lambda k: rows[k]["seconds"]))
            choice |= {f"{side} {name}": rows[k][name] for name in SHOWN}
    if len(best) == 2:
        ratio = timing.ratio(*(seconds[k] for k in best))
        choice |= dict(zip(("ratio", "ratio low", "ratio high"), ratio, strict=True))
    return rows, choice


def _run_columns(task: Task, c: Integrator, rung: Rung) -> dict[str, Any]:
    """Columns of a run: integrator, step or tolerance, error and counts."""
    about = {"integrator": c.label, "id": c.id, "kind": c.kind, "h": task.t_end / rung.steps if rung.steps else None}
    about |= {"tol": rung.tol, "steps": rung.taken, "evaluations": rung.evaluations}
    return about | {"status": rung.status, "error": rung.error}


def measure(scene: str) -> Rows:
    """The fastest of each side at each accuracy, all integrators timed, their runs, and who was dropped and why."""
    task = task_of(scene)
    can, cannot = entrants(task)
    of_side = {side: Known() for side in (True, False)}
    climbed = [race.enter(task, c, of_side[ours(c)]) for c in can]
    known = Known([run for side in of_side.values() for run in side.runs])
    # Finest accuracy first: a wide step that meets it is then known for the coarser ones too.
    members = {wanted: finalists(task, climbed, wanted) for wanted in reversed(task.testable_accuracies)}
    timed = [final(task, members[wanted], wanted) for wanted in task.testable_accuracies]
    finals = [row for rows, _ in timed for row in rows]
    of = {"scene": scene}
    asked = of | {"problem": task.problem.label, "quantity": task.quantity.name, "t_end": task.t_end}
    reference = {"reference": task.truth.source, "reference uncertainty": task.truth.uncertainty}
    dropped = {k.integrator.label: k.why for k in climbed if k.dropped} | cannot
    kept = {r["integrator"] for r in finals}
    rungs = [
        of | _run_columns(task, k.integrator, r) | {"seconds": r.seconds}
        for k in climbed
        if k.integrator.label in kept or near(task, k, known)
        for r in sorted(k.rungs, key=lambda r: r.fineness)
        if isfinite(r.error)
    ]
    return {
        CHOICES: [asked | choice | reference for _, choice in timed],
        FINALS: [of | f for f in finals],
        RUNGS: rungs or [of],
        DROPPED: [of | {"integrator": label, "why": why} for label, why in dropped.items()] or [of],
    }


def again(scene: str) -> list[dict]:
    """The rows of all finalists of a second measurement, from scratch."""
    return measure(scene)[FINALS]


@cache
def _stored_finals(folder: Path) -> dict[str, tuple[Final, ...]]:
    out: dict[str, tuple[Final, ...]] = {}
    for row in tables.Table(folder, FINALS).rows:
        steps = round(BY_ID[row["scene"]].t_end / float(row["h"])) if row["h"] else None
        tol = float(row["tol"]) if row["tol"] else None
        line = (float(row["accuracy"]), row["side"], row["integrator"], steps, tol, float(row["seconds"]))
        out[row["scene"]] = (*out.get(row["scene"], ()), line)
    return out


def stored_finals(scene: str) -> tuple[Final, ...]:
    """The stored finalists of a scene at each accuracy; empty if it was not measured."""
    return _stored_finals(DATA).get(scene, ())


def sweep_again(scene: str, sweep: int) -> list[dict]:
    """Time the stored finalists of a scene again, in turns at each accuracy: their medians with intervals."""
    by_label, stored = {c.label: c for c in competitors()}, stored_finals(scene)
    if not stored:
        raise Unavailable(f"no finalists of {scene} are stored")
    task, rows = _timed_task(scene), []
    for accuracy in dict.fromkeys(line[0] for line in stored):
        lines = [line for line in stored if line[0] == accuracy]
        runs = ((by_label[label], Rung(steps, tol, OK, accuracy, s)) for _, _, label, steps, tol, s in lines)
        task.clocks.sharing = sharing = clock.Sharing()
        timed = time_finalists(task, [Finalist(*run) for run in runs])
        for (_, side, label, *_), seconds in zip(lines, timed, strict=True):
            row = {"scene": scene, "sweep": sweep, "accuracy": accuracy, "side": side, "integrator": label}
            rows.append(row | _times(seconds) | {"disturbed": sharing.disturbed})
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
