"""Warm times of every method, and the ratios that are claimed."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.experiments.speed import calls, speed
from phasebench.benchmarks.experiments.trade import sweep
from phasebench.benchmarks.problems import problem
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import method


def cells(quick: bool = False):
    """Steps, ratios and calls."""
    return speed.cells(quick) + calls.cells(quick)


def bench_times(measured):
    """Every time is of steps that were taken."""
    wrong = [f"{r['method']} on {r['problem']}: {r['ns per step']}" for r in measured("speed") if r["ns per step"] <= 0]
    assert not wrong, "\n".join(wrong)


def bench_ratios(measured):
    """Every ratio is of times that were taken; whether it is as wanted is the page's verdict."""
    wrong = [r["ratio"] for r in measured("ratios") if not 0 < r["median, low"] <= r["median"] <= r["median, high"]]
    assert not wrong, wrong


def bench_calls(measured):
    """Every ratio of a prepared run to a bare script is of times that were taken; the page says which are as wanted."""
    wrong = [r for r in measured(calls.TABLE) if not 0 < r["ratio, low"] <= r["ratio"] <= r["ratio, high"]]
    assert not wrong, wrong


@pytest.mark.parametrize("name", speed.PROBLEMS)
@pytest.mark.parametrize("variant", list(sweep.variants()), ids=lambda v: method(v[0], **dict(v[1])).label)
def bench_method(benchmark, name, variant):
    """The same times with the statistics of pytest-benchmark, where an option --benchmark-* asks for them."""
    found, chosen = problem(name), method(variant[0], **dict(variant[1]))
    if chosen.lacks(found.system):
        pytest.skip(chosen.lacks(found.system))
    benchmark.group = f"{name}, h = {speed.H}, {speed.STEPS} steps"
    run = prepare(found, chosen)
    benchmark.pedantic(run, (speed.H, speed.STEPS), rounds=speed.ROUNDS, warmup_rounds=1)
