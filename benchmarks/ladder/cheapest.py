"""Choose the cheapest of the runs that meet an accuracy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

#: A finer run replaces the coarsest one that meets the accuracy if it takes less than this share of its time.
CHEAPER = 0.8


class TimedRun(Protocol):
    """A run with its measured time."""

    @property
    def seconds(self) -> float:
        """Seconds of a warm run without output."""


Run = TypeVar("Run", bound=TimedRun)


def cheapest(meeting: Sequence[Run]) -> Run | None:
    """The cheapest of runs from coarse to fine: the coarsest, unless a finer one takes clearly less time; None of none.

    A finer run can be cheaper where implicit equations need many iterations in wide steps.
    """
    if not meeting:
        return None
    widest, least = meeting[0], min(meeting, key=lambda run: run.seconds)
    return least if least.seconds < CHEAPER * widest.seconds else widest
