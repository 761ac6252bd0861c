"""The coarse stage: one integrator after another climbs from where it breaks towards round-off, while it may still win.

A rung is a number of steps, twice that of the rung before, or a tolerance, a tenth of it.  It is run twice, once with
the rows that the quantity needs and once without output, by `measure.clock`, which gives the time.  What an error costs
is known from all of its side who climbed before: methods are compared with methods here, and peers with peers.  Whoever
takes `KEEP` times that on `LOSING` rungs one after another, without coming nearer, is dropped, and it is said at which
error and by whom it was beaten.  Before anybody is dropped, the time is taken again.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf, isfinite
from typing import Any, NamedTuple

from phasebench.benchmarks.certificate.fronts import ROUND_OFF
from phasebench.benchmarks.measure import clock
from phasebench.benchmarks.measure.compilation import NotCompiled, naming
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.quantities import Quantity, Truth, error
from phasebench.benchmarks.problems.questions import Question
from phasebench.integrators.driver import INVALID, OK
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import Method

#: So many times the cheapest's time, and on so many rungs, is out of reach.
KEEP, LOSING = 3.0, 2
#: A ratio that falls by less than this from a rung to the next does not come nearer.
NEARER = 0.85
#: The step that a climb begins with, in units of a problem's own, and the loosest tolerance.
WIDEST, LOOSEST = 12.0, 1e-1
#: A run is stopped after so many times what the finest accuracy costs; before that is known, after `PATIENCE` seconds.
PATIENCE, LONGEST = 0.3, 3.0
#: No run is too long that takes less than this.
FREE = 3e-4
#: Rungs that fall by less than this factor, so many in a row, stand on the floor of round-off.
FLOOR, STANDING = 0.7, 2
#: A run of more than `SHORT` that took so many times the cheapest's time ends a climb at once.
HOPELESS = 30.0
#: So many rungs in a row that do not come to their end, or so many seconds of them, end a climb.
FAILURES, WASTED = 10, 1.5
#: Shorter runs are made twice for their time; no longer ones are made again, so often, before somebody is dropped.
SHORT, LONG, AGAIN = 0.05, 0.2, 3
#: To compile a method's run without output pays where one with rows, less the seconds that handing these over may take,
#: is within this factor of the cheapest.
OVERHEAD, WORTH = 3e-4, 2 * KEEP
#: A peer that takes more seconds than this to get ready for a further rung climbs no more; in the finals heyoka runs
#: in each of its modes all the same.
PREPARING = 3.0
#: How the reason begins why an integrator is dropped that does not compile.
UNCOMPILED = "it does not compile: "


class Rung(NamedTuple):
    """A run: its size (steps, or a tolerance), how it ended, its error, warm seconds without output, its counts."""

    steps: int | None
    tol: float | None
    status: str
    error: float
    seconds: float
    taken: int
    evaluations: int

    @property
    def size(self) -> float:
        """What rises as the run gets finer."""
        return float(self.steps) if self.tol is None else 1 / self.tol


@dataclass(frozen=True)
class Task:
    """A question with what is true of it."""

    question: Question
    problem: object
    quantity: Quantity
    truth: Truth
    prepared: dict[tuple, Any] = field(default_factory=dict, compare=False, repr=False)
    sharing: clock.Sharing = field(default_factory=clock.Sharing, compare=False, repr=False)

    @property
    def asked(self) -> tuple[float, ...]:
        """The accuracies that the reference can tell."""
        return tuple(a for a in self.question.accuracies if self.truth.uncertainty <= a)

    def measure(
        self,
        c: Integrator,
        steps: int | None = None,
        tol: float | None = None,
        patience=inf,
        known: Known | None = None,
    ) -> Rung:
        """Run an integrator at a size: its error, and its time without output (unless `known` says it is beaten)."""
        limit = {"timeout": patience} if c.stoppable and isfinite(patience) else {}
        run = {"problem": self.problem, "t_end": self.question.t_end}
        try:
            told = c.run(**run, **self.quantity.grid(steps=steps, tol=tol), **limit)
        except InvalidInput:
            return Rung(steps, tol, INVALID, inf, inf, 0, 0)
        off = error(self.problem, self.quantity, told, self.truth)
        seconds = told.seconds
        clocked = self.quantity.rows > 1 or seconds < SHORT
        if told.status == OK and clocked and not self.beaten(c, off, seconds, known):
            seconds = self.bare(c, steps, tol)
        counts = told.counts
        return Rung(steps, tol, told.status, off, seconds, counts.get("steps", 0), counts.get("gradient", 0))

    def beaten(self, c: Integrator, off: float, seconds: float, known: Known | None) -> bool:
        """Whether a method of ours is so far behind that its run without output need not be compiled."""
        if known is None or not isinstance(c.record, Method) or (c.label, None) in self.prepared:
            return False
        return seconds - OVERHEAD > WORTH * known.cheapest(off)[0]

    def clock(self, c: Integrator, steps: int | None, tol: float | None) -> clock.Clock:
        """The clock of an integrator at a size, on its prepared run."""
        key = (c.label, tol)
        if key not in self.prepared:
            self.prepared[key] = c.prepare(self.problem, tol=tol)
        size = {"t_end": self.question.t_end, "steps": steps, "tol": tol}
        return clock.clock(c, self.problem, **size, run=self.prepared[key], sharing=self.sharing)

    def call(self, c: Integrator, steps: int | None, tol: float | None) -> float:
        """The seconds of a call that integrates next to nothing."""
        size = {"t_end": self.question.t_end, "steps": steps, "tol": tol}
        return clock.call(c, self.problem, **size, run=self.prepared.get((c.label, tol)))

    def bare(self, c: Integrator, steps: int | None, tol: float | None) -> float:
        """The seconds of a warm run without output."""
        return self.clock(c, steps, tol)()

    def again(self, c: Integrator, rung: Rung) -> Rung:
        """The rung with the least of its time and `AGAIN` more, where it came to its end and is not far `beaten`."""
        unprepared = isinstance(c.record, Method) and (c.label, None) not in self.prepared
        if rung.status != OK or rung.seconds > LONG or unprepared:
            return rung
        timed = self.clock(c, rung.steps, rung.tol)
        return rung._replace(seconds=min(rung.seconds, *(timed() for _ in range(AGAIN))))


@dataclass
class Known:
    """What each error costs, of all that was run so far."""

    runs: list[tuple[float, float, str]] = field(default_factory=list)

    def add(self, rung: Rung, label: str) -> None:
        """Take a run into account."""
        if rung.status == OK and isfinite(rung.error):
            self.runs.append((rung.error, rung.seconds, label))

    def cheapest(self, wanted: float) -> tuple[float, str]:
        """(seconds, label) of the cheapest run with no more than that error; infinite where there is none."""
        return min(((s, label) for e, s, label in self.runs if e <= wanted), default=(inf, ""))


@dataclass
class Climb:
    """The rungs of an integrator, and why there are no more."""

    integrator: Integrator
    rungs: list[Rung]
    why: str
    dropped: bool


def sizes(task: Task, c: Integrator) -> Iterator[dict]:
    """From the widest step on, or from the loosest tolerance."""
    if c.adaptive:
        tol = LOOSEST
        while tol >= c.record.least:
            yield {"tol": tol}
            tol = float(f"{tol / 10:.0e}")
        yield {"tol": c.record.least}
        return
    steps, last = task.question.t_end / (WIDEST * task.problem.pace.step), 0
    while True:
        whole = task.quantity.steps(steps)
        if whole > last:
            yield {"steps": whole}
        steps, last = 2 * max(steps, 1), whole


def wider(task: Task, c: Integrator, rung: Rung, known: Known) -> list[Rung]:
    """The rungs before a first one that meets the coarsest accuracy: half its steps, and so on, until they miss it.

    None are made where one is hopeless: implicit equations that only Newton's method solves take longer in wider steps.
    """
    out: list[Rung] = []
    steps = rung.steps
    while steps is not None and rung.error <= task.asked[0] and not hopeless(task, rung, known):
        if (steps := task.quantity.steps(steps / 2)) >= rung.steps:
            break
        rung = task.measure(c, steps=steps, patience=PATIENCE)
        known.add(rung, c.label)
        out.insert(0, rung)
    return out


def hopeless(task: Task, rung: Rung, known: Known) -> bool:
    """Whether a run is no short one and took many times the cheapest's time."""
    return rung.seconds > max(SHORT, HOPELESS * known.cheapest(min(rung.error, task.asked[0]))[0])


