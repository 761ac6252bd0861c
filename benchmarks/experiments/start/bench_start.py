"""Checks of the times of processes that start with an empty or a filled cache of compiled code."""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.start import start
from phasebench.benchmarks.experiments.start.start import cells  # noqa: F401


def bench_cold(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that every first integration, which compiles all its code, succeeds and takes a positive time.

    Whether the time is short enough is judged on the report's page.  ``measured_rows`` is a fixture: table name ->
    rows.
    """
    wrong = [
        f"{r['method']} on {r['problem']}: {r['status']}, {r['seconds']} s"
        for r in measured_rows(start.COLD)
        if r["status"] != "ok" or not r["seconds"] > 0
    ]
    assert not wrong, "\n".join(wrong)


def bench_warm(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that each command, run with all code compiled, takes longer than the import of Numba, a part of it.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    seconds = {r["what"]: r["seconds"] for r in measured_rows(start.WARM)}
    wrong = [f"{what}: {s} s" for what, s in seconds.items() if what != start.FLOOR and not s > seconds[start.FLOOR]]
    assert not wrong, "\n".join(wrong)
