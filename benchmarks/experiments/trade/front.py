"""The fine stage: of each side the few that may be cheapest at an accuracy, each at its best step, timed in turns.

For every accuracy the climbs are interpolated (error and time are powers of the size between two rungs).  Of each side
at most `FINALISTS` whose estimate is within `MARGIN` of the side's best are refined: the size is moved between the last
rung that misses the accuracy and the next, `REFINED` times.  The widest step is not always the cheapest: implicit
equations may take so many sweeps there that shorter steps take less time; then these stand for the integrator.  heyoka
enters in each of its modes and forms of the equations, however long they compile.  The finalists run in turns by
`measure.clock`; the medians and intervals here are of the rounds of this one sweep (`settled` joins several).
"""

from __future__ import annotations

from math import inf, isfinite, log
from typing import Any, NamedTuple

import numpy as np

from phasebench.benchmarks.advice.cheapest import cheapest
from phasebench.benchmarks.certificate.fronts import ROUND_OFF
from phasebench.benchmarks.measure import timing, truths
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.quantities import quantity
from phasebench.benchmarks.problems.questions import BY_ID
from phasebench.benchmarks.rows.cells import Rows
from phasebench.integrators.driver import OK
from phasebench.reference.peers import Peer, heyoka
from phasebench.reference.solvers import taylor

from .climb import Climb, Known, Rung, Task, climb
from .field import able, ours

FINALISTS, MARGIN, REFINED = 3, 1.4, 3
#: A refined size is so much finer than the estimate, so that it does not just miss.
SPARE = 1.03
#: Rounds of a final: at least, at most, and the seconds that they may take together.
LEAST, MOST, SECONDS = 6, 15, 0.6
#: Rows are kept of climbs that come so near to the cheapest known.
NEAR = 2.0
#: Finals in which a round takes longer than this have one finalist of each side less.
DEAR = 0.15
#: Peers whose loop over steps is Python's, so that nothing stops it, and the span beyond which they do not compete, in
#: units of the problem's own step, of which a revolution has some thirty.
LOOPED, FARTHEST = ("scipy-dop853-numba", "scipy-lsoda-numba", "scipy-radau-numba"), 1e5
#: A twin of heyoka's that just misses an accuracy is tried at half the tolerance, so often; the most variables that it
#: unrolls.
TIGHTENED, UNROLLED = 3, 256
CHOICES, FINALS, RUNGS, DROPPED = "front", "front_finals", "front_rungs", "front_dropped"
TABLES = (CHOICES, FINALS, RUNGS, DROPPED)


class Finalist(NamedTuple):
    """An integrator at the size at which it meets an accuracy."""

    integrator: Integrator
    rung: Rung


def task_of(scene: str) -> Task:
    """The question of that id with its problem and what is true."""
    question = BY_ID[scene]
    made = question.made()
    wanted = quantity(made, question.quantity)
    return Task(question, made, wanted, truths.truth(made, wanted, question.t_end))


def climbs(task: Task) -> tuple[list[Climb], dict[str, str], Known]:
    """(the climbs of all who can do the problem, label -> why not of the others, what errors cost)."""
    can, cannot = entered(task)
    known = {side: Known() for side in (True, False)}
    climbed = [climb(task, c, known[ours(c)]) for c in can]
    return climbed, cannot, Known([run for side in known.values() for run in side.runs])


def entered(task: Task) -> tuple[list[Integrator], dict[str, str]]:
    """(those that compete, label -> why not of the others): of who can do the problem, whoever can do its span."""
    can, cannot = able(task.problem)
    if task.question.t_end <= FARTHEST * task.problem.pace.step:
        return can, cannot
    why = "its loop over steps is Python's and cannot be stopped: the span is too long for it"
    return [c for c in can if c.id not in LOOPED], cannot | {c.label: why for c in can if c.id in LOOPED}


def near(task: Task, one: Climb, known: Known) -> bool:
    """Whether a climb comes within a factor `NEAR` of the cheapest known at one of its rungs."""
    told = (r for r in one.rungs if r.error <= task.asked[0])
    return any(r.seconds <= NEAR * known.cheapest(r.error)[0] for r in told)


