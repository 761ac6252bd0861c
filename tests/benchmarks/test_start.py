"""The page on cold and warm starts: verdicts that pass and fail; a cold start has an empty cache."""

from __future__ import annotations

import re
from math import inf, nan
from pathlib import Path

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.start import bench_start, page, start
from phasebench.benchmarks.page.verdict import FINDING, PASS, Range
from phasebench.integrators.registry import METHODS
from support.pages import judge


def cold(seconds: float, method: str = "a", status: str = "ok") -> dict:
    return {"method": method, "problem": "p", "d": 4, "seconds": seconds, "status": status}


def warm(what: str, seconds: float) -> dict:
    return {"what": what, "seconds": seconds, "low": seconds - 0.01, "high": seconds + 0.02}


@pytest.mark.parametrize(
    ("last", "outcome", "most", "where"),
    [
        (cold(4.0, "b"), PASS, 4.0, "b on p"),
        (cold(0.2, "b"), PASS, 1.0, "a on p"),
        (cold(5.0, "b"), PASS, 5.0, "b on p"),
        (cold(5.1, "b"), FINDING, 5.1, "b on p"),
        (cold(2.0, "b", "diverged"), FINDING, inf, "b on p"),
        (cold(nan, "b"), FINDING, inf, "b on p"),
    ],
)
def test_first_integrations_meet_their_target(last, outcome, most, where):
    said = judge(page.first, start.COLD, cold(1.0), last)
    assert (said.outcome, said.measured.high, said.where) == (outcome, most, where)


FLOOR = warm(start.FLOOR, 0.3)


@pytest.mark.parametrize(
    ("rows", "outcome", "measured", "where"),
    [
        ((FLOOR, warm("x", 0.5), warm("y", 0.6)), PASS, Range(0.5, 0.6), "y"),
        ((FLOOR, warm("x", 0.61), warm("y", 0.5)), FINDING, Range(0.5, 0.61), "x"),
        ((FLOOR, warm("x", nan), warm("y", 0.5)), FINDING, Range(0.5, inf), "x"),
        ((warm("x", 0.5),), PASS, Range(0.5, 0.5), "x"),
    ],
)
def test_warm_commands_meet_their_target(rows, outcome, measured, where):
    said = judge(page.warm_start, start.WARM, *rows)
    assert (said.outcome, said.measured, said.where) == (outcome, measured, where)


def test_answer_has_the_median_and_the_slowest_command():
    rows = {
        start.COLD: pd.DataFrame([cold(x) for x in (1.0, 2.0, 9.0)]),
        start.WARM: pd.DataFrame([FLOOR, warm("x", 0.5), warm("y", 0.62)]),
    }
    assert re.findall(r"[\d.]*\d", page.answer(rows.get)) == ["2.0", "0.62", "0.30"]
    assert page.answer({start.COLD: rows[start.COLD]}.get) is None


def test_import_of_numba_alone_is_no_command():
    assert judge(page.warm_start, start.WARM, warm(start.FLOOR, 0.9)) is None


def test_table_has_the_longest_cold_and_all_warm_starts():
    rows = {
        start.COLD: pd.DataFrame([cold(k / 10, f"{k:02d}") for k in range(30)]),
        start.WARM: pd.DataFrame([FLOOR, warm("x", 0.5)]),
    }
    shown = page.table(rows.get).frame
    assert list(shown["what"]) == [f"{k:02d} on p" for k in range(29, 6, -1)] + [start.FLOOR, "x"]
    assert list(shown["interval"])[-2:] == ["0.29 to 0.32", "0.49 to 0.52"]
    assert len(page.table({start.COLD: rows[start.COLD]}.get).frame) == 25
    assert list(page.table({start.WARM: rows[start.WARM]}.get).frame["what"]) == [start.FLOOR, "x"]
    assert page.table({}.get) is None
    assert len(page.PAGE.whole(rows.get)) == 30


def test_every_kernel_is_started():
    started = {start.method(first.method).family for first in start.FIRSTS}
    assert {m.family for m in METHODS} == started


def test_second_start_with_one_cache_compiles_nothing(tmp_path):
    kept = []
    for _ in range(2):
        (row,) = start.cold("explicit-euler", "pendulum", cache=str(tmp_path))[start.COLD]
        assert (row["status"], row["family"], row["d"]) == ("ok", "runge_kutta", 1)
        kept.append({path: path.stat().st_ino for path in tmp_path.rglob("*") if path.is_file()})
    assert kept[0]
    assert kept[1] == kept[0]


def test_default_cache_is_empty_and_removed(monkeypatch):
    folders = []

    def seen(words, **environment):
        folders.append(Path(environment["PHASEBENCH_CACHE"]))
        assert list(folders[0].iterdir()) == []
        return '{"before": 1.0, "seconds": 2.0, "status": "ok"}\n'

    monkeypatch.setattr(start, "_run", seen)
    (row,) = start.cold("rk4", "toda", (("N", 4),))[start.COLD]
    assert (row["problem"], row["d"], row["seconds"], row["seconds before"]) == ("toda, N = 4", 4, 2.0, 1.0)
    assert not folders[0].exists()


def test_warm_commands_alternate_with_the_import_of_numba(monkeypatch):
    ran, given = [], {}
    monkeypatch.setattr(start, "_run", lambda words: ran.append(words))

    def turns(work, rounds):
        given["rounds"] = rounds
        for run in work.values():
            run()
        return {what: [3.0, 1.0, 2.0] for what in work}

    monkeypatch.setattr(start, "time_in_turns", turns)
    rows = start.warm()[start.WARM]
    assert [r["what"] for r in rows] == [start.FLOOR, *(" ".join(c) for c in start.COMMANDS)]
    assert [(r["seconds"], r["low"], r["high"]) for r in rows] == [(2.0, 1.0, 3.0)] * len(rows)
    assert given["rounds"] == start.ROUNDS
    assert ran[0] == ["-c", "import numba"]
    assert ran[1][:5] == ["-m", "phasebench", "integrate", "pendulum", "stormer-verlet"]


def test_failed_process_raises():
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        start._run(["-c", "1 / 0"])


@pytest.mark.parametrize(
    ("bench", "good", "wrong"),
    [
        (bench_start.bench_cold, [cold(1.0)], [cold(0.0)]),
        (bench_start.bench_cold, [cold(1.0)], [cold(1.0, status="diverged")]),
        (bench_start.bench_warm, [FLOOR, warm("x", 0.4)], [FLOOR, warm("x", 0.2)]),
    ],
)
def test_bench_fails_for_impossible_rows(bench, good, wrong):
    bench(lambda table: good)
    with pytest.raises(AssertionError):
        bench(lambda table: wrong)
