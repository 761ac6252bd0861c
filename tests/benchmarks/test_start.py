"""Cold and warm starts: the sentences follow their rows, both ways; what is called cold is."""

from __future__ import annotations

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.start import bench_start, page, start
from phasebench.integrators.registry import METHODS


def cold(seconds: float, method: str = "a", status: str = "ok") -> dict:
    return {"method": method, "problem": "p", "d": 4, "seconds": seconds, "status": status}


def warm(what: str, seconds: float) -> dict:
    return {"what": what, "seconds": seconds, "low": seconds - 0.01, "high": seconds + 0.02}


def told(verdict, table: str, *rows: dict):
    return verdict({table: pd.DataFrame(rows)}.get)


@pytest.mark.parametrize(
    ("last", "holds", "words"),
    [
        (cold(4.0, "b"), True, "2 of 2 first integrations arrive within 5 s of the processor's time; the median is "),
        (cold(4.0, "b"), True, "2.5 s, the longest is b on p with 4.0 s."),
        (cold(0.2, "b"), True, "the longest is a on p with 1.0 s."),
        (cold(5.0, "b"), True, "2 of 2"),
        (cold(5.1, "b"), False, "1 of 2 first integrations arrive within 5 s of the processor's time; the median is "),
        (cold(5.1, "b"), False, "not so: b on p (5.1 s)."),
        (cold(2.0, "b", "diverged"), False, "not so: b on p (diverged)."),
        (cold(float("nan"), "b"), False, "1 of 2"),
    ],
)
def test_first_integrations_are_held_to_what_is_wanted(last, holds, words):
    said = told(page.first, start.COLD, cold(1.0), last)
    assert said.holds == holds
    assert words in said.text
    assert said.short in said.text.replace(" of the processor's time", ".")


def test_of_several_late_ones_the_longest_comes_first():
    said = told(page.first, start.COLD, cold(6.0, "a"), cold(1.0, "b"), cold(9.0, "c"))
    assert "1 of 3" in said.text
    assert "not so: c on p (9.0 s) and a on p (6.0 s)." in said.text


FLOOR = warm(start.FLOOR, 0.3)


@pytest.mark.parametrize(
    ("rows", "holds", "words"),
    [
        ((FLOOR, warm("x", 0.5), warm("y", 0.6)), True, "2 of 2 warm commands end within 0.6 s by the clock; the "),
        ((FLOOR, warm("x", 0.5), warm("y", 0.6)), True, "`y`, takes 0.60 s, of which the import of Numba is 0.30 s."),
        ((FLOOR, warm("x", 0.61), warm("y", 0.5)), False, "1 of 2 warm commands end within 0.6 s"),
        ((FLOOR, warm("x", 0.61), warm("y", 0.5)), False, "`x`, takes 0.61 s"),
        ((warm("x", 0.5),), True, "`x`, takes 0.50 s."),
    ],
)
def test_warm_commands_are_held_to_what_is_wanted(rows, holds, words):
    said = told(page.again, start.WARM, *rows)
    assert said.holds == holds
    assert words in said.text


def test_the_import_of_numba_alone_is_no_command():
    assert told(page.again, start.WARM, warm(start.FLOOR, 0.9)) is None


def test_the_table_has_the_longest_starts_and_every_warm_one():
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
    assert {m.family for m in METHODS} == set(map(_family, start.FIRSTS)) | {"splitting"}


def _family(first: start.First) -> str:
    return start.method(first.method).family


def test_a_start_is_cold_and_another_in_its_cache_is_not(tmp_path):
    rows = [start.cold("explicit-euler", "pendulum", cache=str(tmp_path))[start.COLD][0] for _ in range(2)]
    assert [r["status"] for r in rows] == ["ok", "ok"]
    assert [(r["family"], r["d"]) for r in rows] == [("runge_kutta", 1)] * 2
    assert rows[1]["seconds"] < 0.3 * rows[0]["seconds"]
    assert list(tmp_path.iterdir())


def test_without_a_folder_the_cache_is_empty_and_goes(monkeypatch):
    folders = []

    def seen(words, **environment):
        folders.append(start.tempfile.gettempdir() and environment["PHASEBENCH_CACHE"])
        assert not list(start.os.scandir(folders[-1]))
        return '{"before": 1.0, "seconds": 2.0, "status": "ok"}\n'

    monkeypatch.setattr(start, "_run", seen)
    (row,) = start.cold("rk4", "toda", (("N", 4),))[start.COLD]
    assert (row["problem"], row["d"], row["seconds"], row["seconds before"]) == ("toda, N = 4", 4, 2.0, 1.0)
    assert not start.os.path.exists(folders[0])


def test_warm_commands_are_timed_in_turns_with_the_import_of_numba(monkeypatch):
    ran, given = [], {}
    monkeypatch.setattr(start, "_run", lambda words: ran.append(words))

    def turns(work, rounds):
        given["rounds"] = rounds
        for run in work.values():
            run()
        return {what: [3.0, 1.0, 2.0] for what in work}

    monkeypatch.setattr(start, "interleaved", turns)
    rows = start.warm()[start.WARM]
    assert [r["what"] for r in rows] == [start.FLOOR, *(" ".join(c) for c in start.COMMANDS)]
    assert [(r["seconds"], r["low"], r["high"]) for r in rows] == [(2.0, 1.0, 3.0)] * len(rows)
    assert given["rounds"] == start.ROUNDS
    assert ran[1][:5] == ["-m", "phasebench.benchmarks", "integrate", "pendulum", "stormer-verlet"]


def test_a_process_that_fails_is_no_measurement():
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
def test_what_cannot_be_fails(bench, good, wrong):
    bench(lambda table: good)
    with pytest.raises(AssertionError):
        bench(lambda table: wrong)