def bracket(rungs: list[Rung], wanted: float) -> tuple[Rung | None, list[Rung]]:
    """(the last rung that misses an error, the finer ones, which meet it); none finer where it is not reached.

    Past the least error what misses it is round-off, where it is small; where it is not, the least was a lucky one.
    """
    good = [r for r in rungs if isfinite(r.error)]
    if not good or min(r.error for r in good) > wanted:
        return None, []
    least = min(range(len(rungs)), key=lambda k: rungs[k].error)
    missing = [k for k, r in enumerate(rungs) if not r.error <= wanted and (k < least or r.error > ROUND_OFF)]
    last = missing[-1] if missing else -1
    return (rungs[last] if missing else None), [r for r in rungs[last + 1 :] if r.error <= wanted]


def estimate(rungs: list[Rung], wanted: float) -> float:
    """The seconds that an error costs, between two rungs as a power of the error; infinite where it is not reached."""
    low, meeting = bracket(rungs, wanted)
    if not meeting:
        return inf
    high, least = meeting[0], cheapest(meeting).seconds
    if low is None or not isfinite(low.error) or low.error <= high.error:
        return least
    share = log(low.error / wanted) / log(low.error / max(high.error, 1e-300))
    return min(least, low.seconds * (high.seconds / low.seconds) ** share)


def refine(task: Task, c: Integrator, rungs: list[Rung], wanted: float) -> Rung:
    """The cheapest run found that meets an accuracy, between two rungs of a climb; all runs join the climb's."""
    low, (high, *_) = bracket(rungs, wanted)
    for _ in range(REFINED if low is not None else 0):
        size = _between(task, c, low, high, wanted)
        if size is None:
            break
        rung = task.measure(c, **size)
        rungs.append(rung)
        if rung.error <= wanted:
            high = rung
        else:
            low = rung
    rungs.sort(key=lambda r: r.size)
    meeting = bracket(rungs, wanted)[1]
    found = cheapest(meeting)
    return found if found is meeting[0] else cheapest([task.again(c, r) for r in (meeting[0], found)])


def _between(task: Task, c: Integrator, low: Rung, high: Rung, wanted: float) -> dict | None:
    """A size between two, where the error is expected to be the wanted one; None where there is none."""
    share = 0.5
    if isfinite(low.error) and high.error > 0:
        share = log(low.error / wanted) / log(low.error / high.error)
    share = min(max(share, 0.1), 0.9)
    if c.adaptive:
        return {"tol": float(f"{low.tol * (high.tol / low.tol) ** share:.3g}")} if high.tol < 0.95 * low.tol else None
    steps = task.quantity.steps(min(SPARE * low.steps * (high.steps / low.steps) ** share, high.steps))
    return {"steps": steps} if low.steps < steps < high.steps and high.steps > SPARE * low.steps else None


def finalists(task: Task, climbed: list[Climb], wanted: float) -> list[Finalist]:
    """Of each side the few that may be the cheapest at an accuracy, refined."""
    out = []
    for side in (True, False):
        costs = sorted(
            ((estimate(k.rungs, wanted), i) for i, k in enumerate(climbed) if ours(k.integrator) == side),
        )
        costs = [(s, i) for s, i in costs if s <= MARGIN * costs[0][0] and isfinite(s)]
        most = FINALISTS if costs and costs[0][0] < DEAR / FINALISTS else FINALISTS - 1
        members = []
        for _, i in costs[:most]:
            members.append(
                Finalist(climbed[i].integrator, refine(task, climbed[i].integrator, climbed[i].rungs, wanted))
            )
        members += [twin for m in members for twin in twins(task, m, wanted)]
        out += quickest(members, most)
    return out


def quickest(members: list[Finalist], most: int) -> list[Finalist]:
    """The quickest of each integrator's runs, and of those at most so many within `MARGIN` of the best."""
    ordered = list({m.integrator.label: m for m in sorted(members, key=lambda m: -m.rung.seconds)}.values())
    ordered.sort(key=lambda m: m.rung.seconds)
    return [m for m in ordered[:most] if m.rung.seconds <= MARGIN * ordered[0].rung.seconds]


