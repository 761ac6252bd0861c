"""Calls in other processes: return values, exceptions, and processes that die, time out or are ended."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from phasebench.benchmarks.store import workers
from phasebench.benchmarks.store.cells import POOL, UNCOMPILED
from phasebench.benchmarks.store.workers import DIED, LATE, Worker
from support import toy_cells

pytestmark = pytest.mark.usefixtures("importable")


@pytest.fixture(scope="module")
def worker():
    with Worker() as made:
        yield made


def test_call_returns_its_value_from_another_process(worker):
    first, second = worker.call(toy_cells.double, 21), worker.call(toy_cells.double, 4)
    assert (first.value["twice"], second.value["twice"], first.error) == (42, 8, None)
    assert first.value["process"] == second.value["process"] != os.getpid()
    assert first.seconds >= 0


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


def runs(pid: int) -> bool:
    """True if a process with this id is running; False for a zombie."""
    state = Path(f"/proc/{pid}/stat")
    return state.exists() and state.read_text().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc to look into")
def test_worker_of_a_worker_ends_with_it(tmp_path):
    started = tmp_path / "started"
    with Worker() as outer:
        answer = outer.call(toy_cells.start_a_worker, str(started), seconds=5.0)
        assert answer.error == LATE
    child, patience = int(started.read_text()), time.monotonic() + 5
    while runs(child) and time.monotonic() < patience:
        time.sleep(0.05)
    assert not runs(child)


def test_cells_give_the_same_rows_here_and_in_workers():
    cells = toy_cells.cells(5)
    for count in (0, 2):
        found = {cell.id: answer for cell, answer in workers.measure(cells, POOL, float("inf"), count)}
        assert {id: a.value["toys"][0]["x"] for id, a in found.items()} == {c.id: c.key["n"] / 7 for c in cells}
