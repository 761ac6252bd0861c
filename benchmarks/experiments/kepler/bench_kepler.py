"""Checks of the measurements on Kepler orbits, with and without the Schwarzschild term (`comparison`, `cost`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from phasebench.benchmarks.experiments.kepler import comparison, cost, times

if TYPE_CHECKING:
    from phasebench.benchmarks.store.cells import Cell

#: Largest difference in radians between closed form and Taylor series; the error that the best integrator must reach.
AWAY, BEST = 1e-9, 1e-6


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`): long runs, the time of an orbit, error against cost; none if ``quick``."""
    return [*comparison.cells(quick), *times.cells(quick), *cost.cells(quick)]


def away(rows: list[dict]) -> list[str]:
    """Return messages about orbits on which two references, closed form and Taylor series, differ by `AWAY` or more.

    The difference is that of the phase, in radians; one of the two references is then wrong.  ``rows`` are dicts of the
    table "kepler_growth".
    """
    return [
        f"{r['problem']}, e = {r['e']}: the closed form and the Taylor series part by {r['phase']:.2e} radians"
        for r in rows
        if r["kind"] == "reference" and not r["phase"] < AWAY
    ]


def unsolved_problems(rows: list[dict], column: str, label: str) -> list[str]:
    """Return a message for each problem on which no row has an error below `BEST`.

    ``rows`` are dicts, ``column`` is the key of the error, and ``label`` a format string of a row's keys, such as
    "{problem}, e = {e}", that names the problem.
    """
    best: dict[str, float] = {}
    for r in rows:
        error = r.get(column)
        if error is not None and error == error:
            best[label.format(**r)] = min(error, best.get(label.format(**r), float("inf")))
    return [f"{where}: the best {column} is {error:.2e}" for where, error in best.items() if not error < BEST]


def bench_kepler(measured_rows: Callable[[str], list[dict]], complete: Callable[[str], bool]) -> None:
    """Test that the closed form agrees with the Taylor series, and that some integrator follows every orbit to its end.

    ``measured_rows`` and ``complete`` are fixtures: table name -> rows, and table name -> whether all rows are
    measured.
    """
    rows = measured_rows("kepler_growth")
    wrong = away(rows)
    if complete("kepler_growth"):
        ends = [r for r in rows if r["orbits"] == comparison.ORBITS + 0.5 and r["kind"] != "reference"]
        wrong += unsolved_problems(ends, "phase", "{problem}, e = {e}")
    assert not wrong, "\n".join(wrong)


def bench_kepler_cost(measured_rows: Callable[[str], list[dict]], complete: Callable[[str], bool]) -> None:
    """Test that some integrator of another package comes near the reference, on every problem.

    Otherwise the reference and the packages solve different problems.  ``measured_rows`` and ``complete`` are fixtures:
    table name -> rows, and table name -> whether all rows are measured.
    """
    rows = [r for r in measured_rows("kepler_cost") if r["kind"] != "phasebench" and r["status"] == "ok"]
    wrong = unsolved_problems(rows, "error", "{problem}") if complete("kepler_cost") else []
    assert not wrong, "\n".join(wrong)


def bench_kepler_times(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that the cost of every timed run, in microseconds an orbit, is positive and within its interval.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    ran = [r for r in measured_rows(times.TABLE) if r["us per orbit"] == r["us per orbit"]]
    wrong = [r for r in ran if not 0 < r["us, low"] <= r["us per orbit"] <= r["us, high"]]
    assert not wrong, wrong
