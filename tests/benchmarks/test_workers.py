"""Calls in other processes: return values, exceptions, and processes that die, time out or are ended."""

from __future__ import annotations

import os

import pytest

from phasebench.benchmarks.store import lines, workers
from phasebench.benchmarks.store.cells import ALONE, POOL, UNCOMPILED
from phasebench.benchmarks.store.workers import DIED, LATE, Worker
from support import toy_cells
from support.processes import ends, needs_proc

pytestmark = pytest.mark.usefixtures("importable")


def test_a_call_returns_its_value_or_its_error_from_another_process():
    with Worker() as worker:
        first = worker.call(toy_cells.double, 21)
        assert (first.value["twice"], first.error) == (42, None)
        assert first.value["process"] != os.getpid()
        there, here = worker.call(toy_cells.fail, 3), workers.answer(toy_cells.fail, (3,))
        assert there.error == here.error == "ValueError: there is no 3"
        assert there.value is here.value is None
        process = first.value["process"]
        for lost, error in (((toy_cells.die, 0), DIED), ((toy_cells.measure, 0, 60.0), LATE)):
            assert worker.call(toy_cells.double, 1).value["process"] == process
            assert worker.call(*lost, seconds=1.0 if error == LATE else 30.0).error == error
            process = worker.call(toy_cells.double, 2).value["process"]
            assert process != first.value["process"]


@pytest.mark.parametrize(("where", "expected"), [(POOL, None), (UNCOMPILED, "1")])
def test_compilation_depends_on_the_place(monkeypatch, where, expected):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "0")
    with Worker(where) as made:
        assert made.call(os.getenv, "NUMBA_DISABLE_JIT").value == expected


@needs_proc
def test_worker_of_a_worker_ends_with_it(tmp_path):
    started = tmp_path / "started"
    with Worker() as outer:
        assert outer.call(toy_cells.start_a_worker, str(started), seconds=5.0).error == LATE
    assert ends(int(started.read_text()))


@pytest.mark.skipif(len(getattr(os, "sched_getaffinity", lambda _: ())(0)) < 2, reason="there are no two cores")
def test_timed_cells_run_on_separate_cores(tmp_path):
    toys = [toy_cells.cell(n, function=toy_cells.core, where=ALONE) for n in range(4)]
    entries, failed, _ = lines.measure(tmp_path / "rows", toys, lambda *_: None, jobs=3)
    rows = [entries[cell.id].rows["toys"][0] for cell in toys]
    assert not failed
    assert {len(r["x"]) for r in rows} == {1}
    for one in rows:
        beside = [r for r in rows if abs(r["seconds"] - one["seconds"]) < 0.25]
        assert [r["n"] for r in beside if r["x"] == one["x"]] == [one["n"]]
    free = [toy_cells.cell(n, function=toy_cells.core, where=POOL) for n in range(2)]
    free += [toy_cells.cell(5, function=toy_cells.die, where=POOL)]
    entries, failed, _ = lines.measure(tmp_path / "free", free, lambda *_: None, jobs=2)
    assert all(len(e.rows["toys"][0]["x"]) > 1 for e in entries.values()), "the control: others go where they want"
    assert [line.partition(": ")[2] for line in failed] == ["its process died"]
