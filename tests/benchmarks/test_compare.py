"""Tables are compared: numbers outside their bands, changed texts, rows that are gone; their schema, shipped tables."""

from __future__ import annotations

import csv
import io
import json
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import phasebench as pb
from phasebench.benchmarks.certificate.bench_stored import SHIPPED
from phasebench.benchmarks.ladder import sweep
from phasebench.benchmarks.ladder.curves import curves
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store import compare, history, lines, schema, tables
from phasebench.benchmarks.store.compare import EXACT, MISSING, PRESENT, ROW, Band, differences, match
from phasebench.benchmarks.store.journal import Entry
from phasebench.integrators.errors import InvalidInput
from support import toy_cells
from support.commands import call
from support.pages import REPORTS

# -- measured and stored rows ------------------------------------------------------------------------------------------

KEY, LIMITS = ["method", "h"], {"error": Band(0.01, 1e-15), "status": EXACT, "good": EXACT}
NAN = float("nan")


def rows(column=None, value=None, row=0) -> list[dict]:
    """Three rows, in one of which a value is replaced."""
    made = [
        {"method": "scheme-i", "h": 0.1, "error": 1.23456789012345e-7, "steps": 3, "good": True, "status": "ok"},
        {"method": "avf", "h": 1 / 3, "error": NAN, "steps": 4, "good": False, "status": "diverged"},
        {"method": "a, b", "h": NAN, "error": float("inf"), "steps": 5, "good": True, "status": ""},
    ]
    if column is not None:
        made[row][column] = value
    return made


def found(measured, stored, limits=LIMITS, key=KEY) -> list[tuple]:
    """The differences between a measured and a stored table beyond their limits, each (column, measured, stored)."""
    return [(d.column, d.measured, d.stored) for d in differences(match(measured, stored, key), limits)]


@pytest.mark.parametrize(
    ("column", "value", "row", "seen"),
    [
        ("error", 1.26e-7, 0, True),
        ("error", NAN, 0, True),
        ("error", 1.0, 2, True),
        ("error", "lots", 0, True),
        ("status", "ok", 2, True),
        ("good", False, 0, True),
        ("error", 1.246e-7, 0, False),  # within its band of 1 %
        ("steps", 4, 0, False),
        ("note", "new", 0, False),
    ],
)
def test_changed_cell_is_found_from_either_side(column, value, row, seen):
    new = rows(column, value, row)
    for pair in ((new, rows()), (rows(), new)):
        assert [d[0] for d in found(*pair)] == [column] * seen
    for difference in differences(match(new, rows(), KEY), LIMITS):
        assert difference.key == tuple("" if x != x else str(x) for x in (rows()[row]["method"], rows()[row]["h"]))


def test_rows_match_in_any_order_and_as_text():
    texts = [{k: "" if v != v else str(v) for k, v in r.items()} for r in rows()]
    for other in (rows(), rows()[::-1], texts):
        assert found(rows(), other) == found(other, rows()) == []
    assert found([{"method": "avf", "h": 1}], [{"method": "avf", "h": "1.0"}]) == []
    assert found(rows()[1:], rows()) == [(ROW, MISSING, PRESENT)]
    assert found(rows(), rows()[:2]) == [(ROW, PRESENT, MISSING)]
    twice = [*rows(), *rows("error", 1.0)[:1]]
    assert found(twice, rows()) == [(ROW, PRESENT, MISSING)]
    assert found([*rows(), rows()[0]], twice) == [("error", 1.23456789012345e-7, 1.0)], "of one key: in their order"


KEPLER = {"setting": "150 steps", "closed form": "0.12"}
AGAIN = {"setting": "150 steps", "closed form": 0.12}
LONGER = {"setting": "300 steps", "closed form": 0.13}
OWN = f"{compare.OF_THE_MACHINE} 150 steps"


