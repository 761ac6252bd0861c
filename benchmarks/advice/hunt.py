"""The search behind advice: try integrators one after another, the most promising first, within a time limit."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite
from typing import Any

from phasebench.benchmarks.ladder.rung import Rung, Task
from phasebench.benchmarks.ladder.search import LOOSEST, Found, best_within, search
from phasebench.benchmarks.ladder.trial import REMARK, Trial, exact
from phasebench.benchmarks.measure import conservation_claims
from phasebench.benchmarks.measure.compilation import Failed, compilation_error
from phasebench.benchmarks.measure.integrator import OURS, Integrator
from phasebench.benchmarks.measure.integrator import integrator as integrator_of
from phasebench.benchmarks.measure.quantities import Truth
from phasebench.integrators.driver import OK
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.registry import BY_ID as METHODS

from . import prior, words
from .ask import Ask
from .deadline import TimeUp, deadline
from .portfolio import FIRST, Dropped

#: The shares of the time limit after which no further integrator is tried, and the one that is being tried is stopped.
SEARCHED, STOPPED = 0.7, 0.85
#: Integrators expected to be this many times dearer than the cheapest are not tried.
HOPELESS = 6.0
#: The integrators of each side that stored measurements expect within `PROMISING` times its cheapest, the first `MOST`,
#: are tried even if compiling them takes longer than the search may: without them the answer is not the cheapest.
PROMISING, MOST = 2.5, 6
#: This project's integrators, and the peers.
SIDES = (True, False)
#: Seconds assumed for compiling a family's kernel until one has been measured.
COLD = 0.5
#: A run may take LONGEST times the cheapest so far; PATIENCE seconds while there is none.
LONGEST, PATIENCE = 5.0, 3.0
#: The number of steps assumed if heyoka cannot count them; the part of the span on which heyoka counts them.
UNPACED, PART = 100, 1 / 50
#: The accuracy at which the search begins if a time budget is given.
MIDDLE = 1e-6


class Candidate:
    """An integrator with a run that meets the accuracy or the time budget, and its measured times."""

    def __init__(self, trial: Trial, rung: Rung) -> None:
        self.trial, self.rung, self.seconds = trial, rung, rung.seconds
        #: The interval of the seconds if it was timed in turns with others.
        self.interval: tuple[float, float] | None = None

    @property
    def integrator(self) -> Integrator:
        """The candidate's integrator."""
        return self.trial.integrator

    def __call__(self) -> float:
        """Run the integration once more and return its seconds."""
        return self.trial.seconds(self.rung)

    def row(self, ask: Ask, problem_words: Sequence[str] | None) -> dict[str, Any]:
        """The candidate as a dict of the answer."""
        rung = self.rung
        how = {"tol": rung.tol} if rung.steps is None else {"h": ask.t_end / rung.steps, "steps": rung.steps}
        return {
            "integrator": self.integrator.id,
            "params": {k: str(v) for k, v in self.integrator.record.parameters.items()},
            **how,
            "model": "full",
            "command": words.command(ask, self.integrator, rung.size, problem_words),
            "error": rung.error,
            "uncertainty": self.trial.task.truth.uncertainty,
            "seconds": self.seconds,
            "interval": self.interval,
            "remark": REMARK if self.exact(ask) else "",
        }

    def exact(self, ask: Ask) -> bool:
        """True if the integrator is exact on the problem and took the fewest steps possible."""
        return exact(self.integrator, ask.problem) and self.rung.steps == ask.quantity.steps(1)


