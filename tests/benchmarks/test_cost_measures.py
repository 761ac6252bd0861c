"""What only a hand-made case shows of the measures of costs: of a step, of a first run, of many degrees of freedom."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.measure import canary
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies.costs import large, solvers, start, step
from phasebench.benchmarks.studies.costs.systems import SYSTEMS
from phasebench.integrators.compile import cache, codegen
from phasebench.integrators.compile.codegen import TUPLE_LIMIT
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import BY_ID, METHODS
from phasebench.reference.peers import particles

# -- what a step costs -------------------------------------------------------------------------------------------------


def test_rows_of_step_times_have_medians(monkeypatch):
    seconds = {"it": [9.0, 1.0, 2.0, 3.0], "stormer-verlet": [2.0, 9.0, 6.0], "C": [1.0, 3.0, 2.0]}
    monkeypatch.setattr(step, "time_in_turns", lambda work, rounds: {who: np.array(seconds[who]) for who in work})
    row = step.step("pendulum:swinging", "stormer-verlet")
    assert (row["ns per step"], row["ns, low"], row["ns, high"]) == (2.5e5, 1e5, 9e5)
    assert (row["status"], row["gradients per step"]) == ("ok", pytest.approx(1, abs=1e-3))
    monkeypatch.setattr(step, "_work", lambda *of: lambda: None)
    row = step.pair("Stormer-Verlet / C loop, kepler")
    assert [row[c] for c in ("median", "median, low", "median, high", step.WANTED)] == [3.0, 2.0, 3.0, 1.05]


def test_methods_are_timed_on_the_problems_on_which_they_run():
    for name, traits in step.PROBLEMS.items():
        system = problem(name).system
        assert all(({*m.requires} <= traits) == (m.lacks(system) is None) for m in step.METHODS.values()), name


def test_canary_sees_kernels_that_became_slower():
    stored = dict.fromkeys(canary.METHODS, 2.0)
    rows = [{"method": m, "ratio": 2.02} for m in canary.METHODS]
    assert canary.change(rows, stored.get) == pytest.approx(1.01)
    slower = [row | {"ratio": 2.6 if k % 3 else 2.0} for k, row in enumerate(rows)]
    assert canary.change(slower, stored.get) > canary.SAME
    assert canary.change(rows, {}.get) is None


# -- how long until the first result -----------------------------------------------------------------------------------


def test_every_kernel_is_started():
    started = {BY_ID[id].family for ids in start.FIRSTS.values() for id in ids.split()}
    assert {m.family for m in METHODS} == started


def test_second_start_with_one_cache_compiles_nothing(tmp_path):
    kept = []
    for _ in range(2):
        row = start.cold("explicit-euler", "pendulum", cache=str(tmp_path))
        assert (row["status"], row["family"], row["d"]) == ("ok", "runge_kutta", 1)
        kept.append({path: path.stat().st_ino for path in tmp_path.rglob("*") if path.is_file()})
    assert kept[0]
    assert kept[1] == kept[0]


def test_default_cache_is_empty_and_removed(monkeypatch):
    folders = []

    def seen(words, **environment):
        folders.append(Path(environment["PHASEBENCH_CACHE"]))
        assert list(folders[0].iterdir()) == []
        assert json.loads(words[-1])[:3] == ["rk4", "toda", [["N", 4]]]
        return '{"before": 1.0, "seconds": 2.0, "status": "ok"}\n'

    monkeypatch.setattr(start, "_run", seen)
    row = start.cold("rk4", "toda, N = 4")
    assert (row["d"], row["seconds"], row["seconds before"]) == (4, 2.0, 1.0)
    assert not folders[0].exists()


def test_warm_commands_alternate_with_the_import_of_numba(monkeypatch):
    ran = []
    monkeypatch.setattr(start, "_run", ran.append)

    def turns(work, rounds):
        for run in work.values():
            run()
        return {what: [3.0, 1.0, 2.0] for what in work}

    monkeypatch.setattr(start, "time_in_turns", turns)
    rows = start.warm()
    assert [r["what"] for r in rows] == [start.FLOOR, *map(" ".join, start.COMMANDS)]
    assert [(r["seconds"], r["low"], r["high"]) for r in rows] == [(2.0, 1.0, 3.0)] * len(rows)
    assert ran[0] == ["-c", "import numba"]
    assert ran[1][:5] == ["-m", "phasebench", "integrate", "pendulum", "stormer-verlet"]


def test_a_failed_process_raises():
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        start._run(["-c", "1 / 0"])


# -- many degrees of freedom -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SYSTEMS)
def test_c_and_python_integrate_alike_at_every_size(name):
    system = SYSTEMS[name]
    for d in (system.size(6), system.size(TUPLE_LIMIT + 4)):
        run, start = prepare(system.fastest_form(d), system.method), system.start(d)
        ends = system.prepare_c(d)(system.h, large.FEW)
        assert large.distance(run(system.h, large.FEW), ends) < 1e-14
        assert np.abs(ends[0] - start[0]).max() > 1e-10


def test_control_another_constant_gives_other_states():
    system, d = SYSTEMS["klein-gordon"], TUPLE_LIMIT + 4
    other = replace(system, constants=lambda d: (4.001, 2.0))  # the first is 4
    ours = prepare(system.fastest_form(d), system.method)(system.h, large.FEW)
    assert large.distance(ours, other.prepare_c(d)(system.h, large.FEW)) > 1e-8


def test_rebound_takes_the_same_steps():
    """REBOUND's leapfrog is drift-kick-drift, also of order 2: the states differ by the truncation error only."""
    system, d, N, apart = SYSTEMS["n-body"], 24, 8, []
    setting = particles.Setting(particles.GRAVITY, (1 / N,) * N, 3, 0, (1.0,) * d)
    for h in (system.h, system.h / 2):
        sim, _ = particles.build(setting, *system.start(d), "leapfrog")
        sim.dt, n = h, round(0.01 / h)
        sim.steps(n)
        sim.synchronize()
        apart.append(np.abs(particles.state(sim, setting)[:d] - system.prepare_c(d)(h, n)[0]).max())
    assert apart[0] < 1e-4
    assert apart[0] / apart[1] == pytest.approx(4, rel=0.1)


