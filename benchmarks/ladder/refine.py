"""Runs between two runs of a ladder, to find the size that just meets an accuracy at the least cost."""

from __future__ import annotations

from phasebench.benchmarks.measure.integrator import Integrator

from .bracket import aim, bracket
from .cheapest import cheapest
from .rung import Rung, Task

#: Number of runs that narrow a bracket.
REFINED = 3
#: The estimated number of steps is multiplied by this, so that the run does not just miss the accuracy.
SPARE = 1.03
#: A bracket of tolerances is narrowed only if the tighter one is below this share of the looser.
APART = 0.95


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