class Search:
    """A search for the cheapest integration: the question, the runs made, the candidates found, integrators dropped."""

    def __init__(self, ask: Ask, true: Truth) -> None:
        self.ask, self.true = ask, true
        self.found: list[Candidate] = []
        self.trials: list[Trial] = []
        self.dropped: list[Dropped] = []
        self.failed: list[Failed] = []
        #: What the time limit left out that could have changed the answer: ids of promising integrators, and words.
        self.unfinished: list[str] = []
        #: How many steps heyoka takes, once known; each is about a tenth of a revolution.
        self.pace: int | None = None
        #: The families whose kernels are compiled, and the longest time that a new one took.
        self.families: set[str] = set()
        self.cold = COLD

    def task(self) -> Task:
        """The question as a `Task` (problem, span, quantity, true value) for one integrator, with its own clocks."""
        return Task(self.ask.problem, self.ask.t_end, self.ask.quantity, self.true)

    def cheapest(self, integrator: Integrator) -> float:
        """Seconds of the cheapest candidate so far of the same side, this project's methods or peers."""
        side = integrator.kind == OURS
        return min((c.seconds for c in self.found if (c.integrator.kind == OURS) is side), default=inf)

    @property
    def all_own_failed(self) -> bool:
        """True if methods of this project were tried and none of them compiled."""
        compiled = any(t.integrator.kind == OURS for t in self.trials)
        return not compiled and any(f.integrator in METHODS for f in self.failed)

    def over(self, share: float = SEARCHED, limit: float | None = None) -> bool:
        """True if the search has used up more than the fraction ``share`` of ``limit`` seconds."""
        return self.ask.spent > share * (self.ask.limit if limit is None else limit)

    def try_all(self, members: Sequence[tuple[Integrator, float]]) -> None:
        """Try the (integrator, expected time over that of the cheapest) in turn; drop those for which no time is left.

        Those expected to be far too slow are dropped, too: methods against methods, peers against peers.
        """
        dear = {side: HOPELESS * min([x for i, x in members if _own(i) is side], default=1.0) for side in SIDES}
        promising = _promising(members)
        for integrator, expected in members:
            limit = self.ask.first_use if integrator.id in promising else self.ask.limit
            sides = {_own(c.integrator) for c in self.found}
            least = min(max(dear[_own(integrator)], HOPELESS), prior.LARGEST - 1)
            late = self.over(limit=limit) or self.too_cold(integrator, limit)
            if late and (self.trials or self.ask.since is None):  # a limit of the clock stops the first trial itself
                self.drop(integrator, "not tried: the time for the search was over")
                self.unfinished += {integrator.id} & promising
            elif expected > least and len(sides) == 2 and integrator.id != FIRST:
                times = f"{expected:.0f} times" if expected < prior.LARGEST else "many times"
                self.drop(integrator, f"not tried: {times} dearer than the cheapest where it was measured")
            else:
                self.ask.progress(f"trying {integrator.label}")
                before = self.ask.spent
                try:
                    with deadline(self.ask.left - (1 - STOPPED) * self.ask.limit):
                        self.attempt(integrator)
                except TimeUp:
                    self.drop(integrator, "not tried to the end: the time for the search was over")
                    self.unfinished.append(integrator.id)
                if _own(integrator) and integrator.record.family not in self.families:
                    self.families.add(integrator.record.family)
                    self.cold = max(self.cold, self.ask.spent - before)

    def too_cold(self, integrator: Integrator, limit: float) -> bool:
        """True if the integrator's kernel is not compiled yet and the limit in seconds leaves no time to compile it."""
        known = not _own(integrator) or integrator.record.family in self.families
        return not known and self.ask.spent + self.cold > limit and bool(self.families)

    def drop(self, integrator: Integrator, why: str) -> None:
        """Record why an integrator is not advised."""
        self.dropped.append(Dropped(integrator.id, why))

    def attempt(self, integrator: Integrator) -> None:
        """Search for the step or tolerance at which an integrator meets the accuracy or budget; record the outcome."""
        ask, cheapest = self.ask, self.cheapest(integrator)
        most = max(LONGEST * cheapest, 0.05) if isfinite(cheapest) else PATIENCE
        trial = Trial(integrator, self.task(), most)
        self.trials.append(trial)
        try:
            if ask.budget is None:
                found = search(trial, ask.accuracy, self.start(trial, ask.accuracy), cheapest)
            else:
                found = best_within(trial, ask.budget, self.start(trial, MIDDLE))
        except TimeUp:
            met = [] if ask.conserve or not ask.accuracy else trial.meeting(ask.accuracy)
            self.found += [Candidate(trial, min(met, key=lambda r: r.seconds))] if met else []
            raise
        except Exception as error:  # an error of one integrator does not end the search
            if why := compilation_error(error):
                self.trials.remove(trial)
                self.failed.append(Failed(integrator.id, why))
                return
            found = Found(None, f"fails: {type(error).__name__}: {error}")
        if integrator.id == FIRST and trial.rungs:
            self.pace = max(r.taken for r in trial.rungs.values())
        broken = found.rung and ask.conserve and conservation_claims.broken(integrator, ask, found.rung.size)
        if found.rung is None or broken:
            self.drop(integrator, broken or found.why)
        else:
            self.found.append(Candidate(trial, found.rung))

    def start(self, trial: Trial, accuracy: float) -> float:
        """The tolerance or the number of steps at which the search for an integrator's cheapest run begins.

        Too coarse a start costs little: all runs up to the one that meets the accuracy cost less than that one.
        """
        if trial.integrator.adaptive:
            return min(max(accuracy / 10, trial.integrator.record.least), LOOSEST)
        if exact(trial.integrator, self.ask.problem):
            return 1.0
        if self.pace is None:
            self.pace = self._pace()
        return self.pace / 4

    def _pace(self) -> int:
        """Number of steps that heyoka takes on the span, extrapolated from a part of it; at least `UNPACED`."""
        part = self.ask.t_end * PART
        try:
            run = integrator_of(FIRST).run(self.ask.problem, t_end=part, tol=MIDDLE, save_every=0)
        except (InvalidInput, ImportError):
            return UNPACED
        return max(UNPACED, round(run.counts["steps"] / PART)) if run.status == OK else UNPACED


def _own(integrator: Integrator) -> bool:
    return integrator.kind == OURS


def _promising(members: Sequence[tuple[Integrator, float]]) -> set[str]:
    """Ids of the integrators expected to be cheap: at most `MOST` methods of this project, and as many peers."""
    found: set[str] = set()
    for side in SIDES:
        ours = [(i.id, expected) for i, expected in members if _own(i) is side]
        least = min((expected for _, expected in ours), default=0.0)
        found |= set([id for id, expected in ours if expected <= PROMISING * least][:MOST])
    return found
