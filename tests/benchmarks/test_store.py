"""Rows on disk: journals, tables, which cells are measured again, runs that are killed or find another run."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from phasebench.benchmarks.store import cells as cells_
from phasebench.benchmarks.store import compare, digits, provenance, run, screen, tables, workers
from phasebench.benchmarks.store.cells import Package, content
from phasebench.benchmarks.store.journal import Entry, Journal, lock
from phasebench.integrators.errors import InvalidInput
from support import toy_cells

MACHINE = provenance.machine()
OTHER = "0ther0/" + MACHINE.partition("/")[2]


pytestmark = pytest.mark.usefixtures("importable")


def execute(folder, cells, **more):
    return run.execute(cells, folder, **({"count": 0, "seed": 1} | more))


def rows(folder, name="toys"):
    with (folder / f"{name}.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def known(folder, column, name="toys"):
    """The values of a column of the keys file, by the number n of the toy cell."""
    return {int(dict(key)["n"]): line[column] for key, line in tables.Table(folder, name).keys.items()}


def measured_now(outcome):
    """The numbers n of the toy cells that this run measured and stored."""
    return [c.key["n"] for c in outcome.cells if c.id in outcome.entries and c not in outcome.plan.done]


# -- the journal -------------------------------------------------------------------------------------------------------


def entry(k: int, content="c") -> Entry:
    return Entry(f"cell {k}", content, "2026-11-21", MACHINE, 0.5, {"t": [{"x": k / 3, "y": None}]})


@pytest.fixture
def path(tmp_path):
    """The path of a journal with three entries, which made its folders."""
    journal = Journal(tmp_path / "very" / "deep" / "journal.jsonl")
    for k in range(3):
        journal.put(entry(k))
    return journal.path


def test_journal_returns_what_was_put(path):
    assert Journal(path).entries == {f"cell {k}": entry(k) for k in range(3)}
    Journal(path).put(entry(1, "other"))
    assert Journal(path).entries["cell 1"].content == "other"


@pytest.mark.parametrize(
    ("change", "kept", "unreadable"),
    [
        (lambda text: text[:-1], {0, 1, 2}, 0),  # it lacks nothing but its end
        (lambda text: text[:-40], {0, 1}, 1),
        (lambda text: re.sub(rb"(?s)\n.*?\n", b"\n{}\n", text, count=1), {0, 2}, 1),
        (lambda text: re.sub(rb"(?s)\n.*?\n", b"\n\xff\xfe\x00\n", text, count=1), {0, 2}, 1),
    ],
    ids=["no end", "cut", "empty", "binary"],
)
def test_corrupt_line_is_dropped_and_the_next_is_intact(path, change, kept, unreadable):
    path.write_bytes(change(path.read_bytes()))
    journal, ids = Journal(path), {f"cell {k}" for k in kept}
    assert (set(journal.entries), journal.unreadable) == (ids, unreadable)
    journal.put(entry(7))
    assert set(Journal(path).entries) == ids | {"cell 7"}


# -- runs --------------------------------------------------------------------------------------------------------------


def test_second_run_measures_only_its_sample(tmp_path):
    cells = toy_cells.cells(6)
    first = execute(tmp_path, cells)
    assert measured_now(first) == list(range(6))
    written = {p.name: p.read_bytes() for p in tmp_path.glob("*.*")}
    second = execute(tmp_path, cells)
    assert measured_now(second) == []
    assert 0 < len(second.sampled) <= 6
    assert {p.name: p.read_bytes() for p in tmp_path.glob("*.*")} == written
    assert [r["n"] for r in rows(tmp_path)] == [str(n) for n in range(6)]
    assert [(r["n"], r["part"]) for r in rows(tmp_path, "toy_parts")] == [
        ("1", "0"), ("2", "0"), ("2", "1"), ("4", "0"), ("5", "0"), ("5", "1")
    ]  # fmt: skip
    assert set(known(tmp_path, "state").values()) == {tables.CURRENT}
    assert {run.split()[-1] for run in known(tmp_path, "run").values()} == {MACHINE}


def test_outdated_rows_stay_marked_without_a_budget(tmp_path):
    tmp_path = tmp_path / "data"
    execute(tmp_path, toy_cells.cells(4))
    changed = toy_cells.cells(4, version=2)
    outcome = execute(tmp_path, changed, budget=0.0)
    assert measured_now(outcome) == []
    assert len(outcome.left) == 4
    assert any("4 cells are not measured by this version" in note for note in outcome.notes)
    assert set(known(tmp_path, "state").values()) == {tables.STALE}
    frame, about = tables.read(tmp_path.parent, "toys")
    assert (len(frame), about["stale"]) == (4, 4)
    assert json.loads((tmp_path / "toys.json").read_text())["stale"] == 4
    assert screen.counts(outcome)[0]["not by this version"] == 4
    assert measured_now(execute(tmp_path, changed)) == [0, 1, 2, 3]
    assert set(known(tmp_path, "state").values()) == {tables.CURRENT}


# -- the three classes of validity -------------------------------------------------------------------------------------


def with_code(cell, code: str):
    """The cell, as if the code that it runs had this hash."""
    data, _, packages = cell.content.split("-")
    return replace(cell, content="-".join([data, code, packages]))


def test_times_and_dear_numbers_are_measured_on_request(tmp_path):
    """Times are not stale when code changes; dear numbers are, and wait."""
    cells = [toy_cells.cell(0), toy_cells.cell(2, own=True), toy_cells.cell(4, dear=True)]
    execute(tmp_path, cells, times=True, dear=True)
    changed = [with_code(cell, "another") for cell in cells]
    outcome = execute(tmp_path, changed)
    assert measured_now(outcome) == [0]
    assert known(tmp_path, "state") == {0: tables.CURRENT, 2: tables.CURRENT, 4: tables.STALE}
    assert ["--dear" in note for note in outcome.notes] == [True]
    assert measured_now(execute(tmp_path, changed, dear=True)) == [4]
    assert measured_now(execute(tmp_path, changed)) == []
    assert measured_now(execute(tmp_path, changed, times=True)) == [2]
    other = [toy_cells.cell(2, own=True, version=2)]
    outcome = execute(tmp_path, [cells[0], other[0]])
    assert outcome.plan.times == other, "other data do make times stale"


def test_numbers_that_took_long_are_dear(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "LONGEST", 0.05)
    cells = [toy_cells.cell(0), toy_cells.cell(2, seconds=0.1)]
    assert measured_now(execute(tmp_path, cells)) == [0, 2], "what was never measured is not known to be dear"
    outcome = execute(tmp_path, [with_code(cell, "another") for cell in cells])
    assert (measured_now(outcome), [c.key["n"] for c in outcome.plan.dear]) == ([0], [2])


def test_times_of_another_machine_are_measured_on_request(tmp_path):
    cells = [toy_cells.cell(n, own=n in (1, 2)) for n in range(4)]
    execute(tmp_path, cells, times=True)
    assert measured_now(execute(tmp_path, cells, times=True)) == []
    for name in toy_cells.TABLES:
        file = tmp_path / f"{name}.json"
        file.write_text(file.read_text().replace(MACHINE, OTHER))
    assert measured_now(execute(tmp_path, cells)) == []
    assert sorted(measured_now(execute(tmp_path, cells, times=True))) == [1, 2]
    machines = {n: run.split()[-1] for n, run in known(tmp_path, "run").items()}
    assert machines == {0: OTHER, 1: MACHINE, 2: MACHINE, 3: OTHER}


# -- nothing is taken away ---------------------------------------------------------------------------------------------


def files(folder):
    return {p.name: p.read_bytes() for p in folder.glob("*.*") if p.name != run.AGREED}


def test_a_package_that_is_missing_keeps_its_rows(tmp_path, monkeypatch):
    """Also if code has changed; where it is installed, its new version makes its rows, and no others, outdated."""
    versions = {"made-up": "1.0"}
    monkeypatch.setattr(cells_, "version_of", lambda name: versions.get(name, "3") if name == "made-up" else "3")

    def cells():
        of_package = replace(toy_cells.cell(2), content=content(2, Package("made-up")))
        return [toy_cells.cell(0), of_package]

    execute(tmp_path, cells())
    before = files(tmp_path)
    versions["made-up"] = None
    outcome = execute(tmp_path, cells())
    assert (measured_now(outcome), [c.key["n"] for c in outcome.plan.absent]) == ([], [2])
    assert any("1 cells need packages" in note for note in outcome.notes)
    assert screen.counts(outcome)[0]["not here"] == 1
    assert files(tmp_path) == before
    versions["made-up"] = "2.0"
    assert measured_now(execute(tmp_path, cells())) == [2]


def test_a_machine_that_cannot_measure_takes_no_row_away(tmp_path):
    """A processor without an instruction, say: rows that tell so replace no others."""
    execute(tmp_path, toy_cells.cells(3))
    before = files(tmp_path)
    lacking = toy_cells.cells(3, function=toy_cells.lack_here)
    outcome = execute(tmp_path, lacking, everything=True)
    assert outcome.unavailable == {cell.id for cell in lacking}
    assert any("no such instruction" in note for note in outcome.notes)
    assert files(tmp_path) == before


def test_rows_that_agree_are_not_written_again(tmp_path):
    """Other packages that give the same numbers leave the files alone; other code changes the hashes alone."""
    execute(tmp_path, toy_cells.cells(3))
    before = files(tmp_path)

    def with_packages(cell, told):
        return replace(cell, content="-".join([*cell.content.split("-")[:2], told]))

    newer = [with_packages(cell, "other") for cell in toy_cells.cells(3)]
    assert measured_now(execute(tmp_path, newer)) == [0, 1, 2]
    assert files(tmp_path) == before
    assert measured_now(execute(tmp_path, newer)) == [], "it is known that they agree"
    assert measured_now(execute(tmp_path, toy_cells.cells(3))) == []
    coded = [with_code(cell, "another") for cell in toy_cells.cells(3)]
    assert measured_now(execute(tmp_path, coded)) == [0, 1, 2]
    after = files(tmp_path)
    assert {name for name in after if after[name] != before[name]} == {"toys.keys", "toy_parts.keys"}
    moved = [replace(c, measure=toy_cells.measure_moved) for c in (with_code(c, "third") for c in toy_cells.cells(3))]
    execute(tmp_path, moved)
    assert {r["x"] for r in rows(tmp_path)} == {"0.29"}, "what differs is written"


def test_only_selected_cells_are_measured(tmp_path):
    tmp_path = tmp_path / "data"
    execute(tmp_path, toy_cells.cells(4))
    outcome = execute(tmp_path, toy_cells.cells(4, version=2), selected=lambda c: "n3" in c.names)
    assert measured_now(outcome) == [3]
    frame, about = tables.read(tmp_path.parent, "toys")
    assert (frame["n"].tolist(), about["stale"]) == ([0, 1, 2, 3], 3)
    assert [*known(tmp_path, "state").values()] == [tables.STALE] * 3 + [tables.CURRENT]
    again = execute(tmp_path, toy_cells.cells(4, version=2), selected=lambda c: "n3" in c.names)
    assert measured_now(again) == [3]


def test_rows_of_removed_cells_are_dropped_on_request(tmp_path):
    execute(tmp_path, toy_cells.cells(4))
    (tmp_path / "others.csv").write_text("x\n1\n")
    before = files(tmp_path)
    outcome = execute(tmp_path, toy_cells.cells(2))
    assert any("4 rows of toys, toy_parts belong to no measurement" in note for note in outcome.notes)
    assert files(tmp_path) == before
    execute(tmp_path, toy_cells.cells(2), prune=True)
    assert [r["n"] for r in rows(tmp_path)] == ["0", "1"]
    assert (tmp_path / "others.csv").read_text() == "x\n1\n"


@pytest.mark.parametrize("count", [0, 2])
def test_failed_cell_is_named_and_the_others_continue(tmp_path, count):
    bad = {1: toy_cells.fail, 3: toy_cells.lack} | ({2: toy_cells.die} if count else {})
    cells = [toy_cells.cell(n, function=bad.get(n, toy_cells.measure)) for n in range(6)]
    outcome = execute(tmp_path, cells, count=count)
    assert sorted(measured_now(outcome)) == sorted({0, 1, 2, 3, 4, 5} - set(bad))
    assert outcome.failed[cells[1].id] == "ValueError: there is no 1"
    assert any("no compiler" in note for note in outcome.notes)
    assert not count or "died" in outcome.failed[cells[2].id]
    assert [r["n"] for r in rows(tmp_path)] == [str(n) for n in range(6) if n not in bad]


def test_rows_that_contradict_their_cell_are_refused(tmp_path):
    wrong = replace(toy_cells.cell(1), key={"n": 2})
    outcome = execute(tmp_path, [wrong])
    assert "a row's n is not the cell's" in outcome.failed[wrong.id]
    taken = toy_cells.cell(1, function=toy_cells.measure_dated)
    assert "column run is the provenance's" in execute(tmp_path, [taken]).failed[taken.id]
    with pytest.raises(ValueError, match="two cells"):
        execute(tmp_path, [toy_cells.cell(1), toy_cells.cell(1)])


def test_second_run_in_a_folder_is_refused(tmp_path):
    with lock(tmp_path), pytest.raises(InvalidInput, match="another run"):
        execute(tmp_path, toy_cells.cells(1))
    assert measured_now(execute(tmp_path, toy_cells.cells(1))) == [0]


def test_run_of_some_cells_keeps_the_journal_of_others(tmp_path):
    cells = toy_cells.cells(4)
    journal = Journal(tmp_path / "journal.jsonl")
    for cell in cells[:2]:
        journal.put(run.entry(cell, workers.answer(cell.measure, cell.arguments)))
    execute(tmp_path, cells, selected=lambda c: "n3" in c.names)
    assert [*Journal(tmp_path / "journal.jsonl").entries] == [c.id for c in cells[:2]]
    assert measured_now(execute(tmp_path, cells)) == [2]
    assert not (tmp_path / "journal.jsonl").exists()


def test_a_quick_run_does_not_replace_full_tables(tmp_path):
    cells = [toy_cells.cell(n) for n in range(2)]
    for _ in range(2):
        execute(tmp_path, cells, everything=True, quick=True)
    execute(tmp_path, cells, everything=True)
    with pytest.raises(InvalidInput, match="tables of a full run"):
        execute(tmp_path, cells, everything=True, quick=True)
    assert len(rows(tmp_path)) == 2


def test_journal_of_another_version_is_ignored(tmp_path):
    Journal(tmp_path / "journal.jsonl").put(
        Entry(toy_cells.cell(0).id, "another", "2026-01-01", MACHINE, 0.1, toy_cells.measure(0))
    )
    assert measured_now(execute(tmp_path, toy_cells.cells(1))) == [0]


# -- the sample --------------------------------------------------------------------------------------------------------


def test_sample_fits_its_time_and_follows_its_seed():
    cells = toy_cells.cells(40)
    known = {c.id: run.Standing(c.content, MACHINE, 1.0 if c.key["n"] else 1e3) for c in cells}
    chosen = run.sample(cells, known, 9.5, 1, 1)
    assert len(chosen) == 9
    assert chosen == run.sample(cells, known, 9.5, 1, 1) != run.sample(cells, known, 9.5, 2, 1)
    assert cells[0] not in run.sample(cells, known, 1e6, 1, 1), "one cell would take the whole time"


def test_run_finds_a_sample_that_differs(tmp_path, monkeypatch):
    monkeypatch.setitem(compare.BANDS, "toys", {"x": compare.Band(1e-6, 0.0)})
    execute(tmp_path, toy_cells.cells(3))
    assert compare.of_sample(execute(tmp_path, toy_cells.cells(3))) == []
    was = toy_cells.cell(2)
    execute(tmp_path, [replace(was, measure=toy_cells.measure_moved)], selected=lambda c: True)
    (found,) = compare.of_sample(execute(tmp_path, [was]))
    assert (found.column, found.stored, found.measured) == ("x", "0.29", 2 / 7)


# -- tables and the screen ---------------------------------------------------------------------------------------------


def test_table_reads_back_the_measured_numbers(tmp_path):
    values = np.random.default_rng(0).normal(size=200) * 10.0 ** np.arange(-150, 50)
    cell, toys = toy_cells.cell(1), [{"n": 1, "x": x, "text": f'row, "{i}"'} for i, x in enumerate(values)]
    measured = Entry(cell.id, cell.content, "2026-11-21", MACHINE, 1.0, {"toys": toys, "toy_parts": []})
    stored = {name: tables.Table(tmp_path / "data", name) for name in toy_cells.TABLES}
    tables.write(tmp_path / "data", [cell], {cell.id: measured}, stored, quick=True)
    frame, about = tables.read(tmp_path, "toys")
    assert (frame["x"].to_numpy() == values).all()
    assert frame["text"].tolist() == [f'row, "{i}"' for i in range(200)]
    assert set(tables.PROVENANCE).isdisjoint(frame)
    assert about["quick"] is True
    assert "numpy" in about["machines"][MACHINE]["versions"]
    assert tables.read(tmp_path, "numbers") == (None, None)


def test_an_empty_value_of_a_key_is_one_of_its_values(tmp_path):
    """A cell with no tolerance does not own the rows of one with a tolerance."""

    def cell(n, tol):
        key = {"n": n, "tol": tol}
        rows = {"toys": [key | {"x": n}], "toy_parts": []}
        return replace(toy_cells.cell(n), key=key, measure=lambda: rows, arguments=(), content=content(n, tol))

    cells = [cell(1, None), cell(1, 1e-9)]
    execute(tmp_path, cells)
    assert [(r["n"], r["tol"]) for r in rows(tmp_path)] == [("1", ""), ("1", "1e-09")]
    assert measured_now(execute(tmp_path, cells)) == []
    changed = [with_code(cells[1], "another")]
    execute(tmp_path, [cells[0], *changed])
    assert [(r["n"], r["tol"]) for r in rows(tmp_path)] == [("1", ""), ("1", "1e-09")]


@pytest.mark.parametrize(
    ("table", "column", "text"),
    [
        ("rows", "error", "0.3333333"),
        ("rows", "seconds", "0.333333"),
        ("rows", "h", repr(1 / 3)),
        ("rows", "of the key", repr(1 / 3)),
        ("toys", "error", repr(1 / 3)),
    ],
)
def test_numbers_of_large_tables_are_rounded_unless_they_identify_rows(table, column, text):
    assert digits.stored_text(table, column, 1 / 3, key=("of the key",)) == text
