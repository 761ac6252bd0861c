"""`Rung`, a run of an integrator at one size with its error and its time, and `Task`, which measures it."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf, isfinite
from typing import Any, NamedTuple

from phasebench.benchmarks.measure import clock, quantities
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.quantities import Quantity, Truth
from phasebench.integrators.driver import INVALID, OK
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import Method
from phasebench.integrators.solution import Solution

#: Shorter runs are timed by `measure.clock`; a longer run without output rows counts with its own seconds.
SHORT = 0.05
#: A method's run without output is compiled only if its time with output, less `OVERHEAD` seconds for the output, is
#: within the factor `WORTH` of the cheapest.
OVERHEAD, WORTH = 3e-4, 6.0
#: Runs of up to `LONG` seconds are timed `AGAIN` more times.
LONG, AGAIN = 0.2, 3


class Rung(NamedTuple):
    """A run of an integrator at one size, a number of steps or a tolerance, with its error and its time.

    Attributes
    ----------
    error : of the quantity to be computed; infinite if the run did not reach its end
    seconds : the time of a warm run without output; with output if the integrator's steps end at rows (`Task.timer`)
    taken, evaluations : the steps and the gradients that the run counted
    """

    steps: int | None
    tol: float | None
    status: str
    error: float
    seconds: float
    taken: int = 0
    evaluations: int = 0
    reason: str = ""

    @property
    def ok(self) -> bool:
        """True if the run reached its end."""
        return self.status == OK

    @property
    def size(self) -> dict[str, Any]:
        """The size as the keyword argument of a run, {"steps": n} or {"tol": x}."""
        return {"tol": self.tol} if self.steps is None else {"steps": self.steps}

    @property
    def number(self) -> float:
        """The number of steps, or the tolerance."""
        return self.tol if self.steps is None else self.steps

    @property
    def fineness(self) -> float:
        """A number that rises as the run gets finer: steps, or one over the tolerance."""
        return 1 / self.tol if self.steps is None else float(self.steps)


def unbeaten(error: float) -> float:
    """Return infinity, whatever the error: the default of ``cheapest`` in `Task.measure`, if no other run is known."""
    return inf


@dataclass(frozen=True)
class Task:
    """A problem to integrate over a span, the quantity to compute, its true value, and the errors to be met.

    ``clocks`` are timers, one for each integrator prepared to run; they count how often the core was shared.
    """

    problem: Any
    t_end: float
    quantity: Quantity
    truth: Truth | None = None
    accuracies: tuple[float, ...] = ()
    clocks: clock.Clocks = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "clocks", clock.Clocks(self.problem, self.t_end))

    @property
    def testable_accuracies(self) -> tuple[float, ...]:
        """The accuracies that are not below the uncertainty of the reference."""
        return tuple(a for a in self.accuracies if self.truth.uncertainty <= a)

    def run(self, c: Integrator, size: dict[str, Any], *, bare: bool = False, timeout: float = inf) -> Solution:
        """Integrate the problem at ``size``, with the rows that the quantity needs, or none between if ``bare``."""
        rows = {**size, "save_every": 0} if bare else self.quantity.grid(**size)
        stop = {"timeout": timeout} if c.stoppable and isfinite(timeout) else {}
        return c.run(self.problem, t_end=self.t_end, **rows, **stop)

    def measure(
        self,
        c: Integrator,
        *,
        steps: int | None = None,
        tol: float | None = None,
        timeout: float = inf,
        cheapest: Callable[[float], float] = unbeaten,
    ) -> Rung:
        """Run an integrator with ``steps`` or ``tol`` and measure error and time.

        A second run, without output, is timed if the first was short or had output rows, unless the integrator is too
        slow anyway (`beaten`); ``cheapest`` maps an error to the least seconds in which others reach it.
        """
        size = {"tol": tol} if steps is None else {"steps": steps}
        try:
            found = self.run(c, size, timeout=timeout)
            error = quantities.error(self.problem, self.quantity, found, self.truth)
            seconds = found.seconds
            clocked = self.quantity.rows > 1 or seconds < SHORT
            if found.status == OK and clocked and not self.beaten(c, seconds, cheapest(error)):
                seconds = self.seconds(c, size)
        except InvalidInput as invalid:
            return Rung(steps, tol, INVALID, inf, inf, reason=str(invalid))
        counts = found.counts.get("steps", 0), found.counts.get("gradient", 0)
        return Rung(steps, tol, found.status, error, seconds, *counts, found.reason)

    def beaten(self, c: Integrator, seconds: float, cheapest: float) -> bool:
        """True if a method is so much slower than the cheapest that to compile it without output is not worth it."""
        if not isinstance(c.record, Method) or self.clocks.ready(c) or not self.quantity.aligned:
            return False  # a run with the many rows of an unaligned quantity says little of one without
        return seconds - OVERHEAD > WORTH * cheapest

    def timer(self, c: Integrator, size: dict[str, Any]) -> Callable[[], float]:
        """A function that times a warm run without output at ``size`` and returns its seconds.

        If the steps of an adaptive peer end at rows, it has those of which the error is taken: without them it would be
        another run.
        """
        with_rows = self.quantity.rows > 1 and c.rows_end_steps
        if with_rows or not c.preparable:
            return lambda: self.run(c, size, bare=not with_rows).seconds
        with warnings.catch_warnings():  # Numba calls functions in tuples experimental
            warnings.simplefilter("ignore")
            return self.clocks.of(c, **size)

    def seconds(self, c: Integrator, size: dict[str, Any]) -> float:
        """Seconds of a warm run, as `timer` measures them."""
        return self.timer(c, size)()

    def retime(self, c: Integrator, rung: Rung) -> Rung:
        """The run with the least of `AGAIN` more times; unchanged if it failed, takes long, or is not compiled."""
        unprepared = isinstance(c.record, Method) and not self.clocks.ready(c)
        if not rung.ok or rung.seconds > LONG or unprepared:
            return rung
        timed = self.timer(c, rung.size)
        return rung._replace(seconds=min(rung.seconds, *(timed() for _ in range(AGAIN))))
