"""A limit of time for references, and whom to tell how far they are.

The solvers say where they are (`seen`); outside `watching` nobody listens.  A run that cannot end in time is ended as
soon as that is plain, not when the time is over: after `SURE` seconds, where it would need `HOPELESS` times the limit.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

#: Seconds after which a run's rate is taken for the rate of the whole, and the excess over the limit that has no hope.
SURE, HOPELESS = 5.0, 3.0
#: Seconds between two things that are told.
APART = 0.2


class TooLong(RuntimeError):
    """References that do not end in time; the message says how far they came."""


@dataclass
class Watch:
    """How long references may take.

    Attributes
    ----------
    limit : seconds for all runs together
    tell : told what runs and how far it is
    """

    limit: float
    tell: Callable[[str], None]
    began: float = field(default_factory=lambda: time.perf_counter())
    _run: str = ""
    _at: float = 0.0
    _since: float = 0.0
    _told: float = 0.0

    def seen(self, run: str, t: float, t_end: float) -> None:
        """A run came to t; raises TooLong where it cannot end in time."""
        now = time.perf_counter()
        if run != self._run or t < self._at:
            self._run, self._since = run, now
        self._at = t
        if now - self._told > APART:
            self._told = now
            self.tell(f"{run}: t = {t:.4g} of {t_end:.4g}")
        spent = now - self._since
        needs = spent * t_end / t if t > 0 else 0.0
        hopeless = spent > SURE and now - self.began + needs > HOPELESS * self.limit
        if hopeless or now - self.began > self.limit:
            came = f"the {run} came to t = {t:.4g}"
            raise TooLong(came + (f" in {spent:.2g} s, and would need about {_long(needs)}" if needs > 1 else ""))


def _long(seconds: float) -> str:
    for unit, size in (("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.0f} s"


_watch: list[Watch] = []


def seen(run: str, t: float, t_end: float) -> None:
    """Say that a run came to t; raises TooLong where somebody watches and it cannot end in time."""
    if _watch:
        _watch[-1].seen(run, t, t_end)


def watched() -> bool:
    """Whether anybody listens."""
    return bool(_watch)


@contextmanager
def watching(limit: float, tell: Callable[[str], None]) -> Iterator[None]:
    """Within it references take at most so many seconds, and say how far they are."""
    _watch.append(Watch(limit, tell))
    try:
        yield
    finally:
        _watch.pop()
