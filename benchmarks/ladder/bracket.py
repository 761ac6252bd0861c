"""Finds the two runs of an integrator whose errors enclose a wanted error, and interpolates between them.

Cost and size are taken as powers of the error.  A rung is a run at one size (a number of steps or a tolerance); the
rungs of an integrator are in order, the coarsest first.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import inf, isfinite, log
from typing import NamedTuple, Protocol, TypeVar

from .rung import Rung

#: A finer run replaces the coarsest one that meets the accuracy if it takes less than this share of its time.
CHEAPER = 0.8
#: Larger errors are never taken for round-off.
ROUND_OFF = 1e-8
#: The next size is at least this share of the logarithmic distance away from both ends of its bracket.
EDGE = 0.15


class Erring(Protocol):
    """Protocol of a run that has an error and a cost."""

    @property
    def error(self) -> float:
        """The error of the run in the quantity to be computed; infinite if the run gave no value."""

    @property
    def seconds(self) -> float:
        """The cost, in seconds or in another unit."""


class Run(NamedTuple):
    """A run of which only ``error`` and cost (``seconds``, in any unit) are known."""

    error: float
    seconds: float


R = TypeVar("R", bound=Erring)


def bracket(rungs: Sequence[R], wanted: float) -> tuple[R | None, list[R]]:
    """(The last run whose error is above ``wanted`` or None, the finer runs that meet it) of ever finer ``rungs``.

    A run that misses ``wanted`` though it is finer than the most accurate run is ignored if its error is at most
    `ROUND_OFF`.  With a larger error it is not, and the runs before it do not count as meeting it: their small errors
    were luck.
    """
    good = [r for r in rungs if isfinite(r.error)]
    if not good or min(r.error for r in good) > wanted:
        return None, []
    least = min(range(len(rungs)), key=lambda k: rungs[k].error)
    missing = [k for k, r in enumerate(rungs) if not r.error <= wanted and (k < least or r.error > ROUND_OFF)]
    last = missing[-1] if missing else -1
    return (rungs[last] if missing else None), [r for r in rungs[last + 1 :] if r.error <= wanted]


def share(coarse: float, fine: float, wanted: float) -> float:
    """Position of ``wanted`` between the errors of two runs on a log scale: 0 at ``coarse``, 1 at ``fine``."""
    return log(coarse / wanted) / log(coarse / max(fine, 1e-300))


def cost(rungs: Sequence[R], wanted: float) -> float:
    """The seconds at which the error ``wanted`` is met, a power of the error between two runs; inf if none meets it."""
    low, meeting = bracket(rungs, wanted)
    if not meeting:
        return inf
    high, least = meeting[0], cheapest(meeting).seconds
    if low is None or not isfinite(low.error):
        return least
    return min(least, low.seconds * (high.seconds / low.seconds) ** share(low.error, high.error, wanted))


def cheapest(meeting: Sequence[R]) -> R | None:
    """The cheapest of runs from coarse to fine: the coarsest, unless a finer one takes clearly less time; None of none.

    A finer run can be cheaper where implicit equations need many iterations in wide steps.
    """
    if not meeting:
        return None
    widest, least = meeting[0], min(meeting, key=lambda run: run.seconds)
    return least if least.seconds < CHEAPER * widest.seconds else widest


def evaluations_for(runs: Iterable[tuple[float, float]], wanted: float) -> float | None:
    """The evaluations for the error ``wanted`` from (evaluations, error) of runs; None if no run meets it."""
    found = cost([Run(error, count) for count, error in sorted(runs) if isfinite(error)], wanted)
    return found if isfinite(found) else None


def aim(coarse: Rung, fine: Rung, wanted: float) -> float:
    """The fineness (steps, or 1 / tolerance) between two runs at which the error ``wanted`` is expected."""
    part = 0.5
    if isfinite(coarse.error) and coarse.error > fine.error > 0:
        part = min(max(share(coarse.error, fine.error, wanted), EDGE), 1 - EDGE)
    return coarse.fineness * (fine.fineness / coarse.fineness) ** part
