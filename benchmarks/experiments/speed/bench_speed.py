"""Checks of the step times of every method, of their ratios, and of the overhead of calling another package.

All times are warm: code is compiled before the clock starts.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from phasebench.benchmarks.experiments.speed import calls, canary, speed, translation
from phasebench.benchmarks.measure.variants import variants
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.tables import Table
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import method

if TYPE_CHECKING:
    from phasebench.benchmarks.store.cells import Cell

REPORTS = Path(__file__).resolve().parents[3] / "reports"


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements: step times, ratios of two step times, calls of other packages, heyoka's equations.

    A measurement is a `Cell`: a function, its arguments and the tables that its rows go to.  If ``quick``, the last two
    are left out; the other cells are marked if they belong to a quick run.
    """
    return speed.cells(quick) + canary.cells(quick) + calls.cells(quick) + translation.cells(quick)


def bench_times(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that every measured time of a step is positive.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = [
        f"{r['method']} on {r['problem']}: {r['ns per step']}" for r in measured_rows("speed") if r["ns per step"] <= 0
    ]
    assert not wrong, "\n".join(wrong)


def bench_canary(measured_rows: Callable[[str], list[dict]], notes: list[str]) -> None:
    """Say whether the stored times still describe the code, by the kernels that this run has timed.

    ``measured_rows`` is a fixture: table name -> rows; ``notes`` are printed at the end of the run.
    """
    stored = {r["method"]: float(r["ratio"]) for r in Table(REPORTS / "data", canary.TABLE).rows}
    found = canary.change(measured_rows(canary.TABLE), stored.get)
    if found is not None and not 1 / canary.SAME <= found <= canary.SAME:
        notes.append(f"stored times do not describe this code: kernels take {found:.2f} times as long (--times)")


def bench_ratios(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that every ratio of step times, of two methods or of a method and a C loop, is positive.

    The median must lie within its own confidence interval.  ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = [
        r["ratio"] for r in measured_rows("ratios") if not 0 < r["median, low"] <= r["median"] <= r["median, high"]
    ]
    assert not wrong, wrong


def bench_calls(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that each ratio of a peer's time here to its time in a bare script is positive and within its interval.

    A peer is another package's integrator.  ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = [r for r in measured_rows(calls.TABLE) if not 0 < r["ratio, low"] <= r["ratio"] <= r["ratio, high"]]
    assert not wrong, wrong


def bench_translation(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that heyoka runs as fast with the suite's equations as with equations written for it, where compiled alike.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = [
        f"{r['problem']} at {r['tol']}: {r['ratio']:.3f} times {r['beside']}"
        for r in measured_rows(translation.TABLE)
        if not r["within"] and r["problem"] not in translation.SLOWER
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("name", speed.PROBLEMS)
@pytest.mark.parametrize("variant", list(variants()), ids=lambda v: method(v[0], **dict(v[1])).label)
def bench_method(benchmark: Any, name: str, variant: tuple[str, tuple]) -> None:
    """Time a compiled run of a method on a problem with pytest-benchmark, if an option --benchmark-* is given.

    ``benchmark`` is the fixture of pytest-benchmark, ``name`` the problem's name, and ``variant`` is (method id, its
    parameters as pairs).
    """
    found, chosen = problem(name), method(variant[0], **dict(variant[1]))
    if chosen.lacks(found.system):
        pytest.skip(chosen.lacks(found.system))
    benchmark.group = f"{name}, h = {speed.H}, {speed.STEPS} steps"
    run = prepare(found, chosen)
    benchmark.pedantic(run, (speed.H, speed.STEPS), rounds=speed.ROUNDS, warmup_rounds=1)
