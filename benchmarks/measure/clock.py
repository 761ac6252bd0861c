"""Times one integration in the same way for methods and peers: a prepared, warm run without output.

Peers are integrators of other packages.  The measured time is that of a prepared run's ``advance``: the reset to the
initial state and the integrator's own call.  A first run is not counted.  Runs shorter than `LEAST` are repeated until
they last that long together, each from a start that differs in the last digits, so that no processor adapts to one
orbit.  CPU time of the thread is measured beside wall time: a reading in which they differ by more than `SHARED` was
disturbed by other processes and is repeated.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.prepared import PreparedRun
    from phasebench.reference.peers.prepared import PreparedPeer

    from .integrator import Integrator

#: Least seconds that the runs of one reading last together, and largest number of them.
LEAST, MOST = 1e-4, 400
#: Number of different starts of repeated runs; start k is the initial state times 1 + k eps.
STARTS = 16
#: Largest excess of wall time over CPU time, as a share of it; and how often a disturbed reading is repeated.
SHARED, AGAIN = 0.05, 5
#: Disturbed readings up to this share of all are not reported.
RARELY = 0.02
#: A run of more seconds is not warmed up: its first reading counts.
COLD = 0.05
#: Share of the span in `call`; integrating it costs nothing but the call.
SHORTEST = 1e-9
EPS = float(np.finfo(float).eps)


@dataclass
class Sharing:
    """Counts of time measurements that other processes on the same core disturbed.

    Attributes
    ----------
    readings, repeated : number of all measurements, and of those found disturbed
    disturbed : number of integrations whose last repetition was still disturbed
    """

    readings: int = 0
    repeated: int = 0
    disturbed: int = 0

    def summary(self) -> str:
        """A sentence on disturbed timings; "" if at most the share `RARELY` of the readings stayed disturbed."""
        if self.disturbed <= RARELY * self.readings:
            return ""
        return (
            f"other processes shared the core: {self.repeated} of {self.readings} readings of the clock were taken "
            f"again and {self.disturbed} stayed disturbed; times are upper bounds"
        )


@dataclass
class Clock:
    """A callable without arguments that times one integration and returns its seconds.

    Attributes
    ----------
    run : a prepared (compiled) run, with the methods ``restart(q, p)`` and ``advance(*size)``
    size : the arguments of ``advance``: (h, steps), or (t_end,) if the integrator is adaptive
    start, sharing : the initial state (q0, p0), arrays (d,); counts of disturbed measurements
    """

    run: Any
    size: tuple
    start: tuple[Sequence[float], Sequence[float]]
    sharing: Sharing = field(default_factory=Sharing)
    _starts: list = field(default_factory=list, repr=False)

    def __call__(self) -> float:
        """Time one or more runs and return the mean seconds of a run; repeated if other processes shared the core."""
        taken = 0
        if not self._starts:
            seconds, shared = self._warm()
            if seconds > COLD:
                taken = 1
                if self._is_undisturbed(shared):
                    return seconds
        for _ in range(1 + AGAIN - taken):
            seconds, shared = self._reading(self._starts)
            if self._is_undisturbed(shared):
                return seconds
        self.sharing.disturbed += 1
        return seconds

    def _is_undisturbed(self, shared: bool) -> bool:
        self.sharing.readings += 1
        self.sharing.repeated += shared
        return not shared

    def _warm(self) -> tuple[float, bool]:
        """Time a first run (a second, if it is short), and choose from it how many runs are timed together later."""
        q, p = (np.asarray(x, dtype=float) for x in self.start)
        once, shared = self._reading([(q, p)])
        if once < COLD:
            once, shared = self._reading([(q, p)])
        count = min(MOST, ceil(LEAST / max(once, 1e-9)))
        distinct = [(q * (1 + k * EPS), p * (1 + k * EPS)) for k in range(min(count, STARTS))]
        self._starts = [distinct[k % len(distinct)] for k in range(count)]
        return once, shared

    def _reading(self, starts: list) -> tuple[float, bool]:
        """Time a run from each start (q, p): (mean seconds of a run, True if other processes shared the core)."""
        restart, advance, size, spent = self.run.restart, self.run.advance, self.size, 0.0
        clock = time.perf_counter
        thread, wall = time.thread_time(), clock()
        for q, p in starts:
            restart(q, p)
            began = clock()
            advance(*size)
            spent += clock() - began
        wall, thread = clock() - wall, time.thread_time() - thread
        return spent / len(starts), wall > (1 + SHARED) * thread


def clock(
    integrator: Integrator,
    problem: Problem,
    *,
    t_end: float,
    steps: int | None = None,
    tol: float | None = None,
    run: PreparedRun | PreparedPeer | None = None,
    sharing: Sharing | None = None,
) -> Clock:
    """Make the timer of an integrator; ``run`` is its prepared run, None to prepare it now."""
    run = integrator.prepare(problem, tol=tol) if run is None else run
    size = (t_end,) if integrator.adaptive else (t_end / steps, steps)
    return Clock(run, size, (problem.q0, problem.p0), Sharing() if sharing is None else sharing)


def call(
    integrator: Integrator,
    problem: Problem,
    *,
    t_end: float,
    steps: int | None = None,
    tol: float | None = None,
    run: PreparedRun | PreparedPeer | None = None,
) -> float:
    """Measure the seconds of a call that integrates almost nothing: one step, or the share `SHORTEST` of the span.

    ``run`` is the integrator's prepared run, None to prepare it now.
    """
    if integrator.adaptive:
        return clock(integrator, problem, t_end=SHORTEST * t_end, tol=tol, run=run)()
    return clock(integrator, problem, t_end=t_end / steps, steps=1, run=run)()


@dataclass
class Clocks:
    """Timers of several integrators on one problem to ``t_end``, each integrator prepared once per tolerance."""

    problem: Any
    t_end: float
    sharing: Sharing = field(default_factory=Sharing)
    _runs: dict[tuple, Any] = field(default_factory=dict, repr=False)

    def ready(self, integrator: Integrator, tol: float | None = None) -> bool:
        """True if the integrator's run at this tolerance is already prepared."""
        return (integrator.label, tol) in self._runs

    def of(self, integrator: Integrator, *, steps: int | None = None, tol: float | None = None) -> Clock:
        """Return the timer (`Clock`) of an integrator with a number of steps or a tolerance."""
        key = (integrator.label, tol)
        if key not in self._runs:
            self._runs[key] = integrator.prepare(self.problem, tol=tol)
        size = {"t_end": self.t_end, "steps": steps, "tol": tol}
        return clock(integrator, self.problem, **size, run=self._runs[key], sharing=self.sharing)

    def call(self, integrator: Integrator, *, steps: int | None = None, tol: float | None = None) -> float:
        """Measure the seconds of a call of an integrator that integrates almost nothing."""
        size = {"t_end": self.t_end, "steps": steps, "tol": tol}
        return call(integrator, self.problem, **size, run=self._runs.get((integrator.label, tol)))
