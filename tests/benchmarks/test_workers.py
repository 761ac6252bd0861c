"""Calls in other processes: return values, exceptions, and processes that die, time out or are ended."""

from __future__ import annotations

import os
import time

import pytest

from phasebench.benchmarks.store import lines, workers
from phasebench.benchmarks.store.cells import ALONE, POOL, UNCOMPILED
from phasebench.benchmarks.store.workers import DIED, LATE, Worker
from support import toy_cells
from support.processes import ends, needs_proc

pytestmark = pytest.mark.usefixtures("importable")


@pytest.fixture(scope="module")
def worker():
    with Worker() as made:
        yield made


def test_call_returns_its_value_from_another_process(worker):
    first, second = worker.call(toy_cells.double, 21), worker.call(toy_cells.double, 4)
    assert (first.value["twice"], second.value["twice"], first.error) == (42, 8, None)
    assert first.value["process"] == second.value["process"] != os.getpid()
    assert worker.call(time.sleep, 0.1).seconds >= 0.09


def test_exception_is_returned_as_one_line(worker):
    there, here = worker.call(toy_cells.fail, 3), workers.answer(toy_cells.fail, (3,))
    assert there.error == here.error == "ValueError: there is no 3"
    assert there.value is here.value is None


@pytest.mark.parametrize(
    ("function", "arguments", "error"), [(toy_cells.die, (0,), DIED), (toy_cells.measure, (0, 60.0), LATE)]
)
def test_dead_or_late_process_is_replaced(worker, function, arguments, error):
    before = worker.call(toy_cells.double, 1).value["process"]
    began = time.monotonic()
    lost = worker.call(function, *arguments, seconds=3.0)
    assert (lost.value, lost.error) == (None, error)
    assert time.monotonic() - began < 30
    after = worker.call(toy_cells.double, 2)
    assert (after.value["twice"], after.error) == (4, None)
    assert after.value["process"] != before


@pytest.mark.parametrize(("where", "expected"), [(POOL, None), (UNCOMPILED, "1")])
def test_compilation_depends_on_the_place(monkeypatch, where, expected):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "0")
    with Worker(where) as made:
        assert made.call(os.getenv, "NUMBA_DISABLE_JIT").value == expected


@needs_proc
def test_worker_of_a_worker_ends_with_it(tmp_path):
    started = tmp_path / "started"
    with Worker() as outer:
        answer = outer.call(toy_cells.start_a_worker, str(started), seconds=5.0)
        assert answer.error == LATE
    assert ends(int(started.read_text()))


def test_cells_give_the_same_rows_here_and_in_workers():
    cells = toy_cells.cells(5)
    for count in (0, 2):
        found = {cell.id: answer for cell, answer in workers.measure(cells, POOL, float("inf"), count)}
        assert {id: a.value["toys"][0]["x"] for id, a in found.items()} == {c.id: c.key["n"] / 7 for c in cells}


@pytest.mark.skipif(len(getattr(os, "sched_getaffinity", lambda _: ())(0)) < 2, reason="there are no two cores")
def test_timed_cells_run_on_separate_cores(tmp_path):
    toys = [toy_cells.cell(n, function=toy_cells.core, where=ALONE) for n in range(6)]
    entries, failed, _ = lines.measure(tmp_path / "rows", toys, lambda *_: None, jobs=3)
    rows = [entries[cell.id].rows["toys"][0] for cell in toys]
    assert not failed
    assert {len(r["x"]) for r in rows} == {1}
    for one in rows:
        beside = [r for r in rows if abs(r["seconds"] - one["seconds"]) < 0.25]
        assert [r["n"] for r in beside if r["x"] == one["x"]] == [one["n"]]
    free = [toy_cells.cell(n, function=toy_cells.core, where=POOL) for n in range(2)]
    entries, *_ = lines.measure(tmp_path / "free", free, lambda *_: None, jobs=2)
    assert all(len(e.rows["toys"][0]["x"]) > 1 for e in entries.values()), "the control: others go where they want"


def test_pool_is_parallel_and_reports_a_failed_cell(tmp_path):
    toys = [toy_cells.cell(n, 1.0, where=POOL) for n in range(4)]
    toys += [toy_cells.cell(5, function=toy_cells.die, where=POOL)]
    began = time.monotonic()
    entries, failed, _ = lines.measure(tmp_path / "rows", toys, lambda *_: None, jobs=4)
    assert time.monotonic() - began < 4.0
    assert set(entries) == {cell.id for cell in toys[:4]}
    assert [line.partition(": ")[2] for line in failed] == ["its process died"]