def test_interval_of_an_exponent_covers():
    d, rng = np.array([64, 128, 256, 512, 1024, 2048, 4096, 10_000]), np.random.default_rng(3)
    inside = 0
    for _ in range(1000):
        _, low, high = large.exponent(d, 3 * d**1.5 * np.exp(rng.normal(size=len(d)) / 10))
        inside += low <= 1.5 <= high
    assert 930 <= inside <= 970
    assert large.exponent(d, 3.0 * d**2)[0] == pytest.approx(2)
    assert np.isnan(large.exponent(d[:2], d[:2])).all()


def test_a_cost_is_too_steep_only_with_its_whole_interval():
    d = np.array([64, 256, 1024, 4096])
    for noise, fits in (([1, 1, 1, 1], False), ([3, 1 / 3, 3, 1 / 3], True)):
        rows = pd.DataFrame({"system": "toda", "d": d, "ns, ours": d**1.2 * noise})
        assert list(large.fits(rows)) == [fits]


def test_functions_are_compiled_without_the_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("PHASEBENCH_CACHE", str(tmp_path))
    before = dict(codegen._ready)
    with large.nothing_kept():
        assert cache.root() != tmp_path
        assert not codegen._ready
    assert cache.root() == tmp_path
    assert before.items() <= codegen._ready.items()
    seconds = [large.getting_ready(lambda: SYSTEMS["toda"].by_hand(24)) for _ in range(2)]
    assert min(seconds) > 0.02, "the second time it is compiled again"


@pytest.mark.parametrize("step", [pytest.param("short", marks=pytest.mark.thorough), "long"])
def test_row_of_both_solvers(step, monkeypatch):
    monkeypatch.setattr(solvers, "ROUNDS", 1)
    row = solvers.row("toda", 24, step)
    assert row["by"] == (solvers.MATRIX if step == "long" else solvers.FIXED)
    assert row["solved, usual"]
    assert row["solved, banded"]
    assert row["apart"] < solvers.SAME
    assert row["kB, banded"] < row["kB, usual"]
    assert (row["evaluations, banded"] < row["evaluations, usual"] / 5) == (step == "long")
    assert all(row[f"ns, {who}"] > 0 for who in ("usual", "banded"))


def test_steps_lie_on_both_sides_of_contraction(monkeypatch):
    monkeypatch.setattr(solvers, "timed", lambda runs, h: {})
    for name, steps in solvers.LATTICES.items():
        assert [solvers.row(name, 24, s)["by"] for s in steps._fields] == [solvers.FIXED, solvers.MATRIX], name


def test_a_long_step_of_a_large_lattice_skips_full_matrices(monkeypatch):
    monkeypatch.setattr(solvers, "FULL", 23)
    monkeypatch.setattr(solvers, "timed", lambda runs, h: {"timed": tuple(runs)})
    long, short = (solvers.row("toda", 24, step) for step in ("long", "short"))
    assert (long["timed"], short["timed"]) == (("banded",), ("usual", "banded"))
    assert "by" not in long
