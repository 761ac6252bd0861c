"""Two stored runs are compared: each kind of change is attributed to its method, equal runs have none."""

import json
import subprocess

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.store import history
from phasebench.integrators.errors import InvalidInput
from support.commands import call

METHODS = ("a", "b", "c")


def table(noise=0.0, seed=0) -> pd.DataFrame:
    """A fabricated table of three methods on four problems, with relative noise in the times."""
    rng = np.random.default_rng(seed)
    rows = [
        {"method": m, "problem": f"p{k}", "h": h, "status": "ok", "reason": "", "global_error": h**2, "seconds": 1 / h}
        for m in METHODS
        for k in range(4)
        for h in (0.1, 0.05)
    ]
    frame = pd.DataFrame(rows)
    return frame.assign(seconds=frame["seconds"] * np.exp(noise * rng.normal(size=len(frame))))


def kinds(before, after) -> set[tuple[str, str]]:
    """The (kind, method) of every change between two tables."""
    return {(c.kind, c.row.partition(",")[0]) for c in history.changes({"t": before}, {"t": after})}


def test_two_runs_with_timing_noise_do_not_differ():
    assert not history.changes({"t": table()}, {"t": table()})
    for seed in range(20):
        assert not history.changes({"t": table(0.05, seed)}, {"t": table(0.05, seed + 100)})


def test_rows_of_another_day_and_machine_are_the_same_rows():
    """As tables had them in columns, and lines of JSON have them."""
    one, other = ({"date": day, "machine": day, "content": day, "digest": day, "state": day} for day in ("a", "b"))
    assert not history.changes({"t": table().assign(**one)}, {"t": table().assign(**other)})


@pytest.mark.parametrize(
    ("column", "value", "kind"),
    [
        ("status", lambda x: "diverged", history.STATUS),
        ("global_error", lambda x: 1.6 * x, history.WORSE),
        ("global_error", lambda x: x / 1.6, history.BETTER),
        ("seconds", lambda x: 1.3 * x, history.SLOW),
        ("seconds", lambda x: x / 1.3, history.FAST),
    ],
)
def test_change_is_named_with_its_method(column, value, kind):
    after = table()
    of = after["method"] == "b"
    after[column] = after[column].where(~of, after[column].map(value))
    assert kinds(table(), after) == {(kind, "b")}


def test_change_within_noise_or_below_round_off_is_none():
    after = table()
    of = after["method"] == "b"
    after.loc[of, "seconds"] *= 1.1
    after.loc[of, "global_error"] *= 1.4
    assert not kinds(table(), after)
    tiny = table().assign(global_error=1e-15)
    assert not kinds(tiny, tiny.assign(global_error=9e-14))
    assert kinds(tiny, tiny.assign(global_error=2e-13)) == {(history.WORSE, m) for m in METHODS}


def test_slower_machine_is_not_a_slower_method():
    after = table()
    after["seconds"] *= 2
    assert not kinds(table(), after)
    assert history.overall({"t": table()}, {"t": after}).value == pytest.approx(2)


def test_one_slow_row_does_not_make_a_method_slow():
    after = table()
    after.loc[0, "seconds"] *= 10
    assert not kinds(table(), after)


def test_missing_and_new_rows_are_named():
    assert kinds(table(), table().iloc[1:]) == {(history.GONE, "a")}
    assert kinds(table().iloc[1:], table()) == {(history.NEW, "a")}


def test_error_that_only_one_run_has_is_named():
    after = table()
    after.loc[0, "global_error"] = np.nan
    assert kinds(table(), after) == {(history.GONE, "a")}
    assert kinds(after, table()) == {(history.NEW, "a")}
    assert not kinds(after, after)


@pytest.mark.parametrize("column", ["global_error", "status"])
def test_column_that_is_gone_is_a_change(column):
    (found,) = history.changes({"t": table()}, {"t": table().drop(columns=column)})
    assert (found.kind, found.column) == (history.GONE, column)
    assert not history.changes({"t": table()}, {"t": table().drop(columns="reason")})


