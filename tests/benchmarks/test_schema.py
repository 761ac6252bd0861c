"""The schema of rows: what is written is declared, rows without a version are read, newer ones are refused."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pandas as pd
import pytest

import phasebench as pb
from phasebench.benchmarks.ladder import sweep
from phasebench.benchmarks.ladder.curves import curves
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store import error_tables, lines, schema, tables
from phasebench.benchmarks.store.journal import Entry

ROOT = Path(__file__).resolve().parents[2]
ENTRY = Entry("a cell", "c", "2026-11-24", "m", 0.5, {"rows": [{"method": "rk4", "h": 0.1}]})


def head(path: Path) -> list[str]:
    with path.open(newline="", encoding="utf-8") as stream:
        return next(csv.reader(stream))


def test_columns_on_disk_are_declared():
    stored = [ROOT / "reports" / "data" / "rows.csv", *(ROOT / "reference" / "tables").glob("*.csv")]
    assert len(stored) > 10
    assert not {name for path in stored for name in schema.undeclared(head(path))}
    assert schema.undeclared(["h", "energy_maximum", "_max"]) == ["energy_maximum", "_max"], "the control"


def test_columns_that_are_written_now_are_declared():
    task = sweep.Task("oscillator-t2", "rk4", (), 0.1, True)
    own = problem("pendulum")
    rows = [sweep.measure(task, 1), *curves(own, 1.0, quantity(own, "end-state"), [integrator("rk4")])]
    assert {row["status"] for row in rows} <= {*pb.STATUSES}
    assert not {name for row in rows for name in schema.undeclared(row)}


@pytest.mark.parametrize("name", schema.COLUMNS)
def test_every_column_has_a_unit_and_a_meaning(name):
    column = schema.column(name)
    assert column.unit
    assert column.meaning


def test_written_tables_and_lines_state_the_version(tmp_path):
    path = tmp_path / "rows.jsonl"
    lines.write(path, {"a cell": ENTRY}, "rows")
    assert json.loads(path.read_text())[schema.FIELD] == schema.VERSION
    assert lines.read(path, "rows") == {"a cell": ENTRY}
    tables.take(tmp_path / "data", "rows", {"a cell": ENTRY})
    assert json.loads((tmp_path / "data" / "rows.json").read_text())[schema.FIELD] == schema.VERSION
    error_tables.save("mine", pd.DataFrame({"method": ["rk4"]}), {"problem": "x"}, tmp_path)
    assert json.loads((tmp_path / "mine.json").read_text())[schema.FIELD] == schema.VERSION
    assert error_tables.load("mine", tmp_path)[1] == {"problem": "x"}


@pytest.mark.parametrize("stated", [None, 1, 2, "1", True])
def test_no_version_is_version_1_and_a_newer_one_is_refused(tmp_path, stated):
    path, folder = tmp_path / "rows.jsonl", tmp_path / "data"
    lines.write(path, {"a cell": ENTRY}, "rows")
    tables.take(folder, "rows", {"a cell": ENTRY})
    for file in (path, folder / "rows.json"):
        about = json.loads(file.read_text())
        del about[schema.FIELD]
        file.write_text(json.dumps(about if stated is None else about | {schema.FIELD: stated}) + "\n")
    readers = (
        lambda: lines.read(path, "rows"),
        lambda: tables.read(tmp_path, "rows"),
        lambda: tables.Table(folder, "rows"),
    )
    for read in readers:
        if stated in (None, 1) and stated is not True:
            assert read()
        else:
            with pytest.raises(pb.InvalidInput, match="schema"):
                read()