def eases(rungs: list[Rung]) -> bool:
    """Whether twice the steps may take less than twice the time: where a step needs ever fewer evaluations.

    In wide steps implicit equations take Newton's method or many sweeps; what they cost tells nothing of shorter ones.
    Of a first rung nothing is known yet.
    """
    each = [r.evaluations / r.taken for r in rungs[-2:] if r.tol is None and r.taken]
    return len(each) == 1 or (len(each) == 2 and each[1] < NEARER * each[0])


def climb(task: Task, c: Integrator, known: Known) -> Climb:
    """The rungs of an integrator, as far as it may still win; dropped without rungs where it does not compile."""
    try:
        with naming(c.label):
            return _climb(task, c, known)
    except NotCompiled as error:
        known.runs = [run for run in known.runs if run[2] != c.label]
        return Climb(c, [], UNCOMPILED + error.failed.why, True)


def _climb(task: Task, c: Integrator, known: Known) -> Climb:
    rungs, lost, still, before, failed, wasted = [], 0, 0, inf, 0, 0.0
    finest = task.asked[-1]
    for size in sizes(task, c):
        dear = known.cheapest(finest)[0]
        patience = max(PATIENCE, LONGEST * dear) if isfinite(dear) else 10 * PATIENCE
        started = time.process_time()
        rung = task.measure(c, **size, patience=patience, known=known)
        preparing = time.process_time() - started - 3 * rung.seconds
        known.add(rung, c.label)
        still = still + 1 if rungs and rung.error > FLOOR * min(r.error for r in rungs) and before < inf else 0
        if not rungs and rung.error <= task.asked[0]:
            rungs += wider(task, c, rung, known)
        rungs.append(rung)
        if rung.status == OK:
            failed, wasted = 0, 0.0
        else:
            failed, wasted = failed + 1, wasted + rung.seconds
            if failed == FAILURES or wasted > WASTED:
                return Climb(c, rungs, f"{failed} runs in a row ended as {rung.status}", True)
            continue
        if rung.error <= finest:
            return Climb(c, rungs, "reached the finest accuracy", False)
        if c.adaptive and len(rungs) > 1 and preparing > PREPARING:
            why = f"it takes more than {PREPARING:g} s to compile from a tolerance of {rung.tol:g} on"
            return Climb(c, rungs, why, False)
        if hopeless(task, rung, known):
            best, by = known.cheapest(min(rung.error, task.asked[0]))
            times = f"{rung.seconds / best:.0f} times as long as {by}"
            return Climb(c, rungs, f"at an error of {rung.error:.1g} it took {times}", True)
        if rung.error <= task.asked[0]:
            best, by = known.cheapest(rung.error)
            if rung.seconds > KEEP * best and lost == LOSING - 1:
                rung = rungs[-1] = task.again(c, rung)
            ratio = rung.seconds / best
            lost = lost + 1 if ratio > KEEP and ratio > NEARER * before else 0
            before = ratio
            if lost >= LOSING:
                return Climb(
                    c, rungs, f"at an error of {rung.error:.1g} it took {ratio:.1f} times as long as {by}", True
                )
            if still >= STANDING and min(r.error for r in rungs) < ROUND_OFF:
                return Climb(c, rungs, f"its error stays at {min(r.error for r in rungs):.1g}: round-off", False)
        limit = max(FREE, LONGEST * dear, min(HOPELESS * dear, PATIENCE) if eases(rungs) else 0.0)
        if rung.seconds > limit:
            rung = rungs[-1] = task.again(c, rung)
        if rung.seconds > limit:
            least = min(r.error for r in rungs)
            off = f"it is off by {least:.1g}" if least < inf else "it does not come to the end"
            took = f"{off} in more than {LONGEST:g} times the time in which the best reach {finest:g}"
            return Climb(c, rungs, took, least > task.asked[0])
        if rung.status == OK and rung.seconds > 10 * PATIENCE:
            return Climb(c, rungs, f"a run took {rung.seconds:.2g} s", True)
    return Climb(c, rungs, "it takes no smaller tolerance", False)
