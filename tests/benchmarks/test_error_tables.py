"""Stored error tables are saved and loaded exactly; a file edited by hand is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.scenes import SCENES
from phasebench.benchmarks.store import error_tables
from phasebench.reference import files

ORIGIN = {"made": "here", "n": 3}


def frame() -> pd.DataFrame:
    return pd.DataFrame(
        {
            "method": ["scheme-i(lam=1/3)", "avf", 'a "quoted", one'],
            "h": [0.1, 1 / 3, np.nan],
            "error": [1.23456789012345e-7, np.nan, np.inf],
            "steps": [3.0, 4.0, 5.0],
            "status": ["ok", "diverged", ""],
        }
    )


@pytest.fixture
def store_tables(tmp_path):
    return error_tables.save("t", frame(), ORIGIN, tmp_path)


def test_table_is_loaded_to_the_last_digit(store_tables, tmp_path):
    back, origin = error_tables.load("t", tmp_path)
    pd.testing.assert_frame_equal(back, frame(), check_dtype=False, check_exact=True)
    assert origin == ORIGIN
    assert {p.name for p in tmp_path.iterdir()} == {"t.csv", "t.json"}
    numbers = frame().assign(h=np.random.default_rng(0).normal(size=3) * 1e-100)
    error_tables.save("n", numbers, ORIGIN, tmp_path)
    assert error_tables.load("n", tmp_path)[0]["h"].tolist() == numbers["h"].tolist()


def test_missing_table_raises_file_not_found(tmp_path):
    with pytest.raises(FileNotFoundError):
        error_tables.load("other", tmp_path)


def test_every_scene_has_a_stored_table():
    for scene in SCENES:
        rows, origin = error_tables.load(scene.id)
        assert len(rows) > 300
        assert origin["scene"] == scene.id


@pytest.mark.parametrize(
    "change",
    [
        lambda s: s.replace("1.23456789012345e-07", "1.23456789012346e-07"),
        lambda s: s.replace("1.23456789012345e-07", "lots"),
        lambda s: s[: s.rindex("avf")],
        lambda s: s[: s.rindex("avf") + 6],
        lambda s: s.replace("method,h,error", "method,h,err"),
        lambda s: "",
    ],
    ids=["digit", "word", "line", "cut", "column", "empty"],
)
def test_rows_edited_by_hand_are_refused(store_tables, tmp_path, change):
    text = store_tables.read_text()
    assert change(text) != text
    store_tables.write_text(change(text))
    with pytest.raises(error_tables.CorruptTable, match="checksum") as error:
        error_tables.load("t", tmp_path)
    assert "t.csv" in str(error.value)
    assert "python -m pytest benchmarks --update-tables" in str(error.value)


@pytest.mark.parametrize("about", [None, "", "{", "[]", "3", json.dumps(ORIGIN)])
def test_table_without_provenance_is_refused(store_tables, tmp_path, about):
    if about is None:
        store_tables.with_suffix(".json").unlink()
    else:
        store_tables.with_suffix(".json").write_text(about)
    with pytest.raises(error_tables.CorruptTable, match="its provenance beside it cannot be read"):
        error_tables.load("t", tmp_path)


def test_binary_file_is_a_corrupt_table(store_tables, tmp_path):
    store_tables.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(error_tables.CorruptTable, match="no text"):
        error_tables.load("t", tmp_path)


def test_crlf_line_ends_are_accepted(store_tables, tmp_path):
    store_tables.write_bytes(store_tables.read_bytes().replace(b"\n", b"\r\n"))
    pd.testing.assert_frame_equal(error_tables.load("t", tmp_path)[0], frame(), check_dtype=False)


@pytest.mark.parametrize(
    ("name", "origin", "words"),
    [("../t", {"a": 1}, "no plain name"), ("t", {}, "needs its provenance"), ("t", {"sha256": 1}, "no key 'sha256'")],
)
def test_invalid_names_and_provenance_are_refused(tmp_path, name, origin, words):
    with pytest.raises(ValueError, match=words):
        error_tables.save(name, frame(), origin, tmp_path)


@pytest.mark.parametrize("names", [["a", 3], ["a", "a"]])
def test_invalid_column_names_are_refused(tmp_path, names):
    with pytest.raises(ValueError, match="unique text"):
        error_tables.save("t", pd.DataFrame([[1, 2]], columns=names), ORIGIN, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_missing_text_becomes_empty_and_folder_is_created(tmp_path):
    texts = pd.DataFrame({"name": ["# made: 3", "nan", "NA", "d"], "status": [None, np.nan, "", "ok"]}, dtype=object)
    error_tables.save("t", texts, ORIGIN, tmp_path / "new" / "folder")
    back, _ = error_tables.load("t", tmp_path / "new" / "folder")
    assert back.to_numpy().tolist() == [["# made: 3", ""], ["nan", ""], ["NA", ""], ["d", "ok"]]


def test_failed_write_raises_without_its_temporary_file(store_tables, monkeypatch):
    def fails(temporary, path):
        Path(temporary).unlink()
        raise OSError("full")

    monkeypatch.setattr(files.os, "replace", fails)
    with pytest.raises(OSError, match="full"):
        files.write_file(store_tables, "new")


def test_failed_write_keeps_the_old_table(store_tables, tmp_path, monkeypatch):
    before = store_tables.read_bytes()
    monkeypatch.setattr(files.os, "replace", lambda *a: (_ for _ in ()).throw(OSError("full")))
    with pytest.raises(OSError, match="full"):
        error_tables.save("t", frame().head(1), {"made": "there"}, tmp_path)
    assert store_tables.read_bytes() == before
    assert {p.name for p in tmp_path.iterdir()} == {"t.csv", "t.json"}


def test_provenance_follows_the_problem():
    made = problem("perturbed-kepler")
    origin = error_tables.provenance(made, scene="x")
    assert origin["scene"] == "x"
    assert origin["numpy"] == np.__version__
    assert origin == error_tables.provenance(problem("perturbed-kepler"), scene="x")
    stronger = error_tables.provenance(problem("perturbed-kepler", mu=0.0076))
    assert stronger["formulae"] != origin["formulae"]
    assert stronger["initial data"] == origin["initial data"]
    faster = error_tables.provenance(made_faster := replace(made, orbits=(replace(made.start, p=(0.0, 2.5)),)))
    assert made_faster.q0 == made.q0
    assert faster["initial data"] != origin["initial data"]
    rounder = error_tables.provenance(problem("perturbed-kepler", e=0.5))
    assert rounder["formulae"] == origin["formulae"]
    assert rounder["initial data"] != origin["initial data"]