@pytest.mark.parametrize(
    ("table", "measured", "stored", "columns"),
    [
        ("matrix", [{"order": 2.2, "reversibility": 2e-25}], [{"order": "2.0", "reversibility": "1e-30"}], {"order"}),
        ("matrix", [{"order": 2.0002}], [{"order": "2.0"}], set()),
        *(("matrix", [{"order": 2.0}] * n, [{"order": "2.0"}] * 2, {ROW}) for n in (0, 1, 3)),
        ("matrix", [{"order": 2.0}] * 2, [{"order": "2.0"}] * 2, set()),
        ("matrix", [], [], {ROW}),  # nothing was compared
        ("references", [{"uncertainty": 5e-30 * (1 + 1e-12)}], [{"uncertainty": "5e-30"}], {"uncertainty"}),
        ("kepler", [AGAIN, LONGER], [KEPLER], set()),  # the length of a ladder depends on the machine's speed
        ("kepler", [AGAIN], [KEPLER, {"setting": "300 steps"}], set()),
        ("kepler", [AGAIN | {"closed form": 0.1201}, LONGER], [KEPLER], {"closed form"}),
        ("kepler", [LONGER], [KEPLER], {ROW}),
        ("kepler", [AGAIN, AGAIN | {"setting": OWN}], [KEPLER, KEPLER | {"setting": OWN, "closed form": "0.2"}], set()),
        ("toys", [{"x": 1.0}], [{"x": "2.0"}], set()),  # a table without bands
    ],
)
def test_rows_of_a_cell(table, measured, stored, columns):
    cell = toy_cells.cell(1)
    differing = compare.of_cell(cell, table, measured, stored)
    assert {d.column for d in differing} == columns
    assert {d.key for d in differing} <= {(table, cell.label)} or table == "kepler"


# -- two runs ----------------------------------------------------------------------------------------------------------

METHODS = ("a", "b", "c")


def table(noise=0.0, seed=0) -> pd.DataFrame:
    """A fabricated table of three methods on four problems, with relative noise in the times."""
    made = [
        {"method": m, "problem": f"p{k}", "h": h, "status": "ok", "reason": "", "global_error": h**2, "seconds": 1 / h}
        for m in METHODS
        for k in range(4)
        for h in (0.1, 0.05)
    ]
    frame = pd.DataFrame(made)
    return frame.assign(seconds=frame["seconds"] * np.exp(noise * np.random.default_rng(seed).normal(size=len(frame))))


def kinds(before, after) -> set[tuple[str, str]]:
    """The (kind, method) of every change between two tables."""
    return {(c.kind, c.row.partition(",")[0]) for c in history.changes({"t": before}, {"t": after})}


def test_runs_that_do_not_differ():
    one, other = ({"date": day, "machine": day, "content": day, "digest": day, "state": day} for day in ("a", "b"))
    assert not kinds(table().assign(**one), table().assign(**other))
    assert not kinds(table(), table().iloc[::-1])
    assert not kinds(table(), table().drop(columns="reason"))
    for seed in range(10):
        assert not kinds(table(0.05, seed), table(0.05, seed + 100))
    slower = table()
    slower["seconds"] *= 2
    assert not kinds(table(), slower), "another machine"
    assert history.overall({"t": table()}, {"t": slower}).value == pytest.approx(2)
    slower = table()
    slower.loc[0, "seconds"] *= 10
    assert not kinds(table(), slower), "one row"
    tiny = table().assign(global_error=1e-15)
    assert not kinds(tiny, tiny.assign(global_error=9e-14))
    assert kinds(tiny, tiny.assign(global_error=2e-13)) == {(history.WORSE, m) for m in METHODS}


@pytest.mark.parametrize(
    ("column", "value", "kind"),
    [
        ("status", lambda x: "diverged", history.STATUS),
        ("global_error", lambda x: x / 1.6, history.BETTER),
        ("global_error", lambda x: 1.4 * x, None),
        ("global_error", lambda x: np.nan, history.GONE),
        ("seconds", lambda x: 1.3 * x, history.SLOW),
        ("seconds", lambda x: x / 1.3, history.FAST),
        ("seconds", lambda x: 1.1 * x, None),
    ],
)
def test_change_is_named_with_its_method(column, value, kind):
    after = table()
    of = after["method"] == "b"
    after[column] = after[column].where(~of, after[column].map(value))
    assert kinds(table(), after) == ({(kind, "b")} if kind else set())


