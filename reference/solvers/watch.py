"""A time limit and progress reports for reference integrations.

The solvers report their time by `report_time`, which has no effect outside `watching`.  A run that cannot end within
the limit is stopped early: after `SURE` seconds, if by its rate so far it would take `HOPELESS` times the limit.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

#: Seconds after which a run's rate is taken as constant, and the multiple of the limit at which it is stopped.
SURE, HOPELESS = 5.0, 3.0
#: Least seconds between two progress reports.
APART = 0.2


class TooLong(RuntimeError):
    """Raised if reference solutions are not finished in their time limit; the message says which time they reached."""


@dataclass
class Watch:
    """A time limit with progress reports for reference integrations.

    Attributes
    ----------
    limit : seconds for all runs together
    tell : called with a line that says which run is at which time
    """

    limit: float
    tell: Callable[[str], None]
    began: float = field(default_factory=lambda: time.perf_counter())
    _run: str = ""
    _at: float = 0.0
    _since: float = 0.0
    _told: float = 0.0

    def seen(self, run: str, t: float, t_end: float) -> None:
        """Report that the run named ``run`` has reached the time t; raise TooLong if it cannot end within the limit."""
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


def report_time(run: str, t: float, t_end: float) -> None:
    """Report that the run named ``run`` has reached t of ``t_end``; raise TooLong if its time limit cannot be met.

    No effect outside of a `watching` context.
    """
    if _watch:
        _watch[-1].seen(run, t, t_end)


def is_watched() -> bool:
    """True while a time limit is set by `watching`."""
    return bool(_watch)


@contextmanager
def watching(limit: float, tell: Callable[[str], None]) -> Iterator[None]:
    """A context in which reference integrations take at most ``limit`` seconds and report progress to ``tell``."""
    _watch.append(Watch(limit, tell))
    try:
        yield
    finally:
        _watch.pop()