def twins(task: Task, member: Finalist, wanted: float) -> list[Finalist]:
    """The other modes and forms of a heyoka peer at its tolerance, or at the next tighter one at which they meet."""
    if not isinstance(member.integrator.record, Peer):
        return []
    out = []
    for record in heyoka.twins(member.integrator.record):
        c, tol = Integrator(record), member.rung.tol
        if c.lacks(task.problem) or unrolled_beyond(record, task.problem.system):
            continue
        for _ in range(TIGHTENED):
            rung = task.measure(c, tol=tol)
            if rung.status == OK and rung.error <= wanted:
                out.append(Finalist(c, rung))
                break
            tol = max(tol / 2, record.least)
    return out


def unrolled_beyond(record: Peer, system) -> bool:
    """Whether heyoka would have to unroll more than `UNROLLED` variables, or many of them with compensated sums too."""
    many = 2 * system.d > (taylor.COMPACT if "high-accuracy" in record.id else UNROLLED)
    return "compact_mode=False" in record.id and many


def timed(task: Task, members: list[Finalist]) -> list[np.ndarray]:
    """The seconds of each finalist in every round."""
    work = {k: task.clock(m.integrator, m.rung.steps, m.rung.tol) for k, m in enumerate(members)}
    one = sum(m.rung.seconds for m in members)
    found = timing.in_turns(work, rounds(one))
    return [found[k] for k in range(len(members))]


def rounds(seconds: float) -> int:
    """How many rounds there are where one takes so many seconds."""
    return int(min(MOST, max(LEAST, SECONDS / max(seconds, 1e-9))))


def final(task: Task, members: list[Finalist], wanted: float) -> tuple[list[dict], dict]:
    """(the rows of the finalists at an accuracy, the row that says who is cheapest)."""
    seconds = timed(task, members) if members else []
    rows = []
    for m, s in zip(members, seconds, strict=True):
        median = timing.median(s)
        rows.append(
            {"accuracy": wanted, "side": timing.OURS if ours(m.integrator) else timing.PEERS}
            | _said(task, m.integrator, m.rung)
            | {
                "seconds": median.value,
                "low": median.low,
                "high": median.high,
                "call": task.call(m.integrator, m.rung.steps, m.rung.tol),
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


def _said(task: Task, c: Integrator, rung: Rung) -> dict[str, Any]:
    """What a row says of a run."""
    h = task.question.t_end / rung.steps if rung.steps else None
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


def measured(scene: str) -> Rows:
    """The rows of a scene, by table."""
    task = task_of(scene)
    climbed, cannot, known = climbs(task)
    # From the finest on: a wide step that is found to hold a fine accuracy is then known at the coarser ones too.
    members = {wanted: finalists(task, climbed, wanted) for wanted in reversed(task.asked)}
    finals, choices = [], []
    for wanted in task.asked:
        rows, choice = final(task, members[wanted], wanted)
        finals += rows
        choices.append(choice)
    reference = {"reference": task.truth.source, "reference uncertainty": task.truth.uncertainty}
    asked = {"problem": task.question.problem, "quantity": task.quantity.name, "t_end": task.question.t_end}
    dropped = [{"integrator": k.integrator.label, "why": k.why} for k in climbed if k.dropped]
    dropped += [{"integrator": label, "why": why} for label, why in cannot.items()]
    kept = {r["integrator"] for r in finals}
    rungs = [
        _said(task, k.integrator, r) | {"seconds": r.seconds}
        for k in climbed
        if k.integrator.label in kept or near(task, k, known)
        for r in sorted(k.rungs, key=lambda r: r.size)
        if isfinite(r.error)
    ]
    of = {"scene": scene}
    return {
        CHOICES: [of | asked | c | reference for c in choices],
        FINALS: [of | f for f in finals],
        RUNGS: [of | r for r in rungs] or [of],
        DROPPED: [of | d for d in dropped] or [of],
    }
