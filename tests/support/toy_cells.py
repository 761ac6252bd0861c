"""Cells that take no time, or a little, for the tests of runs; run as a module it measures them into a folder."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from phasebench.benchmarks.rows.cells import ALONE, POOL, Cell, Unavailable, content

TABLES = ("toys", "toy_parts")


def measure(n: int, seconds: float = 0.0) -> dict:
    """A row, and n % 3 parts."""
    time.sleep(seconds)
    parts = [{"n": n, "part": k} for k in range(n % 3)]
    return {"toys": [{"n": n, "x": n / 7, "name": f"cell, {n}", "seconds": time.perf_counter()}], "toy_parts": parts}


def moved(n: int, seconds: float = 0.0) -> dict:
    """The rows of `measure`, but for a number."""
    found = measure(n, seconds)
    found["toys"][0]["x"] = 0.29
    return found


def core(n: int) -> dict:
    """A row with the cores that the process may use, after a while."""
    import os

    time.sleep(0.3)
    return {"toys": [{"n": n, "x": sorted(os.sched_getaffinity(0)), "name": "", "seconds": time.time()}]}


def fail(n: int) -> dict:
    """No row."""
    raise ValueError(f"there is no {n}")


def dated(n: int) -> dict:
    """A row with a column that is taken."""
    return {"toys": [{"n": n, "date": "today"}], "toy_parts": []}


def lack(n: int) -> dict:
    """No row, for want of something."""
    raise Unavailable("no compiler")


def start(path: str, n: int) -> dict:
    """Starts a process that writes its number to a file and sleeps for a minute, and does not return before."""
    import subprocess

    late = f"import os, time; open({path!r}, 'w').write(str(os.getpid())); time.sleep(60)"
    subprocess.run([sys.executable, "-c", late], check=False)
    return measure(n)


def die(n: int) -> dict:
    """Ends its process."""
    import os

    os._exit(3)


def cell(n: int, seconds: float = 0.0, version: int = 1, function=measure, **more) -> Cell:
    """The n-th cell."""
    arguments = (n, seconds) if function is measure else (n,)
    about = {"where": ALONE if n % 2 else POOL, "names": frozenset({f"n{n}"})} | more
    return Cell("toys", TABLES, {"n": n}, function, arguments, content(n, version), **about)


def cells(count: int, **more) -> list[Cell]:
    """The first ones."""
    return [cell(n, **more) for n in range(count)]


if __name__ == "__main__":
    from phasebench.benchmarks.rows import run

    run.execute(cells(int(sys.argv[2]), seconds=0.03), Path(sys.argv[1]), count=0)
    print("done")
