"""`Trial`: the runs of an integrator on a task, each run once, and whether they meet an accuracy."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

import numpy as np

from phasebench.benchmarks.measure import quantities
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.problems.base import Problem
from phasebench.integrators.driver import DIVERGED, OK
from phasebench.integrators.errors import InvalidInput

from .rung import Rung, Task

#: Share of the span over which a run that may take long is tried first.
PART = 1 / 50
#: A kernel compiled in another process may round differently: an error then changes by less than `SLACK` times itself
#: plus `ROUND_OFF` times the size of the quantity.
SLACK, ROUND_OFF = 0.02, 8 * float(np.finfo(float).eps)
#: Seconds that a run with rows may take at least: it may take many times as long as the run without that is timed.
WITH_ROWS = 0.25
#: Largest number of steps of a run.
MOST = 10_000_000
#: Problem -> (families or ids of our methods, integrators of REBOUND) that are exact for it.
EXACT = {
    "kepler": ({"wisdom_holman", "fcirk"}, {"whfast", "whfast512", "saba", "mercurius", "trace"}),
    "harmonic-oscillator": (
        {"gautschi", "deuflhard", "mollified-impulse", "hochbruck-lubich", "hairer-lubich", "grimm-hochbruck"},
        set(),
    ),
}
#: The remark on such an integrator.
REMARK = "exact for this problem: any step"


@dataclass
class Trial:
    """The runs of an integrator on a task (problem, span, quantity), by number of steps or tolerance.

    ``longest`` is the time limit of a run in seconds: a method of this project is stopped then, and an integrator that
    takes longer without meeting the accuracy is given up.
    """

    integrator: Integrator
    task: Task
    longest: float
    rungs: dict[float, Rung] = field(default_factory=dict)

    def at(self, number: float, cheapest: float = inf) -> Rung:
        """Run the integrator with ``number`` steps or tolerance, or return the earlier run.

        A run that is much slower than ``cheapest`` seconds is not timed again.
        """
        if not self.integrator.adaptive:
            number = self.task.quantity.steps(number)
        if number not in self.rungs:
            size = {"tol": number} if self.integrator.adaptive else {"steps": int(number)}
            longest = self.longest if self.task.quantity.rows == 1 else max(self.longest, WITH_ROWS)
            limits = {"timeout": longest, "cheapest": lambda error: cheapest}
            self.rungs[number] = self.task.measure(self.integrator, **size, **limits)
        return self.rungs[number]

    @property
    def sorted_rungs(self) -> list[Rung]:
        """The runs so far, the coarsest first."""
        return sorted(self.rungs.values(), key=lambda r: r.fineness)

    @property
    def scale(self) -> float:
        """The size of the quantity, to which round-off is compared; at least 1 for a conserved one."""
        values = self.task.truth.values
        size = float(np.abs(values).max()) if len(values) else 0.0
        return max(size, 1.0 if self.task.quantity.kept else 0.0)

    def meets(self, rung: Rung, accuracy: float) -> bool:
        """True if a run meets an accuracy, with a margin for the reference's uncertainty and for round-off."""
        slack = self.task.truth.uncertainty + ROUND_OFF * self.scale
        return rung.ok and (1 + SLACK) * rung.error + slack <= accuracy

    def meeting(self, accuracy: float) -> list[Rung]:
        """The runs that meet the accuracy, the coarsest first."""
        return [r for r in self.sorted_rungs if self.meets(r, accuracy)]

    def repeat(self, rung: Rung) -> float:
        """Repeat an earlier run, ``rung``, and return its error in the quantity to be computed."""
        found = self.task.run(self.integrator, rung.size)
        return quantities.error(self.task.problem, self.task.quantity, found, self.task.truth)

    def seconds(self, rung: Rung) -> float:
        """Repeat an earlier run, ``rung``, warm, and return its seconds, as `Task.timer` measures them."""
        return self.task.seconds(self.integrator, rung.size)

    def pilot(self, number: float) -> float:
        """Estimate the seconds of a run from one over the share `PART` of the span; 0 where that is no use."""
        if self.integrator.stoppable:
            return 0.0
        part = {"tol": number} if self.integrator.adaptive else {"steps": max(1, round(number * PART))}
        try:
            done = self.integrator.run(self.task.problem, t_end=self.task.t_end * PART, **part, save_every=0)
        except InvalidInput:
            return 0.0
        return done.seconds / PART if done.status == OK else 0.0

    def failure(self) -> str:
        """How the finest run ended, as text: its status and the reason of its failure."""
        if not self.rungs:
            return DIVERGED
        rung = self.sorted_rungs[-1]
        return f"{rung.status}: {rung.reason}" if rung.reason else rung.status


def exact(c: Integrator, problem: Problem) -> bool:
    """True if the integrator solves the problem exactly at any step: its cost at a given error has no meaning."""
    of_ours, of_rebound = EXACT.get(problem.id, (set(), set()))
    settings = getattr(c.record, "settings", {})
    return bool({c.id, getattr(c.record, "family", None)} & of_ours) or settings.get("integrator") in of_rebound
