"""Checks of the warm times of every method, of their ratios, and of what calling another package's integrator costs."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.experiments.speed import calls, speed
from phasebench.benchmarks.measure.variants import variants
from phasebench.benchmarks.problems import problem
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import method


def cells(quick: bool = False):
    """List the measurements (`Cell`) of the times of steps, of ratios of two times, and of calls of peers."""
    return speed.cells(quick) + calls.cells(quick)


def bench_times(measured_rows):
    """Every time of a step is positive."""
    wrong = [
        f"{r['method']} on {r['problem']}: {r['ns per step']}" for r in measured_rows("speed") if r["ns per step"] <= 0
    ]
    assert not wrong, "\n".join(wrong)


def bench_ratios(measured_rows):
    """Every ratio of the step times of two methods, or of one and a C loop, is positive and lies in its interval."""
    wrong = [
        r["ratio"] for r in measured_rows("ratios") if not 0 < r["median, low"] <= r["median"] <= r["median, high"]
    ]
    assert not wrong, wrong


def bench_calls(measured_rows):
    """Every ratio of a peer's prepared run to a bare script of its package is positive and lies in its interval."""
    wrong = [r for r in measured_rows(calls.TABLE) if not 0 < r["ratio, low"] <= r["ratio"] <= r["ratio, high"]]
    assert not wrong, wrong


@pytest.mark.parametrize("name", speed.PROBLEMS)
@pytest.mark.parametrize("variant", list(variants()), ids=lambda v: method(v[0], **dict(v[1])).label)
def bench_method(benchmark, name, variant):
    """Time a method's prepared run with pytest-benchmark, if an option --benchmark-* is given."""
    found, chosen = problem(name), method(variant[0], **dict(variant[1]))
    if chosen.lacks(found.system):
        pytest.skip(chosen.lacks(found.system))
    benchmark.group = f"{name}, h = {speed.H}, {speed.STEPS} steps"
    run = prepare(found, chosen)
    benchmark.pedantic(run, (speed.H, speed.STEPS), rounds=speed.ROUNDS, warmup_rounds=1)
