"""A time limit that stops what is running, so that `advise` ends in time."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from math import isfinite

#: Seconds after which the signal comes again: where another package's code calls Python, an exception may be lost.
AGAIN = 0.5


class TimeUp(BaseException):
    """Raised where the time of a `deadline` is up; no Exception, so that nothing takes it for a failure."""


@contextmanager
def deadline(seconds: float) -> Iterator[None]:
    """Raise `TimeUp` in what it runs after so many seconds; compiled code is stopped when it returns.

    No effect outside the main thread, where the system has no timers (Windows), and for infinite ``seconds``.
    """
    main = threading.current_thread() is threading.main_thread()
    if not (isfinite(seconds) and main and hasattr(signal, "setitimer")):
        yield
        return

    def ring(*_: object) -> None:
        raise TimeUp

    handler = signal.signal(signal.SIGALRM, ring)
    timer = signal.setitimer(signal.ITIMER_REAL, max(seconds, 1e-3), AGAIN)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, *timer)
        signal.signal(signal.SIGALRM, handler)
