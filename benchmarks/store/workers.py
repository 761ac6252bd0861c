"""Call functions in other processes, with a time limit and an answer even if a process dies.

`measure` makes the measurements of a run ("cells") in this way.
"""

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
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple

from .cells import POOL, UNCOMPILED, Cell
from .provenance import machine

if TYPE_CHECKING:
    from .cluster import Cluster

#: A place besides those of `cells`: every process on a core of its own, for timings that run in parallel.
PINNED = "pinned"
SERVE = "from phasebench.benchmarks.store.workers import serve; serve({!r})"
#: Environment variable of a worker; workers that it starts join its process group and are ended with it.
INSIDE = "PHASEBENCH_WORKER"
#: Seconds between attempts to find a free core.
LOOK = 0.05
#: Errors of an answer that are not exceptions of the function.
DIED, LATE = "its process died", "it did not return in time"


class Answer(NamedTuple):
    """The result of a call in another process: the value, or the exception in one line, `DIED` or `LATE`."""

    value: Any
    error: str | None
    seconds: float
    machine: str


def answer(function: Callable, arguments: Sequence) -> Answer:
    """Call a function in this process, and return its `Answer`."""
    began, value, error = time.perf_counter(), None, None
    try:
        value = function(*arguments)
    except Exception as problem:
        error = "".join(traceback.format_exception_only(problem)).strip()
    return Answer(value, error, time.perf_counter() - began, machine())


@contextlib.contextmanager
def pin_to_core(pin: bool = True) -> Iterator[None]:
    """Pin this process to a core that no other phasebench process has pinned; block until one is free.

    A locked file marks a core as taken; the system releases the lock if the process dies.
    """
    if not pin or not hasattr(os, "sched_setaffinity"):
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
    """Main loop of a worker process: read pickled calls from stdin, write answers to stdout, until stdin ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    while True:
        try:
            function, arguments = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        with pin_to_core(where == PINNED):
            found = answer(function, arguments)
        pickle.dump(found, answers)
        answers.flush()


class Worker:
    """A process that calls functions, one at a time; it is started by the first call, and again after it was stopped.

    ``answers`` is a queue shared by several workers, which receives (worker, answer); by default one of its own.
    """

    def __init__(self, where: str = POOL, answers: queue.Queue | None = None) -> None:
        self.where, self.process = where, None
        self.cell: Cell | None = None
        self._shared = answers

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def call(self, function: Callable, *arguments: Any, seconds: float | None = None) -> Answer:
        """Call a module-level function and return its answer; end the process if it takes longer than ``seconds``."""
        self.send(function, arguments)
        try:
            _, found = self.answers.get(timeout=seconds)
        except queue.Empty:
            found = Answer(None, LATE, seconds, machine())
        if found.error in (DIED, LATE):
            self.stop()
        return found

    def send(self, function: Callable, arguments: Sequence) -> None:
        """Start a call; its answer is put into the queue `answers` when the function returns or the process dies."""
        if self.process is None:
            self._start()
        with contextlib.suppress(OSError):  # the process died: the listening thread reports it
            pickle.dump((function, arguments), self.process.stdin)
            self.process.stdin.flush()

    def _start(self) -> None:
        environment = dict(os.environ)
        environment.pop("NUMBA_DISABLE_JIT", None)
        # Each worker has one core, so libraries must not start threads of their own.
        environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", INSIDE: "1"}
        if self.where == UNCOMPILED:
            environment["NUMBA_DISABLE_JIT"] = "1"
        self.process = subprocess.Popen(
            [sys.executable, "-c", SERVE.format(self.where)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
            start_new_session=INSIDE not in os.environ,
        )
        # A new queue for each process, so that it holds no late answer of an earlier one.
        self.answers = queue.Queue() if self._shared is None else self._shared
        threading.Thread(target=self._listen, args=(self.process.stdout, self.answers), daemon=True).start()

    def _listen(self, stream: IO[bytes], answers: queue.Queue) -> None:
        while True:
            try:
                answers.put((self, pickle.load(stream)))
            except Exception:
                answers.put((self, Answer(None, DIED, 0.0, machine())))
                return

    def stop(self) -> None:
        """Kill the process and all processes that it has started."""
        if self.process is None:
            return
        if INSIDE not in os.environ and hasattr(os, "killpg"):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.process.pid, signal.SIGKILL)
        self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            with contextlib.suppress(OSError):
                stream.close()
        self.process = None


def measure(
    cells: Sequence[Cell], where: str, deadline: float, count: int = 0, cluster: Cluster | None = None
) -> Iterator[tuple[Cell, Answer]]:
    """Measure cells, and yield each with its `Answer` when it is finished, until the deadline (`time.monotonic`).

    ``count`` is the number of parallel processes, 0 for this one; a ``cluster`` measures instead of this machine.
    """
    if cluster is not None:
        yield from cluster.measure(cells, where, deadline)
    elif count:
        yield from _beside(cells, where, deadline, count)
    else:
        for cell in cells:
            if time.monotonic() > deadline:
                return
            yield cell, answer(cell.measure, cell.arguments)


def _beside(cells: Sequence[Cell], where: str, deadline: float, count: int) -> Iterator[tuple[Cell, Answer]]:
    answers: queue.Queue = queue.Queue()
    waiting = list(reversed(cells))
    workers = [Worker(where, answers) for _ in range(min(count, len(cells)))]

    def feed(worker: Worker) -> None:
        worker.cell = waiting.pop() if waiting and time.monotonic() < deadline else None
        if worker.cell:
            worker.send(worker.cell.measure, worker.cell.arguments)

    try:
        for worker in workers:
            feed(worker)
        while any(w.cell for w in workers):
            try:
                worker, found = answers.get(timeout=seconds_until(deadline))
            except queue.Empty:
                return
            cell = worker.cell
            if found.error == DIED:
                worker.stop()
            if cell is None:  # it was idle when it died
                continue
            feed(worker)
            yield cell, found
    finally:
        for worker in workers:
            worker.stop()


def seconds_until(deadline: float) -> float | None:
    """Seconds to a deadline; None if it is infinite."""
    return None if deadline == float("inf") else max(0.0, deadline - time.monotonic())
