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

import pytest

from phasebench.benchmarks import report
from phasebench.benchmarks.store import run, tables
from phasebench.benchmarks.store.journal import Journal
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
