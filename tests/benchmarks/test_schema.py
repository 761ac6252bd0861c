"""The schema of rows and the tables that are shipped: what is written is declared, newer versions are refused."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import pytest

import phasebench as pb
from phasebench.benchmarks.certificate.bench_stored import SHIPPED
from phasebench.benchmarks.ladder import sweep
from phasebench.benchmarks.ladder.curves import curves
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store import lines, schema, tables
from phasebench.benchmarks.store.journal import Entry
from phasebench.benchmarks.store.shipped import ShippedTable
from support.pages import REPORTS

ROOT = Path(__file__).resolve().parents[2]
ENTRY = Entry("a cell", "c", "2026-11-24", "m", 0.5, {"rows": [{"method": "rk4", "h": 0.1}]})


def test_columns_on_disk_and_those_written_now_are_declared():
    for path in (REPORTS / "data" / "rows.csv", *(ROOT / "reference" / "tables").glob("*.csv")):
        with path.open(newline="", encoding="utf-8") as stream:
            assert schema.undeclared(next(csv.reader(stream))) == [], path.name
    assert schema.undeclared(["h", "energy_maximum", "_max"]) == ["energy_maximum", "_max"], "the control"
    task, own = sweep.Task("oscillator-t2", "rk4", (), 0.1, True), problem("pendulum")
    rows = [sweep.measure(task, 1), *curves(own, 1.0, quantity(own, "end-state"), [integrator("rk4")])]
    assert {row["status"] for row in rows} <= {*pb.STATUSES}
    assert not {name for row in rows for name in schema.undeclared(row)}
    assert all(schema.column(name).unit and schema.column(name).meaning for name in schema.COLUMNS)


@pytest.mark.parametrize(("stated", "read"), [(None, True), (1, True), (2, False), ("1", False), (True, False)])
def test_no_version_is_version_1_and_a_newer_one_is_refused(tmp_path, stated, read):
    path, folder = tmp_path / "rows.jsonl", tmp_path / "data"
    lines.write(path, {"a cell": ENTRY}, "rows")
    assert lines.read(path, "rows") == {"a cell": ENTRY}
    tables.take(folder, "rows", {"a cell": ENTRY})
    for file in (path, folder / "rows.json"):
        about = json.loads(file.read_text())
        assert about.pop(schema.FIELD) == schema.VERSION
        file.write_text(json.dumps(about if stated is None else about | {schema.FIELD: stated}) + "\n")
    for reader in (
        lambda: lines.read(path, "rows"),
        lambda: tables.read(tmp_path, "rows"),
        lambda: tables.Table(folder, "rows"),
    ):
        if read:
            assert reader()
        else:
            with pytest.raises(pb.InvalidInput, match="schema"):
                reader()


# -- tables that are shipped with the package --------------------------------------------------------------------------


def test_saved_table_is_loaded_once(tmp_path):
    def build(rows):
        return [{"name": r["name"], "double": 2 * r["x"]} for r in rows]

    table = ShippedTable(
        tmp_path / "t.csv", build, lambda found: {line["name"]: float(line["double"]) for line in found}
    )
    rows = [{"name": "a, b", "x": 0.1}, {"name": "c", "x": 1 / 3}]
    assert table.load() == {}, "there is no file"
    table.save(rows)
    assert table.load() == {"a, b": 0.2, "c": 2 / 3}
    assert table.load() is table.load()
    assert table.path.read_text() == table.text(rows)
    table.save(rows[1:])
    assert table.load() == {"c": 2 / 3}


def rows(name: str) -> list[dict]:
    frame, _ = tables.read(REPORTS, name)
    return frame.to_dict("records")


#: Columns of a file recorded before its rows were measured again.
EARLIER = {"models": ("error", "seconds")}


def distinct(text: str, name: str) -> list[tuple]:
    """The distinct rows of a CSV text as tuples, without the columns in `EARLIER`, which are older than the rows."""
    left = [tuple(v for k, v in r.items() if k not in EARLIER.get(name, ())) for r in csv.DictReader(io.StringIO(text))]
    return list(dict.fromkeys(left)) if name in EARLIER else left


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_file_equals_what_its_rows_give(name):
    table, measured, arguments = SHIPPED[name]
    given = [*arguments(*map(rows, measured))]
    if name == "prior":
        given[1] &= table.load().competitors  # without methods added since
    assert distinct(table.text(*given), name) == distinct(table.path.read_text(), name)
    assert table.parse([]) != table.load(), "the control: of no rows it is another"
