"""Measures cells on a Dask cluster: workers return rows, and this process stores them.

A worker measures in child processes, like a run on one machine (`workers.Worker`), so that the rows are the same.  If a
worker is lost, the scheduler gives its cells to another one.  Timed cells are measured on this machine.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence

from phasebench.integrators.errors import InvalidInput

from .cells import Cell
from .workers import Answer, Worker, seconds_until

#: Seconds to wait for the scheduler.
PATIENCE = 15.0
_children = threading.local()


def call(where: str, function: Callable, arguments: Sequence) -> Answer:
    """Call a function in a child process of a Dask worker, kept for the next call, and return its `Answer`."""
    known = _children.__dict__.setdefault("by_place", {})
    return known.setdefault(where, Worker(where)).call(function, *arguments)


class Cluster:
    """A connection to a Dask scheduler by its address, such as ``tcp://10.0.0.1:8786``; raises InvalidInput."""

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise InvalidInput('a cluster needs Dask: python -m pip install -e ".[cluster]"') from None
        try:
            self.client = Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise InvalidInput(f"no scheduler answers at {address!r}: {error}") from None

    def measure(self, cells: Sequence[Cell], where: str, deadline: float) -> Iterator[tuple[Cell, Answer]]:
        """Measure cells on the cluster; yield each with its answer when it is finished, until the deadline."""
        from distributed import as_completed

        asked = {
            self.client.submit(call, where, cell.measure, cell.arguments, key=f"{cell.id}|{time.time_ns()}"): cell
            for cell in cells
        }
        left = seconds_until(deadline)
        try:
            for future in as_completed(list(asked), loop=self.client.loop, timeout=left):
                cell = asked.pop(future)
                try:
                    found = future.result(timeout=seconds_until(deadline))
                except TimeoutError:
                    return
                except Exception as problem:
                    found = Answer(None, f"{type(problem).__name__}: {problem}", 0.0, "")
                yield cell, found
        except TimeoutError:
            return
        finally:
            self.client.cancel(list(asked))

    def close(self) -> None:
        """Disconnect from the cluster; it keeps running."""
        self.client.close()
