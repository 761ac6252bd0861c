"""The shipped tables: saved and loaded unchanged, and each file equals what is derived anew from its rows."""

from __future__ import annotations

import csv
import io

import pytest

from phasebench.benchmarks.advice import bench_stored as advice
from phasebench.benchmarks.advice import models, prior
from phasebench.benchmarks.certificate import bench_stored as certificate
from phasebench.benchmarks.certificate import fronts, times
from phasebench.benchmarks.store import tables
from phasebench.benchmarks.store.shipped import ShippedTable
from support.pages import REPORTS


def build(rows):
    return [{"name": r["name"], "double": 2 * r["x"]} for r in rows]


def parse(lines):
    return {line["name"]: float(line["double"]) for line in lines}


ROWS = [{"name": "a, b", "x": 0.1}, {"name": "c", "x": 1 / 3}]


def test_saved_table_is_loaded(tmp_path):
    table = ShippedTable(tmp_path / "t.csv", build, parse)
    assert table.load() == {}, "there is no file"
    table.save(ROWS)
    assert table.load() == {"a, b": 0.2, "c": 2 / 3}
    assert table.path.read_text() == table.text(ROWS)
    table.save(ROWS[1:])
    assert table.load() == {"c": 2 / 3}


def test_file_is_read_once(tmp_path):
    calls = []
    table = ShippedTable(tmp_path / "t.csv", build, lambda lines: calls.append(1) or parse(lines))
    table.save(ROWS)
    assert table.load() is table.load()
    assert calls == [1]


def rows(name: str):
    frame, _ = tables.read(REPORTS, name)
    return frame


def records(name: str) -> list[dict]:
    return rows(name).to_dict("records")


def competition():
    """(runs, integrators) from which the stored prior of `advise` was made, leaving out methods added since."""
    ran, named = advice.competition(records(advice.RUNS))
    return ran, named & prior.TABLE.load().competitors


SHIPPED = {
    "prior": (prior.TABLE, competition),
    "models": (models.TABLE, lambda: tuple(map(rows, advice.MODELS))),
    "fronts": (fronts.TABLE, lambda: (records(certificate.RUNS),)),
    "times": (times.TABLE, lambda: (records(certificate.CHOICES), records(certificate.RUNS))),
}
#: Columns of a file recorded before its rows were measured again.
EARLIER = {"models": ("error", "seconds")}


def lines(text: str, name: str) -> list[tuple]:
    """The distinct rows of a CSV text as tuples, without the columns in `EARLIER`, which are older than the rows."""
    left = [tuple(v for k, v in r.items() if k not in EARLIER.get(name, ())) for r in csv.DictReader(io.StringIO(text))]
    return list(dict.fromkeys(left)) if name in EARLIER else left


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_file_equals_what_its_rows_give(name):
    table, of = SHIPPED[name]
    stored = table.path.read_text()
    assert lines(table.text(*of()), name) == lines(stored, name)
    assert table.parse([]) != table.load(), "the control: of no rows it is another"
