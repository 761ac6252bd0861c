"""The clock of one integration, the same for methods and peers: a prepared run, warm, with nothing read back.

Clocked is `advance`: the reset to the initial state and the integrator's own call.  A run is warmed up by one that is
not counted.  Runs shorter than `LEAST` are repeated until they last so long together, each from a start that differs
in the last digits, so that no processor learns one orbit by heart.  The time of the thread is taken beside the wall's:
a reading in which they differ by more than `SHARED` was disturbed by other processes, and is taken again.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import Any

import numpy as np

#: Seconds that the runs of one reading last together, at least, and the most runs of one.
LEAST, MOST = 1e-4, 400
#: Starts that a repeated run takes in turn; start k is the initial state times 1 + k eps.
STARTS = 16
#: The wall's time over the thread's, less 1, from which on the core was shared; readings taken again at most so often.
SHARED, AGAIN = 0.05, 5
#: Fewer readings than this share that stay disturbed are not worth telling.
RARELY = 0.02
#: A run of more seconds needs no warming up: its first counts.
COLD = 0.05
#: A span of so many units in the last place of the whole: what is left is the cost of a call.
SHORTEST = 1e-9
EPS = float(np.finfo(float).eps)


@dataclass
class Sharing:
    """How often the core was shared: readings, those that were taken again, and those that stayed disturbed."""

    readings: int = 0
    repeated: int = 0
    disturbed: int = 0

    def told(self) -> str:
        """What to know of the times; empty where fewer than `RARELY` of the readings stayed disturbed."""
        if self.disturbed <= RARELY * self.readings:
            return ""
        return (
            f"other processes shared the core: {self.repeated} of {self.readings} readings of the clock were taken "
            f"again and {self.disturbed} stayed disturbed; times are upper bounds"
        )


@dataclass
class Clock:
    """Seconds of one integration, each time it is called.

    Attributes
    ----------
    run : a prepared run
    size : what its `advance` is called with: (h, steps) or (t_end,)
    start : (q0, p0), arrays (d,)
    sharing : counts the readings that were disturbed
    """

    run: Any
    size: tuple
    start: tuple[Sequence[float], Sequence[float]]
    sharing: Sharing = field(default_factory=Sharing)
    _starts: list = field(default_factory=list, repr=False)

    def __call__(self) -> float:
        """The mean seconds of a run in one reading."""
        if not self._starts and (seconds := self._warm()) > COLD:
            self.sharing.readings += 1
            return seconds
        for _ in range(1 + AGAIN):
            seconds, shared = self._reading()
            self.sharing.readings += 1
            if not shared:
                break
            self.sharing.repeated += 1
        else:
            self.sharing.disturbed += 1
        return seconds

    def _warm(self) -> float:
        """The seconds of a first run, which count where it is long; sees from it how many make a reading."""
        q, p = (np.asarray(x, dtype=float) for x in self.start)
        self.run.restart(q, p)
        began = time.perf_counter()
        self.run.advance(*self.size)
        once = time.perf_counter() - began
        if once < COLD:
            began = time.perf_counter()
            self.run.advance(*self.size)
            once = time.perf_counter() - began
        count = min(MOST, ceil(LEAST / max(once, 1e-9)))
        distinct = [(q * (1 + k * EPS), p * (1 + k * EPS)) for k in range(min(count, STARTS))]
        self._starts = [distinct[k % len(distinct)] for k in range(count)]
        return once

    def _reading(self) -> tuple[float, bool]:
        """(mean seconds, whether the core was shared)."""
        restart, advance, size, spent = self.run.restart, self.run.advance, self.size, 0.0
        clock = time.perf_counter
        thread, wall = time.thread_time(), clock()
        for q, p in self._starts:
            restart(q, p)
            began = clock()
            advance(*size)
            spent += clock() - began
        wall, thread = clock() - wall, time.thread_time() - thread
        return spent / len(self._starts), wall > (1 + SHARED) * thread


def clock(
    integrator,
    problem,
    *,
    t_end: float,
    steps: int | None = None,
    tol: float | None = None,
    run=None,
    sharing: Sharing | None = None,
) -> Clock:
    """The clock of an integrator on a problem to ``t_end``, in so many steps or at a tolerance.

    ``run`` is its prepared run where there is one already.
    """
    run = integrator.prepare(problem, tol=tol) if run is None else run
    size = (t_end,) if integrator.adaptive else (t_end / steps, steps)
    return Clock(run, size, (problem.q0, problem.p0), Sharing() if sharing is None else sharing)


def call(integrator, problem, *, t_end: float, steps: int | None = None, tol: float | None = None, run=None) -> float:
    """Seconds of a call that integrates next to nothing: one step, or a span of `SHORTEST` of the whole."""
    if integrator.adaptive:
        return clock(integrator, problem, t_end=SHORTEST * t_end, tol=tol, run=run)()
    return clock(integrator, problem, t_end=t_end / steps, steps=1, run=run)()
