"""Distribute work over threads; the calling thread takes part, so that it never waits for another to begin.

Each thread takes the next slice of the work when it has finished the last one (guided self-scheduling: C. D.
Polychronopoulos, D. J. Kuck, IEEE Trans. Comput. C-36 (1987) 1425-1439).  A slice is half of an equal share of what is
left, so that all threads end together whatever the items cost; once a first slice is timed, none is so short that it
takes less than `LEAST` seconds, which is many times the cost of taking it.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from functools import lru_cache
from queue import SimpleQueue
from threading import Event, Lock
from typing import TypeVar

#: Seconds of the shortest slice.
LEAST = 1e-3
#: Of so many pieces one is done first, to see whether all together are worth a second thread.
MANY = 256

Found = TypeVar("Found")


@lru_cache
def _helpers(count: int) -> ThreadPoolExecutor:
    """A pool of ``count`` threads that is kept, because starting a thread takes as long as many short runs."""
    return ThreadPoolExecutor(count)


if hasattr(os, "register_at_fork"):  # a child has none of its parent's threads
    os.register_at_fork(after_in_child=_helpers.cache_clear)


class Slices:
    """Iterator over slices of the range ``first`` ... n - 1, shared by several threads; slices shrink towards the end.

    ``fewest`` is the smallest length of a slice: as many items as take `LEAST` seconds, by the last timing.
    """

    def __init__(self, n: int, threads: int, first: int = 0) -> None:
        self._n, self._threads = n, threads
        self._next = first
        self.fewest = 1
        self._lock = Lock()

    def __iter__(self) -> Iterator[slice]:
        while True:
            with self._lock:
                left = self._n - self._next
                if left <= 0:
                    return
                fair = left if self._threads == 1 else -(-left // (2 * self._threads))
                begin = self._next
                self._next += min(left, max(fair, self.fewest))
                part = slice(begin, self._next)
            yield part

    def adapt(self, part: slice, seconds: float) -> None:
        """Update `fewest`, the smallest length of a slice, from the seconds that the slice ``part`` took."""
        self.fewest = max(1, round((part.stop - part.start) * LEAST / max(seconds, 1e-9)))

    def end(self) -> None:
        """Hand out no more slices."""
        with self._lock:
            self._next = self._n


class Halted(Exception):
    """Raised in ``work`` of `map_slices` once its results are no longer wanted."""


def map_slices(work: Callable[[slice], Found], n: int, threads: int, halt: Event | None = None) -> Iterator[Found]:
    """Divide the numbers 0 ... n - 1 into slices, and call ``work`` on each slice, on ``threads`` threads.

    Yields the results in the order in which they come.  An exception in ``work`` is raised here, when all threads have
    ended.  ``halt`` is set if the calling thread is interrupted: ``work`` looks at it and ends early by `Halted`.
    """
    first = 1 if n >= MANY and threads > 1 else 0
    slices = Slices(n, threads, first)
    finished: SimpleQueue = SimpleQueue()

    def take(part: slice) -> Found:
        began = time.perf_counter()
        found = work(part)
        slices.adapt(part, time.perf_counter() - began)
        return found

    def help_out() -> None:
        try:
            for part in slices:
                finished.put(take(part))
        except BaseException:
            slices.end()
            raise

    if first:
        yield take(slice(0, first))
    alone = first and n - first <= slices.fewest
    helpers = [_helpers(threads - 1).submit(help_out) for _ in range(0 if alone else min(threads, n) - 1)]
    try:
        for part in slices:
            yield take(part)
            while not finished.empty():
                yield finished.get()
        for helper in helpers:
            if not helper.cancel():
                helper.result()
        while not finished.empty():
            yield finished.get()
    except BaseException:
        if halt is not None:
            halt.set()
        raise
    finally:
        slices.end()
        wait([helper for helper in helpers if not helper.cancel()])
