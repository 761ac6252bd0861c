"""Faults that a store must survive: kill signals, a full disk, truncated, edited or outdated files.

No finished cell is lost and no partial one is read; a later run without faults gives the tables of an undisturbed run.
"""

import json
import multiprocessing
import os
import random
import re
import resource
import signal
import time
from pathlib import Path

import pytest

from phasebench.benchmarks import report
from phasebench.benchmarks.store import lines, run, tables, workers
from phasebench.benchmarks.store.cells import ALONE, POOL, UNCOMPILED
from phasebench.benchmarks.store.journal import Journal
from phasebench.benchmarks.store.workers import DIED, LATE, Worker
from phasebench.integrators.errors import InvalidInput
from support import toy_cells

COUNT, MOMENTS = 12, 20
FORK = multiprocessing.get_context("fork")


def run_cells(folder, cells=None) -> run.Outcome:
    return run.execute(cells or toy_cells.cells(COUNT, seconds=0.005), folder, count=0, seed=1, quick=True)


def in_a_process(function, *arguments):
    process = FORK.Process(target=function, args=arguments)
    process.start()
    return process


def test_killed_runs_lose_no_finished_cell(tmp_path):
    whole, folder, rng = tmp_path / "whole", tmp_path / "killed", random.Random(7)
    began = time.perf_counter()
    run_cells(whole)
    length = time.perf_counter() - began
    hit = 0
    for _ in range(MOMENTS):
        file = folder / "toys.csv"
        if file.exists() and not (folder / "journal.jsonl").exists():  # after a complete run: cut off half of the rows
            lines = file.read_text().splitlines(keepends=True)
            file.write_text("".join(lines[: 1 + COUNT // 2]))
        before = Journal(folder / "journal.jsonl").entries if folder.exists() else {}
        process = in_a_process(run_cells, folder)
        time.sleep(rng.uniform(0, 1.2 * length))
        os.kill(process.pid, signal.SIGKILL)
        process.join()
        hit += process.exitcode == -signal.SIGKILL
        journal = Journal(folder / "journal.jsonl")
        assert journal.unreadable <= 1, "only the line that was being written may be cut"
        if (folder / "journal.jsonl").exists():
            assert before.keys() <= journal.entries.keys()
        for name in toy_cells.TABLES:
            if (folder / f"{name}.csv").exists():
                json.loads((folder / f"{name}.json").read_text())
                assert all(None not in row.values() for row in tables.Table(folder, name).rows)
    assert hit > MOMENTS / 3, "most of the runs had ended before they were killed"
    run_cells(folder)
    assert toy_cells.timeless(folder) == toy_cells.timeless(whole)
    assert not (folder / "journal.jsonl").exists()


def _on_a_full_disk(folder, largest, said):
    """Measure with a limit on the size of a file (bytes); put the error message or "done" into the queue ``said``."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))
    try:
        run_cells(folder, toy_cells.cells(COUNT, version=2))
    except InvalidInput as error:
        said.put(str(error))
    except BaseException as error:
        said.put(repr(error))
    else:
        said.put("done")


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_full_disk_is_named_and_tables_stay(tmp_path, share):
    folder, whole = tmp_path / "data", tmp_path / "whole"
    run_cells(folder)
    run_cells(whole, toy_cells.cells(COUNT, version=2))
    stored = {p.name: p.read_bytes() for p in folder.glob("*.*") if p.name.startswith("toy")}
    said = FORK.SimpleQueue()
    process = in_a_process(_on_a_full_disk, folder, int(share * len(stored["toys.csv"])), said)
    process.join()
    text = said.get()
    assert "cannot be written" in text, text
    assert "Error(" not in text
    assert {p.name: p.read_bytes() for p in folder.glob("*.*") if p.name.startswith("toy")} == stored
    run_cells(folder, toy_cells.cells(COUNT, version=2))
    assert toy_cells.timeless(folder) == toy_cells.timeless(whole)


TAMPERED = {
    "cut": lambda text: text[: 2 * len(text) // 3],
    "another number": lambda text: re.sub(r"\d", "8", text, count=1),
    "a line doubled": lambda text: text + text.splitlines(keepends=True)[-1],
    "empty": lambda text: "",
    "another column": lambda text: text.replace("n", "m", 1),
    "no table": lambda text: "\x00\x01\x02",
}


@pytest.mark.parametrize("how", TAMPERED)
@pytest.mark.parametrize("name", ["toys.csv", "toy_parts.csv", "toys.keys"])
def test_edited_table_is_measured_again(tmp_path, name, how):
    folder, whole = tmp_path / "data", tmp_path / "whole"
    run_cells(folder)
    run_cells(whole)
    file = folder / name
    text = file.read_text()
    assert TAMPERED[how](text) != text
    file.write_text(TAMPERED[how](text))
    run_cells(folder)
    assert toy_cells.timeless(folder) == toy_cells.timeless(whole)


def test_report_of_an_unreadable_table_says_so(tmp_path):
    run_cells(tmp_path / "data")
    report.build(tmp_path)
    before = {p: p.read_bytes() for p in tmp_path.glob("*.md")}
    assert tmp_path / "README.md" in before
    (tmp_path / "data" / "rows.csv").write_text("\x00")
    (tmp_path / "data" / "rows.json").write_text("{")
    with pytest.raises(InvalidInput, match=r"rows\.csv cannot be read"):
        report.build(tmp_path)
    assert {p: p.read_bytes() for p in tmp_path.glob("*.md")} == before


# -- workers -----------------------------------------------------------------------------------------------------------


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


#: Marks tests that ask whether another process runs.
needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc to look into")


def runs(pid: int) -> bool:
    """True if a process with this id runs; False for a zombie."""
    state = Path(f"/proc/{pid}/stat")
    return state.exists() and state.read_text().rpartition(")")[2].split()[0] != "Z"


def ends(pid: int, seconds: float = 5.0) -> bool:
    """Wait until the process with this id ends, for at most so many seconds; True if it has ended."""
    last = time.monotonic() + seconds
    while runs(pid) and time.monotonic() < last:
        time.sleep(0.05)
    return not runs(pid)


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
