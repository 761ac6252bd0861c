"""Quick artificial cells for tests; ``python -m support.toy_cells FOLDER COUNT`` measures them into a folder."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

from phasebench.benchmarks.store.cells import ALONE, POOL, Cell, Unavailable, content
from phasebench.benchmarks.store.workers import Worker

TABLES = ("toys", "toy_parts")


def measure(n: int, seconds: float = 0.0) -> dict:
    """A made-up measurement for tests of the store: one row of the table toys and n % 3 rows of toy_parts."""
    time.sleep(seconds)
    parts = [{"n": n, "part": k} for k in range(n % 3)]
    return {"toys": [{"n": n, "x": n / 7, "name": f"cell, {n}", "seconds": time.perf_counter()}], "toy_parts": parts}


def measure_moved(n: int, seconds: float = 0.0) -> dict:
    """The made-up measurement `measure` with one number changed."""
    found = measure(n, seconds)
    found["toys"][0]["x"] = 0.29
    return found


def core(n: int) -> dict:
    """A row with the CPU cores on which the process may run, after 0.3 seconds."""
    time.sleep(0.3)
    return {"toys": [{"n": n, "x": sorted(os.sched_getaffinity(0)), "name": "", "seconds": time.time()}]}


def fail(n: int) -> dict:
    """A made-up measurement that raises ValueError."""
    raise ValueError(f"there is no {n}")


def measure_dated(n: int) -> dict:
    """A made-up measurement whose row has a column with a reserved name, "date"."""
    return {"toys": [{"n": n, "date": "today"}], "toy_parts": []}


def lack(n: int) -> dict:
    """A made-up measurement that raises Unavailable."""
    raise Unavailable("no compiler")


def double(x: float) -> dict:
    """Twice a number, and the id of the process, as a row."""
    return {"twice": 2 * x, "process": os.getpid()}


def start_a_worker(path: str) -> None:
    """Start a worker, write its process id to a file and let it sleep for a minute."""
    worker = Worker()
    Path(path).write_text(str(worker.call(os.getpid).value))
    worker.call(time.sleep, 60)


def start(path: str, n: int) -> dict:
    """Start a subprocess that writes its id to a file and sleeps for a minute, and wait for it."""
    import subprocess

    late = f"import os, time; open({path!r}, 'w').write(str(os.getpid())); time.sleep(60)"
    subprocess.run([sys.executable, "-c", late], check=False)
    return measure(n)


def die(n: int) -> dict:
    """End the process with exit code 3."""
    os._exit(3)


def die_of(*arguments) -> None:
    """End the process with exit code 3, with any arguments."""
    os._exit(3)


#: Ids of the integrators judged in this process.
JUDGED: list[str] = []


def judge_well(id: str) -> tuple[dict, bool]:
    """(row with the process id, True): the process stays usable."""
    JUDGED.append(id)
    return {"peer": id, "in": os.getpid()}, True


def judge_badly(id: str) -> tuple[dict, bool]:
    """(row with the process id, False): the process must not be used again."""
    return {"peer": id, "in": os.getpid()}, False


def judge_dying_of_rk4(id: str) -> tuple[dict, bool]:
    """End the process if id is "rk4", else like `judge_well`."""
    return die_of() if id == "rk4" else judge_well(id)


def judge_dying_second(id: str) -> tuple[dict, bool]:
    """End the process unless this is the first call in it."""
    return die_of() if JUDGED else judge_well(id)


def judge_never(id: str) -> tuple[dict, bool]:
    """Sleep for a minute."""
    time.sleep(60)


def cell(n: int, seconds: float = 0.0, version: int = 1, function=measure, **more) -> Cell:
    """The n-th made-up cell, i.e. a task of a run: a function to call, its arguments and the tables that it fills."""
    arguments = (n, seconds) if function is measure else (n,)
    about = {"where": ALONE if n % 2 else POOL, "names": frozenset({f"n{n}"})} | more
    return Cell("toys", TABLES, {"n": n}, function, arguments, content(n, version), **about)


def cells(count: int, **more) -> list[Cell]:
    """The first ``count`` made-up cells."""
    return [cell(n, **more) for n in range(count)]


if __name__ == "__main__":
    from phasebench.benchmarks.store import run

    run.execute(cells(int(sys.argv[2]), seconds=0.03), Path(sys.argv[1]), count=0)
    print("done")