def test_rows_match_in_any_order():
    assert not kinds(table(), table().iloc[::-1])


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
        found = call("compare", before, other, "--json")
        assert found.exit_code == 1
        said = json.loads(found.stdout)
        assert len(said["changes"]) == len(table())
        assert {c["kind"] for c in said["changes"]} == {history.WORSE}
        assert said["changes"][0]["ratio"]["value"] == pytest.approx(2)
    assert call("compare", "HEAD").exit_code == 0
    assert "less accurate: 24" in call("compare", "HEAD", other).stdout


@pytest.mark.parametrize(
    ("name", "words"),
    [("none", "'none' is neither a folder"), ("--output=x", "nor a commit$"), ("empty", "empty has no tables")],
)
def test_name_without_a_run_is_invalid(name, words, tmp_path, monkeypatch):
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidInput, match=words):
        history.load(name)


def test_unreadable_table_is_invalid(tmp_path):
    (tmp_path / "t.csv").write_text("")
    with pytest.raises(InvalidInput, match="cannot be read"):
        history.load(str(tmp_path / "t.csv"))


def test_two_files_are_one_table_whatever_their_names(tmp_path):
    worse = table()
    worse["global_error"] *= 2
    names = [str(tmp_path / name) for name in ("old.csv", "new.csv")]
    for name, frame in zip(names, (table(), worse), strict=True):
        frame.to_csv(name, index=False)
    assert {c.kind for c in history.changes(*history.load_pair(*names))} == {history.WORSE}


def test_runs_without_a_common_table_are_not_compared(tmp_path):
    folders = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        table().to_csv(tmp_path / name / f"{name}.csv", index=False)
        folders.append(str(tmp_path / name))
    with pytest.raises(InvalidInput, match="have no table in common"):
        history.load_pair(*folders)


def test_a_table_that_is_gone_is_a_change():
    (found,) = history.changes({"t": table(), "u": table()}, {"t": table()})
    assert (found.kind, found.table) == (history.GONE, "u")
    assert not history.changes({"t": table()}, {"t": table(), "u": table()})


def test_ratio_needs_times_on_both_sides():
    after = table()
    of = after["method"] == "b"
    after.loc[of, "seconds"] = [np.nan, 0.0, np.inf, *(2 * after.loc[of, "seconds"].iloc[3:])]
    assert kinds(table(), after) == {(history.SLOW, "b")}, "five that tell are enough"
    untimed = table().drop(columns="seconds")
    for pair in ((untimed, table()), (table(), untimed)):
        found = history.overall({"t": pair[0], "u": table()}, {"t": pair[1], "u": table().assign(seconds=2.0)})
        assert np.isfinite(found.value)


def write_lines(path, rows):
    path.write_text(
        "".join(json.dumps({"schema": 1, "cell": "a", "of": len(rows), "date": "", **r}) + "\n" for r in rows)
    )
    return str(path)


def test_rows_of_run_are_compared_as_tables_are(tmp_path):
    """Files of JSON lines, with provenance that differs, and nulls; they are the table `rows` of a folder."""
    rows = [{"scene": "s", "method": m, "h": h, "status": "ok", "global_error": h**2} for m in "ab" for h in (0.1, 0.2)]
    rows[0]["global_error"] = None
    old = write_lines(tmp_path / "old.jsonl", rows)
    assert history.changes(*history.load_pair(old, write_lines(tmp_path / "same.jsonl", rows[::-1]))) == []
    changed = [rows[0], rows[1] | {"global_error": 1.0}, rows[2] | {"status": "diverged"}]
    new = write_lines(tmp_path / "new.jsonl", changed)
    assert {(c.kind, c.column) for c in history.changes(*history.load_pair(old, new))} == {
        (history.WORSE, "global_error"), (history.STATUS, "status"), (history.GONE, "")
    }  # fmt: skip
    pd.DataFrame(rows).to_csv(tmp_path / "rows.csv", index=False)
    assert history.changes(*history.load_pair(old, str(tmp_path))) == []


@pytest.mark.parametrize("text", ['{"method": "a"}\n{"h"', '{"h": 1}\n', '{"schema": 99, "method": "a"}\n'])
def test_lines_that_are_no_rows_are_invalid(text, tmp_path):
    (tmp_path / "t.jsonl").write_text(text)
    with pytest.raises(InvalidInput):
        history.load(str(tmp_path / "t.jsonl"))
