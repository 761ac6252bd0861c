"""Quick made-up measurements for tests of how measurements are run and stored.

A measurement is a `Cell`: a function, its arguments and the tables that its rows go to.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

from phasebench.benchmarks.store import tables
from phasebench.benchmarks.store.cells import ALONE, POOL, Cell, Unavailable, content
from phasebench.benchmarks.store.workers import Worker
from phasebench.reference.peers.record import NotHere

TABLES = ("toys", "toy_parts")


def measure(n: int, seconds: float = 0.0) -> dict:
    """Make a measurement up, after a pause: one row of the table "toys" and n % 3 rows of "toy_parts"."""
    time.sleep(seconds)
    parts = [{"n": n, "part": k} for k in range(n % 3)]
    return {"toys": [{"n": n, "x": n / 7, "name": f"cell, {n}", "seconds": time.perf_counter()}], "toy_parts": parts}


def measure_moved(n: int, seconds: float = 0.0) -> dict:
    """Make up the measurement `measure` with one number changed."""
    found = measure(n, seconds)
    found["toys"][0]["x"] = 0.29
    return found


def core(n: int) -> dict:
    """Wait for 0.3 seconds; return a row with the CPU cores on which the process may run."""
    time.sleep(0.3)
    return {"toys": [{"n": n, "x": sorted(os.sched_getaffinity(0)), "name": "", "seconds": time.time()}]}


def fail(n: int) -> dict:
    """Stand for a measurement that fails: raise ValueError."""
    raise ValueError(f"there is no {n}")


def measure_dated(n: int) -> dict:
    """Make up a measurement whose row has a column with a reserved name, "run"."""
    return {"toys": [{"n": n, "run": "today"}], "toy_parts": []}


def lack(n: int) -> dict:
    """Stand for a measurement that needs something that is not installed: raise Unavailable."""
    raise Unavailable("no compiler")


def lack_here(n: int) -> dict:
    """Stand for a measurement whose rows say that this machine cannot make it."""
    return {"toys": [{"n": n, "name": "", "reason": NotHere("no such instruction")}], "toy_parts": []}


def double(x: float) -> dict:
    """Return a row with twice a number, and the id of the process that computes it."""
    return {"twice": 2 * x, "process": os.getpid()}


def start_a_worker(path: str) -> None:
    """Start a worker process, write its process id to the file ``path`` and let it sleep for a minute."""
    worker = Worker()
    Path(path).write_text(str(worker.call(os.getpid).value))
    worker.call(time.sleep, 60)


def die(n: int) -> dict:
    """Stand for a measurement that crashes: end the process with exit code 3."""
    os._exit(3)


def die_of(*arguments) -> None:
    """End the process with exit code 3, whatever the arguments are."""
    os._exit(3)


#: Ids of the integrators judged in this process.
JUDGED: list[str] = []


def judge_well(id: str) -> tuple[dict, bool]:
    """Stand for judging an integrator: (row with the process id, True: the process may be used again)."""
    JUDGED.append(id)
    return {"peer": id, "in": os.getpid()}, True


def judge_badly(id: str) -> tuple[dict, bool]:
    """Stand for judging an integrator: (row with the process id, False: the process must not be used again)."""
    return {"peer": id, "in": os.getpid()}, False


def judge_dying_of_rk4(id: str) -> tuple[dict, bool]:
    """Stand for judging an integrator that may crash: end the process if id is "rk4", else do as `judge_well`."""
    return die_of() if id == "rk4" else judge_well(id)


def judge_dying_second(id: str) -> tuple[dict, bool]:
    """Do as `judge_well` in the first call in a process; end the process in the second one."""
    return die_of() if JUDGED else judge_well(id)


def cell(n: int, seconds: float = 0.0, version: int = 1, function=measure, **more) -> Cell:
    """Make the n-th made-up `Cell`: a function to call, its arguments and the tables that its rows go to.

    Cells of another ``version`` count as changed; ``more`` are further fields.
    """
    arguments = (n, seconds) if function is measure else (n,)
    about = {"where": ALONE if n % 2 else POOL, "names": frozenset({f"n{n}"})} | more
    return Cell("toys", TABLES, {"n": n}, function, arguments, content(n, version), **about)


def cells(count: int, **more) -> list[Cell]:
    """Make the first ``count`` made-up measurements (`Cell`); ``more`` are further arguments of `cell`."""
    return [cell(n, **more) for n in range(count)]


def timeless(folder: Path) -> dict[str, list[dict]]:
    """Return the stored tables of the made-up measurements without what differs between runs: times, dates, digests."""
    own = {"seconds"}
    return {
        name: [{k: v for k, v in row.items() if k not in own} for row in tables.Table(folder, name).rows]
        for name in TABLES
    }
