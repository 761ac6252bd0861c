"""The candidates of an ask, tried one after another: the most promising first, while there is time and hope."""

from __future__ import annotations

import time
from collections.abc import Sequence
from math import inf, isfinite
from typing import Any

from phasebench.benchmarks.measure.compilation import Failed, compilation_error
from phasebench.benchmarks.measure.integrator import OURS, Integrator
from phasebench.benchmarks.measure.quantities import Truth
from phasebench.integrators.registry import BY_ID as METHODS

from . import kept, prior, words
from .ask import Ask
from .exact import REMARK, exact
from .portfolio import FIRST, Dropped
from .search import LOOSEST, Found, best_within, search
from .trial import Point, Trial

#: The share of the limit after which nobody new is tried.
SEARCHED = 0.7
#: Integrators that are to be expected to be so many times dearer than the cheapest are not tried.
HOPELESS = 6.0
#: Seconds that a family's kernel takes to be compiled, until one was.
COLD = 0.5
#: A run of a candidate may take so many times the cheapest so far, and so many seconds at first.
LONGEST, PATIENCE = 5.0, 3.0
#: The accuracy in whose neighbourhood the search for the best within a time begins.
MIDDLE = 1e-6


class Candidate:
    """An integrator at a size that meets what is asked, with its times."""

    def __init__(self, trial: Trial, point: Point):
        self.trial, self.point, self.seconds = trial, point, point.seconds

    @property
    def integrator(self) -> Integrator:
        """Who."""
        return self.trial.integrator

    def __call__(self) -> float:
        """The seconds of a run."""
        return self.trial.seconds(self.point.size)

    def row(self, ask: Ask, problem_words: Sequence[str] | None) -> dict[str, Any]:
        """What is said of it."""
        size = self.point.size
        how = {"tol": size["tol"]} if "tol" in size else {"h": ask.t_end / size["steps"], "steps": size["steps"]}
        return {
            "integrator": self.integrator.id,
            "params": {k: str(v) for k, v in self.integrator.record.parameters.items()},
            **how,
            "model": "full",
            "command": words.command(ask, self.integrator, size, problem_words),
            "error": self.point.error,
            "uncertainty": self.trial.true.uncertainty,
            "seconds": self.seconds,
            "remark": REMARK if self.exact(ask) else "",
        }

    def exact(self, ask: Ask) -> bool:
        """Whether it is exact on the problem, and one step was enough."""
        return exact(self.integrator, ask.problem) and self.point.size.get("steps") == ask.quantity.steps(1)


class Search:
    """The candidates of an ask, as they are found."""

    def __init__(self, ask: Ask, true: Truth, began: float):
        self.ask, self.true, self.began = ask, true, began
        self.found: list[Candidate] = []
        self.trials: list[Trial] = []
        self.dropped: list[Dropped] = []
        self.failed: list[Failed] = []
        #: How many steps heyoka takes, once known: a tenth of a revolution each, or so.
        self.pace: int | None = None
        #: The families whose kernels are compiled, and the longest time that a new one took.
        self.families: set[str] = set()
        self.cold = COLD

    def cheapest(self, integrator: Integrator) -> float:
        """The seconds of the cheapest so far on the same side: this project's, or the others'."""
        side = integrator.kind == OURS
        return min((c.seconds for c in self.found if (c.integrator.kind == OURS) is side), default=inf)

    @property
    def spent(self) -> float:
        """Seconds of the processor since the beginning: a machine that is shared is given the time that it takes."""
        return time.process_time() - self.began

    @property
    def all_own_failed(self) -> bool:
        """True if methods of this project were tried and none of them compiled."""
        compiled = any(t.integrator.kind == OURS for t in self.trials)
        return not compiled and any(f.integrator in METHODS for f in self.failed)

    def over(self, share: float = SEARCHED) -> bool:
        """Whether the time for trying is."""
        return self.spent > share * self.ask.limit

    def try_all(self, members: Sequence[tuple[Integrator, float]]) -> None:
        """Try the members in turn, while there is time and hope."""
        for integrator, expected in members:
            sides = {c.integrator.kind == OURS for c in self.found}
            if self.over() or self.too_cold(integrator):
                self.drop(integrator, "not tried: the time for the search was over")
            elif expected > HOPELESS and len(sides) == 2 and integrator.id != FIRST:
                times = f"{expected:.0f} times" if expected < prior.LARGEST else "many times"
                self.drop(integrator, f"not tried: {times} dearer than the cheapest where it was measured")
            else:
                self.ask.progress(f"trying {integrator.label}")
                before = self.spent
                self.attempt(integrator)
                if integrator.kind == OURS and integrator.record.family not in self.families:
                    self.families.add(integrator.record.family)
                    self.cold = max(self.cold, self.spent - before)

    def too_cold(self, integrator: Integrator) -> bool:
        """Whether a kernel would have to be compiled for which there is no time."""
        known = integrator.kind != OURS or integrator.record.family in self.families
        return not known and self.spent + self.cold > self.ask.limit and bool(self.families)

    def drop(self, integrator: Integrator, why: str) -> None:
        """Say why one is not advised."""
        self.dropped.append(Dropped(integrator.id, why))

    def attempt(self, integrator: Integrator) -> None:
        """Look for the size at which one meets what is asked."""
        ask, cheapest = self.ask, self.cheapest(integrator)
        most = max(LONGEST * cheapest, 0.05) if isfinite(cheapest) else PATIENCE
        trial = Trial(integrator, ask, self.true, most)
        self.trials.append(trial)
        try:
            if ask.budget is None:
                found = search(trial, ask.accuracy, self.start(trial, ask.accuracy), cheapest)
            else:
                found = best_within(trial, ask.budget, self.start(trial, MIDDLE))
        except Exception as error:  # whatever it is, it is this candidate's
            if why := compilation_error(error):
                self.trials.remove(trial)
                self.failed.append(Failed(integrator.id, why))
                return
            found = Found(None, f"fails: {type(error).__name__}: {error}")
        if integrator.id == FIRST and trial.points:
            self.pace = max(p.steps for p in trial.points.values())
        broken = found.point and ask.conserve and kept.broken(integrator, ask, found.point.size)
        if found.point is None or broken:
            self.drop(integrator, broken or found.why)
        else:
            self.found.append(Candidate(trial, found.point))

    def start(self, trial: Trial, accuracy: float) -> float:
        """The first size to try: a tolerance near the accuracy, or steps from the orbit's pace; 1 where it is exact."""
        if trial.integrator.adaptive:
            return min(max(accuracy / 10, trial.integrator.record.least), LOOSEST)
        if exact(trial.integrator, self.ask.problem):
            return 1.0
        n = (self.pace or 100) / 4
        order = trial.integrator.order or 2
        return n * min((n / accuracy) ** (1 / order), 100.0)