def test_missing_rows_columns_and_tables_are_changes():
    assert kinds(table(), table().iloc[1:]) == {(history.GONE, "a")}
    assert kinds(table().iloc[1:], table()) == {(history.NEW, "a")}
    (change,) = history.changes({"t": table()}, {"t": table().drop(columns="global_error")})
    assert (change.kind, change.column) == (history.GONE, "global_error")
    (change,) = history.changes({"t": table(), "u": table()}, {"t": table()})
    assert (change.kind, change.table) == (history.GONE, "u")
    assert not history.changes({"t": table()}, {"t": table(), "u": table()})


def write_tables(folder, frame):
    (folder / "data").mkdir(parents=True)
    frame.to_csv(folder / "data" / "t.csv", index=False)
    return str(folder)


def test_command_compares_folders_files_and_commits(tmp_path, monkeypatch):
    repository = tmp_path / "repository"
    write_tables(repository / "reports", table())
    for words in (["init", "-q"], ["add", "-A"], ["-c", "user.name=x", "-c", "user.email=x", "commit", "-qm", "x"]):
        subprocess.run(["git", *words], cwd=repository, check=True)
    monkeypatch.chdir(repository)
    worse = table()
    worse["global_error"] *= 2
    other = write_tables(tmp_path / "other", worse)
    for before in ("HEAD", "reports", "reports/data/t.csv"):
        done = call("compare", before, other, "--json")
        said = json.loads(done.stdout)
        assert (done.exit_code, len(said["changes"])) == (1, len(table()))
        assert {c["kind"] for c in said["changes"]} == {history.WORSE}
        assert said["changes"][0]["ratio"]["value"] == pytest.approx(2)
    assert call("compare", "HEAD").exit_code == 0
    assert "less accurate: 24" in call("compare", "HEAD", other).stdout


def test_names_without_comparable_runs_are_invalid(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in "ab":
        (tmp_path / name).mkdir()
        table().to_csv(tmp_path / name / f"{name}.csv", index=False)
    (tmp_path / "t.jsonl").write_text('{"schema": 99, "method": "a"}\n')
    for name, words in (("--output=x", "nor a commit$"), ("t.jsonl", "schema 99")):
        with pytest.raises(InvalidInput, match=words):
            history.load(name)
    with pytest.raises(InvalidInput, match="have no table in common"):
        history.load_pair("a", "b")
    assert not history.changes(*history.load_pair("a/a.csv", "b/b.csv")), "two files are one table"


def test_rows_of_run_are_compared_as_tables_are(tmp_path):
    """Files of JSON lines, with provenance that differs, and nulls; they are the table `rows` of a folder."""

    def write(name, made):
        known = {"schema": 1, "cell": "a", "of": len(made), "date": name}
        (tmp_path / name).write_text("".join(json.dumps(known | r) + "\n" for r in made))
        return str(tmp_path / name)

    made = [{"scene": "s", "method": m, "h": 0.1, "status": "ok", "global_error": 0.01} for m in "ab"]
    made[0]["global_error"] = None
    old = write("old.jsonl", made)
    assert history.changes(*history.load_pair(old, write("same.jsonl", made[::-1]))) == []
    (change,) = history.changes(*history.load_pair(old, write("new.jsonl", [made[0], made[1] | {"global_error": 1.0}])))
    assert (change.kind, change.column) == (history.WORSE, "global_error")
    pd.DataFrame(made).to_csv(tmp_path / "rows.csv", index=False)
    assert history.changes(*history.load_pair(old, str(tmp_path))) == []


# -- the schema of rows, and shipped tables ----------------------------------------------------------------------------


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


def stored_rows(name: str) -> list[dict]:
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
    given = [*arguments(*map(stored_rows, measured))]
    if name == "prior":
        given[1] &= table.load().competitors  # without methods added since
    text = table.path.read_text()
    assert distinct(table.text(*given), name) == distinct(text, name)
    assert table.load() == table.parse(list(csv.DictReader(io.StringIO(text))))
    assert table.parse([]) != table.load(), "the control: of no rows it is another"
