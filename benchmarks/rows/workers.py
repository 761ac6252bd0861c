"""Processes that measure cells: one at a time each, and ended at once where the time is up."""

from __future__ import annotations

import contextlib
import itertools
import os
import pickle
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path

from .cells import UNCOMPILED, Cell

#: Besides the places of `cells`: each process on a core of its own, for what is timed beside others.
PINNED = "pinned"
SERVE = "from phasebench.benchmarks.rows.workers import serve; serve({!r})"
#: Seconds between two looks for a core that is free.
LOOK = 0.05


@contextlib.contextmanager
def on_a_core(mine: bool = True) -> Iterator[None]:
    """Be on one core that no other process uses which asks so; wait for one.  Where cores have no names, do nothing.

    A lock of the system's on a file says that a core is taken: what dies leaves it.
    """
    if not mine or not hasattr(os, "sched_setaffinity"):
        yield
        return
    import fcntl

    allowed = os.sched_getaffinity(0)
    for core in itertools.cycle(sorted(allowed)):
        with open(Path(tempfile.gettempdir()) / f"phasebench-{os.getuid()}-core-{core}", "a") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                time.sleep(LOOK)
                continue
            os.sched_setaffinity(0, {core})
            try:
                yield
            finally:
                os.sched_setaffinity(0, allowed)
            return


def serve(where: str) -> None:
    """Measure the cells of stdin and answer (rows, error, seconds); what packages print goes to stderr."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    while True:
        try:
            measure, arguments = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        with on_a_core(where == PINNED):
            rows, error, began = None, None, time.perf_counter()
            try:
                rows = measure(*arguments)
            except Exception as problem:
                error = "".join(traceback.format_exception_only(problem)).strip()
            seconds = time.perf_counter() - began
        pickle.dump((rows, error, seconds), answers)
        answers.flush()


class Worker:
    """A process that runs `serve`; its answers go to a queue as (worker, answer), None for one that died."""

    def __init__(self, where: str, answers: queue.Queue):
        environment = dict(os.environ)
        environment.pop("NUMBA_DISABLE_JIT", None)
        # One core is one worker's: threads of a library's own would be on the others'.
        environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        if where == UNCOMPILED:
            environment["NUMBA_DISABLE_JIT"] = "1"
        self.process = subprocess.Popen(
            [sys.executable, "-c", SERVE.format(where)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
            start_new_session=True,
        )
        self.cell: Cell | None = None
        threading.Thread(target=self._listen, args=(answers,), daemon=True).start()

    def ask(self, cell: Cell) -> None:
        """Have a cell measured."""
        self.cell = cell
        with contextlib.suppress(OSError):  # of a process that died: its listener says so
            pickle.dump((cell.measure, cell.arguments), self.process.stdin)
            self.process.stdin.flush()

    def _listen(self, answers: queue.Queue) -> None:
        while True:
            try:
                answer = pickle.load(self.process.stdout)
            except Exception:
                answers.put((self, None))
                return
            answers.put((self, answer))

    def stop(self) -> None:
        """End the process and those that it has started, whatever they do."""
        if hasattr(os, "killpg"):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.process.pid, signal.SIGKILL)
        self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            with contextlib.suppress(OSError):
                stream.close()


def measured(
    cells: Sequence[Cell], where: str, count: int, deadline: float
) -> Iterator[tuple[Cell, dict | None, str | None, float]]:
    """(cell, rows or None, why not, seconds) of the cells as they are finished, until the ``deadline``.

    ``deadline`` is a time of `time.monotonic`; a cell that is not finished by then is ended and does not come out.
    With a ``count`` of 0 the cells are measured in this process.
    """
    if not count:
        yield from _here(cells, deadline)
        return
    answers: queue.Queue = queue.Queue()
    waiting = list(reversed(cells))
    workers: list[Worker] = []
    try:
        for _ in range(min(count, len(cells))):
            worker = Worker(where, answers)
            workers.append(worker)
            worker.ask(waiting.pop())
        while any(w.cell for w in workers):
            try:
                worker, answer = answers.get(timeout=until(deadline))
            except queue.Empty:
                return
            cell, worker.cell = worker.cell, None
            if answer is None:
                worker.stop()
                workers.remove(worker)
                if waiting:
                    worker = Worker(where, answers)
                    workers.append(worker)
                answer = (None, "its process died", 0.0)
            if waiting and time.monotonic() < deadline:
                worker.ask(waiting.pop())
            yield cell, *answer
    finally:
        for worker in workers:
            worker.stop()


def until(deadline: float) -> float | None:
    """Seconds to a deadline; None where there is none."""
    return None if deadline == float("inf") else max(0.0, deadline - time.monotonic())


def _here(cells: Sequence[Cell], deadline: float):
    for cell in cells:
        if time.monotonic() > deadline:
            return
        began, rows, error = time.perf_counter(), None, None
        try:
            rows = cell()
        except Exception as problem:
            error = "".join(traceback.format_exception_only(problem)).strip()
        yield cell, rows, error, time.perf_counter() - began
