"""Cells on a Dask cluster: workers return rows, this process stores them as they come.

A worker measures in child processes of its own, as the run on one machine does (`workers.Worker`), so that rows are the
same whichever way.  The scheduler hands what a lost worker had, or had finished and not yet delivered, to another one.
Of cells that are timed a machine's own run measures none there, but here, alone; a user's sweep does, each on a core of
its own (`workers.PINNED`).
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence

from phasebench.integrators.errors import InvalidInput

from . import provenance, workers
from .cells import Cell, Rows

#: Seconds to wait for the scheduler.
PATIENCE = 15.0
_children = threading.local()


def answer(where: str, measure: Callable[..., Rows], arguments: tuple) -> tuple[dict | None, str | None, float, str]:
    """On a worker: (rows or None, why not, seconds, machine) of a cell, from a child that stays for the next one."""
    known = _children.__dict__.setdefault("by_place", {})
    if where not in known:
        answers: queue.Queue = queue.Queue()
        known[where] = workers.Worker(where, answers), answers
    child, answers = known[where]
    child.ask(_Asked(measure, arguments))
    _, told = answers.get()
    if told is None:
        known.pop(where)[0].stop()
        told = (None, "its process died", 0.0)
    return *told, provenance.machine()


class _Asked:
    """What a worker's child is told of a cell."""

    def __init__(self, measure: Callable[..., Rows], arguments: tuple):
        self.measure, self.arguments = measure, arguments


class Cluster:
    """A scheduler by its address, such as ``tcp://10.0.0.1:8786``.

    Attributes
    ----------
    machines : on which machine a cell was measured, by the cell's id

    Raises
    ------
    InvalidInput
        Where Dask is not installed, or nobody answers at the address.
    """

    def __init__(self, address: str):
        try:
            from distributed import Client
        except ImportError:
            raise InvalidInput('a cluster needs Dask: python -m pip install -e ".[cluster]"') from None
        try:
            self.client = Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise InvalidInput(f"no scheduler answers at {address!r}: {error}") from None
        self.machines: dict[str, str] = {}

    @property
    def count(self) -> int:
        """How many cells are measured at a time."""
        return max(1, sum(self.client.nthreads().values()))

    def measured(
        self, cells: Sequence[Cell], where: str, deadline: float
    ) -> Iterator[tuple[Cell, dict | None, str | None, float]]:
        """As `workers.measured`, on the cluster."""
        from distributed import as_completed

        asked = {
            self.client.submit(answer, where, cell.measure, cell.arguments, key=f"{cell.id}|{time.time_ns()}"): cell
            for cell in cells
        }
        left = workers.until(deadline)
        try:
            for future in as_completed(list(asked), loop=self.client.loop, timeout=left):
                cell = asked.pop(future)
                try:
                    rows, error, seconds, self.machines[cell.id] = future.result(timeout=workers.until(deadline))
                except TimeoutError:
                    return
                except Exception as problem:
                    rows, error, seconds = None, f"{type(problem).__name__}: {problem}", 0.0
                yield cell, rows, error, seconds
        except TimeoutError:
            return
        finally:
            self.client.cancel(list(asked))

    def close(self) -> None:
        """Leave the cluster, which goes on."""
        self.client.close()
