"""A race: one integrator after another runs at ever finer steps, for as long as it may still be the cheapest.

A rung (a run at one size) doubles the number of steps of the one before, or divides its tolerance by ten.  The cost of
an error is that of the cheapest run so far in the same race that meets it; methods of this suite compete with methods,
and peers (integrators of other packages) with peers.  An integrator that takes `KEEP` times that cost on `LOSING` rungs
in a row, with a ratio that does not fall, is dropped; the reason names the error and the integrator that beat it.  Its
last run is timed once more before it is dropped.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from math import inf, isfinite

from phasebench.benchmarks.measure.clock import LEAST
from phasebench.benchmarks.measure.compilation import NotCompiled, naming
from phasebench.benchmarks.measure.integrator import Integrator

from .bracket import ROUND_OFF, aim, bracket, cheapest
from .climb import climb, idle, numbers_of_steps, tolerances
from .rung import SHORT, Rung, Task

#: The method whose runs are stored in any case: it runs in every scene, takes any H, and each of its steps has the same
#: number of evaluations.  Certificates compare times with it.
REFERENCE = "dop853"
#: An integrator is dropped after `LOSING` rungs in a row of more than `KEEP` times the cheapest time.
KEEP, LOSING = 3.0, 2
#: The ratio to the cheapest must fall below this share of its last value for the integrator to stay in the race.
NEARER = 0.85
#: First step, in units of the problem's natural step, and first tolerance.
WIDEST, LOOSEST = 12.0, 1e-1
#: A run is stopped after `LONGEST` times the cost of the finest accuracy; if that is unknown, after `PATIENCE` s.
PATIENCE, LONGEST = 0.3, 3.0
#: Runs of fewer seconds never end a climb for being too long.
FREE = 3e-4
#: The error is round-off after this number of rungs in a row without improvement.
STANDING = 2
#: A run longer than `SHORT` that took this multiple of the cheapest time ends a climb at once.
HOPELESS = 30.0
#: A climb ends after `FAILURES` failed runs in a row, or, with fixed steps, after at least `FEW` that took `WASTED`
#: seconds; a loose tolerance may fail slowly, and the very first run may wait for a compiler.
FAILURES, WASTED, FEW = 10, 1.5, 3
#: A peer that needs more seconds than this to prepare a further rung climbs no more; heyoka still enters the finals in
#: each of its modes.
PREPARING = 30.0
#: First words of the reason why an integrator that does not compile is dropped.
UNCOMPILED = "it does not compile: "
#: Number of runs that narrow a bracket.
REFINED = 3
#: The estimated number of steps is multiplied by this, so that the run does not just miss the accuracy.
SPARE = 1.03
#: A bracket of tolerances is narrowed only if the tighter one is below this share of the looser.
APART = 0.95


@dataclass
class Known:
    """All runs so far of the integrators compared, as (error, seconds, label): they give the least cost of an error."""

    runs: list[tuple[float, float, str]] = field(default_factory=list)

    def add(self, rung: Rung, label: str) -> None:
        """Add a run, if it succeeded, under the label of its integrator."""
        if rung.ok and isfinite(rung.error):
            self.runs.append((rung.error, rung.seconds, label))

    def cheapest(self, wanted: float) -> tuple[float, str]:
        """(seconds, label) of the cheapest run whose error is at most ``wanted``; (inf, "") if there is none."""
        return min(((s, label) for e, s, label in self.runs if e <= wanted), default=(inf, ""))

    def seconds(self, wanted: float) -> float:
        """Seconds of the cheapest run whose error is at most ``wanted``; infinite if there is none."""
        return self.cheapest(wanted)[0]

    def forget(self, label: str) -> None:
        """Remove the runs of an integrator."""
        self.runs = [run for run in self.runs if run[2] != label]


@dataclass
class Climb:
    """An integrator, its runs at ever finer steps, ``why`` there are no finer ones, and whether it was given up."""

    integrator: Integrator
    rungs: list[Rung]
    why: str
    dropped: bool


def enter(task: Task, c: Integrator, known: Known) -> Climb:
    """Run an integrator at ever finer steps for as long as it may still be the cheapest; return its runs.

    ``known`` are the runs of the integrators before it, to which its own are added.
    """
    entrant = Entrant(task, c, known)
    try:
        with naming(c.label):
            rungs, why = climb(sizes(task, c), entrant.run, entrant.end_reason)
    except NotCompiled as error:
        known.forget(c.label)
        return Climb(c, [], UNCOMPILED + error.failed.why, True)
    return Climb(c, rungs, why or "it takes no smaller tolerance", entrant.dropped)


def sizes(task: Task, c: Integrator) -> Iterator[dict]:
    """The sizes at which to run an integrator, {"steps": n} or {"tol": x}, from the coarsest on."""
    if c.adaptive:
        return ({"tol": tol} for tol in tolerances(LOOSEST, c.record.least))
    widest = task.t_end / (WIDEST * task.problem.pace.step)
    return ({"steps": steps} for steps in numbers_of_steps(widest, 2, task.quantity.steps))


def wider(task: Task, c: Integrator, rung: Rung, known: Known) -> list[Rung]:
    """Make runs of wider steps if the first run already meets the coarsest accuracy; return them, the coarsest first.

    Implicit equations that only Newton's method solves take longer in wider steps.
    """
    out: list[Rung] = []
    steps = rung.steps
    while steps is not None and rung.error <= task.testable_accuracies[0] and not hopeless(task, rung, known):
        if (steps := task.quantity.steps(steps / 2)) >= rung.steps:
            break
        rung = task.measure(c, steps=steps, timeout=PATIENCE)
        known.add(rung, c.label)
        out.insert(0, rung)
    return out


def hopeless(task: Task, rung: Rung, known: Known) -> bool:
    """True if a run took over `SHORT` s and `HOPELESS` times as long as the fastest known one as accurate as it."""
    return rung.seconds > max(SHORT, HOPELESS * known.seconds(min(rung.error, task.testable_accuracies[0])))


def eases(rungs: list[Rung]) -> bool:
    """True if twice the steps may take less than twice the time, because evaluations per step decrease."""
    each = [r.evaluations / r.taken for r in rungs[-2:] if r.tol is None and r.taken]
    return len(each) == 1 or (len(each) == 2 and each[1] < NEARER * each[0])


@dataclass
class Entrant:
    """An integrator compared with others at ever finer steps: its state from run to run, and the rules that end it.

    Attributes
    ----------
    lost, failed, wasted : number of runs in a row that were too slow, that failed, and the seconds of these
    before : the last run's time, divided by the least known time in which any run reaches its error
    dear : seconds of the cheapest run so far, of any integrator, that reaches the finest accuracy
    preparing : seconds that the last run took besides the integration, for instance to compile
    """

    task: Task
    c: Integrator
    known: Known
    lost: int = 0
    before: float = inf
    failed: int = 0
    wasted: float = 0.0
    dear: float = inf
    preparing: float = 0.0
    dropped: bool = False

    def run(self, size: dict) -> Rung:
        """Run the integrator at ``size`` (steps or tol), with a time limit that depends on the best runs so far."""
        self.dear = self.known.seconds(self.task.testable_accuracies[-1])
        patience = max(PATIENCE, LONGEST * self.dear) if isfinite(self.dear) else 10 * PATIENCE
        started = time.process_time()
        rung = self.task.measure(self.c, **size, timeout=patience, cheapest=self.known.seconds)
        self.preparing = time.process_time() - started - 3 * rung.seconds
        self.known.add(rung, self.c.label)
        return rung

    def end_reason(self, rungs: list[Rung]) -> str:
        """Why no finer run follows the last one; "" if one does."""
        rung = rungs[-1]
        if len(rungs) == 1 and rung.error <= self.task.testable_accuracies[0]:
            rungs[:0] = wider(self.task, self.c, rung, self.known)
        if not rung.ok:
            return self._failing(rung)
        self.failed, self.wasted = 0, 0.0
        return self._finish_reason(rungs) or self._beaten(rungs) or self._too_long(rungs)

    def _drop(self, why: str) -> str:
        self.dropped = True
        return why

    def _failing(self, rung: Rung) -> str:
        self.failed, self.wasted = self.failed + 1, self.wasted + rung.seconds
        slowly = self.wasted > WASTED and self.failed >= FEW and not self.c.adaptive
        if slowly or self.failed == FAILURES:
            return self._drop(f"{self.failed} runs in a row ended as {rung.status}")
        return ""

    def _finish_reason(self, rungs: list[Rung]) -> str:
        """Why to end: the finest accuracy is reached, or a further run would take too long to compile; else ""."""
        rung = rungs[-1]
        if rung.error <= self.task.testable_accuracies[-1]:
            return "reached the finest accuracy"
        if self.c.adaptive and len(rungs) > 1 and self.preparing > PREPARING:
            return f"it takes more than {PREPARING:g} s to compile from a tolerance of {rung.tol:g} on"
        return ""

    def _beaten(self, rungs: list[Rung]) -> str:
        """Why to end: others are far cheaper at this error, or the error is down to round-off; else ""."""
        rung, coarsest = rungs[-1], self.task.testable_accuracies[0]
        if hopeless(self.task, rung, self.known):
            best, by = self.known.cheapest(min(rung.error, coarsest))
            times = f"{rung.seconds / best:.0f} times as long as {by}"
            return self._drop(f"at an error of {rung.error:.1g} it took {times}")
        if rung.error > coarsest:
            return ""
        best, by = self.known.cheapest(rung.error)
        if rung.seconds > KEEP * best and self.lost == LOSING - 1:
            rung = rungs[-1] = self.task.retime(self.c, rung)
        ratio = rung.seconds / best
        self.lost = self.lost + 1 if ratio > KEEP and ratio > NEARER * self.before else 0
        self.before = ratio
        if self.lost >= LOSING:
            return self._drop(f"at an error of {rung.error:.1g} it took {ratio:.1f} times as long as {by}")
        errors = [r.error for r in rungs]
        if idle(errors) >= STANDING and min(errors) < ROUND_OFF:
            return f"its error stays at {min(errors):.1g}: round-off"
        return ""

    def _too_long(self, rungs: list[Rung]) -> str:
        """Why to end: a run takes much longer than the fastest integrator needs for the finest accuracy; else ""."""
        rung = rungs[-1]
        limit = max(FREE, LONGEST * self.dear, min(HOPELESS * self.dear, PATIENCE) if eases(rungs) else 0.0)
        if rung.seconds > limit:
            rung = rungs[-1] = self.task.retime(self.c, rung)
        if rung.seconds > limit:
            least = min(r.error for r in rungs)
            self.dropped = least > self.task.testable_accuracies[0]
            off = f"it is off by {least:.1g}" if least < inf else "it does not come to the end"
            finest = self.task.testable_accuracies[-1]
            return f"{off} in more than {LONGEST:g} times the time in which the best reach {finest:g}"
        if rung.seconds > 10 * PATIENCE:
            return self._drop(f"a run took {rung.seconds:.2g} s")
        return ""


# -- the finals --------------------------------------------------------------------------------------------------------


def refine(task: Task, c: Integrator, rungs: list[Rung], wanted: float) -> Rung:
    """The cheapest run of the integrator whose error is at most ``wanted``; further runs are added to ``rungs``."""
    low, (high, *_) = bracket(rungs, wanted)
    for _ in range(REFINED if low is not None else 0):
        size = _between(task, low, high, wanted)
        if size is None:
            break
        rung = task.measure(c, **size)
        rungs.append(rung)
        if rung.error <= wanted:
            high = rung
        else:
            low = rung
    rungs.sort(key=lambda r: r.fineness)
    meeting = bracket(rungs, wanted)[1]
    found = cheapest(meeting)
    return found if found is meeting[0] else cheapest([task.retime(c, r) for r in (meeting[0], found)])


def _between(task: Task, low: Rung, high: Rung, wanted: float) -> dict | None:
    """The steps or tol between two runs at which the error ``wanted`` is expected; None if they are too close."""
    fineness = aim(low, high, wanted)
    if low.steps is None:
        return {"tol": float(f"{1 / fineness:.3g}")} if high.tol < APART * low.tol else None
    steps = task.quantity.steps(min(SPARE * fineness, high.steps))
    return {"steps": steps} if low.steps < steps < high.steps and high.steps > SPARE * low.steps else None


def rounds(seconds: Iterable[float], within: float, least: int, most: int) -> int:
    """Number of rounds, a run of each integrator of these ``seconds``, that fit into ``within`` seconds."""
    return int(min(most, max(least, within / sum(max(s, LEAST) for s in seconds))))
