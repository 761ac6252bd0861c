"""Which of the runs that meet an accuracy is the cheapest: the rule of the advice and of the trade."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

#: A finer run stands before the widest that meets the accuracy, if it took less than this share of its time.
CHEAPER = 0.8


class Timed(Protocol):
    """A run that took its time."""

    @property
    def seconds(self) -> float:
        """Warm, without output."""


Run = TypeVar("Run", bound=Timed)


def cheapest(meeting: Sequence[Run]) -> Run | None:
    """Of runs that meet an accuracy, the widest first, that one, unless a finer one takes clearly less time.

    None where there are none.  Implicit equations may take so many sweeps in wide steps that shorter ones are cheaper.
    """
    if not meeting:
        return None
    widest, least = meeting[0], min(meeting, key=lambda run: run.seconds)
    return least if least.seconds < CHEAPER * widest.seconds else widest
