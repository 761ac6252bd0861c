"""Brute-force search for the fastest integrator that meets an accuracy, independent of the advice that it checks.

It shares with the advice only the integrators, the quantity and the clock; it has no ranking and does not extrapolate.
The size of a run is its number of steps or its tolerance.  For each integrator the size starts at one step, or at a
loose tolerance.  It is refined, the steps by a factor of `COARSE` or the tolerance by `TOLERANCE`, until a run meets
the accuracy or costs `DEAR` times the fastest so far; then numbers of steps between the last miss and the first hit are
searched in factors of `FINE`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasebench.benchmarks.measure import clock, conservation_claims
from phasebench.benchmarks.measure.integrator import OURS, Integrator
from phasebench.benchmarks.measure.quantities import Truth, error
from phasebench.integrators.driver import OK
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.registry import METHODS
from phasebench.reference.peers import PEERS

if TYPE_CHECKING:
    from phasebench.benchmarks.advice.ask import Ask
    from phasebench.integrators.solution import Solution

#: Factors between successive numbers of steps, in the coarse and in the fine search, and between tolerances.
COARSE, FINE, TOLERANCE = 1.5, 1.08, 3.0
#: The search ends at a run that misses the accuracy and takes this many times the seconds of the fastest so far.
DEAR = 2.0
FEWEST, LOOSEST, RUNGS = 1, 0.1, 45
#: Time limit of a run in seconds while no integrator meets the accuracy yet.
LONGEST = 1.0
#: Runs shorter than this (seconds) are timed again, warm and repeatedly.
SHORT = 0.05
#: The time of a run that cannot be stopped is estimated from the share `PART` of the span; an integrator is given up
#: where the estimate exceeds `HOPELESS` times the fastest so far.
PART, HOPELESS = 1 / 50, 20.0
#: Margin for a rerun in another process: the error may grow by `SLACK` of itself and `ROUND_OFF` of the quantity.
SLACK, ROUND_OFF = 0.02, 8 * float(np.finfo(float).eps)
#: The integrator tried first, which sets a time to beat; integrators left out: batches of orbits, loops in Python.
FIRST, LEFT_OUT = "heyoka", ("heyoka-batch",)
COMPILED = (OURS, "heyoka", "rebound", "scipy", "boost", "gsl", "pynamicalsys")


class Run(NamedTuple):
    """A run: its number of steps or tolerance, whether it reached the end, its error, its time without output."""

    size: float
    ok: bool
    error: float
    seconds: float


@dataclass
class Runs:
    """The runs of one integrator on one request for advice, by size (number of steps, or tolerance).

    Attributes
    ----------
    integrator, ask, true : the integrator, the request, and the reference values of its quantity
    longest : seconds after which a method of this project is stopped
    made : the runs so far, by size
    clocks : timers of warm runs on the request's problem and span
    """

    integrator: Integrator
    ask: Any
    true: Truth
    longest: float = LONGEST
    made: dict[float, Run] = field(default_factory=dict)
    clocks: clock.Clocks = field(init=False)

    def __post_init__(self) -> None:
        self.clocks = clock.Clocks(self.ask.problem, self.ask.t_end)

    def met(self, run: Run) -> bool:
        """True if a run meets the requested accuracy with a margin.

        The margin is for the reference's error, and for the different round-off when the run is made again.
        """
        size = float(np.abs(self.true.values).max(initial=0.0))
        slack = self.true.uncertainty + ROUND_OFF * max(size, 1.0 if self.ask.quantity.kept else 0.0)
        return run.ok and (1 + SLACK) * run.error + slack <= self.ask.accuracy

    def at(self, size: float) -> Run:
        """The run of a size, integrated on the first call; its error is infinite if the integrator refuses it."""
        if not self.integrator.adaptive:
            size = self.ask.quantity.steps(size)
        if size not in self.made:
            try:
                self.made[size] = self._run(size)
            except InvalidInput:
                self.made[size] = Run(size, False, inf, inf)
        return self.made[size]

    def _run(self, size: float) -> Run:
        """A run: its seconds are those of one without output, its error that of one that stores rows."""
        quantity, given = self.ask.quantity, self.size_argument(size)
        stop = {"timeout": self.longest} if self.integrator.stoppable else {}
        bare = self.solution(**given, save_every=0, **stop)
        rows = quantity.rows > 1 and bare.status == OK
        again = bare.seconds < SHORT or (rows and self.integrator.rows_end_steps)
        seconds = self.seconds(size) if bare.status == OK and again else bare.seconds
        told = self.solution(**quantity.grid(**given), **stop) if rows else bare
        return Run(size, told.status == OK, error(self.ask.problem, quantity, told, self.true), seconds)

    def solution(self, part: float = 1.0, **more: Any) -> Solution:
        """The solution over the first ``part`` (a share from 0 to 1) of the span; ``more`` are options of the run."""
        return self.integrator.run(self.ask.problem, t_end=part * self.ask.t_end, **more)

    def size_argument(self, size: float) -> dict[str, float]:
        """The size of a run as its keyword argument."""
        return {"tol": size} if self.integrator.adaptive else {"steps": int(size)}

    def seconds(self, size: float) -> float:
        """The seconds of a compiled run, without rows unless its steps end at them: it would be another run."""
        given, quantity = self.size_argument(size), self.ask.quantity
        if quantity.rows > 1 and self.integrator.rows_end_steps:
            return self.solution(**quantity.grid(**given)).seconds
        if not self.integrator.preparable:
            return self.solution(**given, save_every=0).seconds
        return self.clocks.of(self.integrator, **given)()

    def estimate_seconds(self, size: float) -> float:
        """The seconds of a run by those of the first `PART` of the span; 0 if a time limit can stop it, or it fails."""
        if self.integrator.stoppable:
            return 0.0
        shorter = size if self.integrator.adaptive else max(1, round(size * PART))
        try:
            done = self.solution(PART, **self.size_argument(shorter), save_every=0)
        except InvalidInput:
            return 0.0
        return done.seconds / PART if done.status == OK else 0.0


class Best(NamedTuple):
    """The fastest run, all ``runs`` of its integrator, the number ``tried`` of integrators, the count of their runs."""

    runs: Runs
    run: Run
    tried: int
    count: int


def everybody(ask: Ask) -> Iterator[Integrator]:
    """The installed integrators of `COMPILED` that can handle a request (its problem and invariants), heyoka first."""
    for record in sorted((*METHODS, *PEERS), key=lambda r: r.id != FIRST):
        c = Integrator(record)
        if c.id in LEFT_OUT or c.kind not in COMPILED or not c.installed or c.lacks(ask.problem):
            continue
        if not conservation_claims.refusal(c, ask.conserve):
            yield c


def best(ask: Ask, true: Truth) -> Best | None:
    """The fastest run of any integrator that meets the accuracy of a request; None where none does."""
    found, tried, count, cheapest = None, 0, 0, inf
    for integrator in everybody(ask):
        runs = Runs(integrator, ask, true, min(LONGEST, 3 * DEAR * cheapest))
        run = cheapest_of(runs, cheapest)
        tried, count = tried + 1, count + len(runs.made)
        if run is not None and run.seconds < cheapest and _keeps(runs, run):
            found, cheapest = (runs, run), run.seconds
    return found and Best(*found, tried, count)


def _keeps(runs: Runs, run: Run) -> bool:
    """True if a run conserves what the request wants conserved."""
    ask = runs.ask
    return not ask.conserve or conservation_claims.broken(runs.integrator, ask, runs.size_argument(run.size)) is None


def cheapest_of(runs: Runs, cheapest: float) -> Run | None:
    """One integrator's fastest run that meets the accuracy; None if there is none or it is hopelessly slow.

    ``runs`` collects the runs made; ``cheapest`` are the seconds of the fastest run of the integrators before it.
    """
    adaptive, met = runs.integrator.adaptive, runs.met
    at, last = (LOOSEST if adaptive else float(FEWEST)), None
    for _ in range(RUNGS):
        if adaptive and at < runs.integrator.record.least:
            return None
        if runs.estimate_seconds(at) > max(HOPELESS * cheapest, LONGEST):
            return None
        run = runs.at(at)
        if met(run):
            break
        if (run.ok and run.seconds > DEAR * cheapest) or run.seconds > runs.longest:
            return None
        last, at = at, (at / TOLERANCE if adaptive else max(at + 1, round(at * COARSE)))
    else:
        return None
    if last is not None and not adaptive and run.seconds < DEAR * cheapest:
        finer = last * FINE
        while finer < at:
            runs.at(round(finer))
            finer = max(finer * FINE, finer + 1)
    return min(filter(met, runs.made.values()), key=lambda r: r.seconds)
