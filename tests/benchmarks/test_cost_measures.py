"""What only a hand-made case shows of the measures of costs: of a step, of a first run, of many degrees of freedom."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from phasebench.benchmarks.measure import canary
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies.costs import start, step
from phasebench.integrators.registry import BY_ID, METHODS

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
