"""Rows on disk: what was written is found again, what is unreadable is named and left as it is."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.rows.store import Store
from phasebench.integrators.errors import InvalidInput


@pytest.fixture
def stored(tmp_path):
    store = Store(tmp_path / "deep" / "rows.jsonl")
    for i in range(3):
        store.put(f"k{i}", {"x": i / 3, "text": f"\u03bb {i}"})
    return store.path


def test_a_store_reads_what_it_wrote(stored):
    found = Store(stored)
    assert found.rows() == [{"key": f"k{i}", "x": i / 3, "text": f"\u03bb {i}"} for i in range(3)]
    assert found.get("k1")["x"] == 1 / 3
    assert found.get("absent") is None


def test_the_last_row_of_a_key_counts(stored):
    Store(stored).put("k1", {"x": 7})
    assert Store(stored).get("k1")["x"] == 7
    assert len(Store(stored).rows()) == 3


@pytest.mark.parametrize("cut", [2, 10, 30])
def test_a_row_cut_short_is_dropped(stored, cut):
    stored.write_text(stored.read_text()[:-cut])
    found = Store(stored)
    assert [r["key"] for r in found.rows()] == ["k0", "k1"]
    found.put("k2", {"x": 5})
    assert [r["x"] for r in Store(stored).rows()] == [0, 1 / 3, 5]


def test_a_row_without_its_line_break_is_no_trap(stored):
    stored.write_text(stored.read_text()[:-1])
    Store(stored).put("k3", {"x": 5})
    assert [r["key"] for r in Store(stored).rows()] == ["k0", "k1", "k2", "k3"]


@pytest.mark.parametrize("line", ['{"key": "k1", "x"', "[1]", '{"x": 1}', "7"])
def test_an_unreadable_line_inside_is_named(stored, line):
    lines = stored.read_text().splitlines()
    text = "\n".join([lines[0], line, lines[2]]) + "\n"
    stored.write_text(text)
    with pytest.raises(InvalidInput, match="line 2"):
        Store(stored)
    assert stored.read_text() == text


@pytest.mark.parametrize("text", ["notes\nwithout a last line break", "notes", "\n7", '{"key"} no'])
def test_a_file_of_something_else_is_left_as_it_is(tmp_path, text):
    path = tmp_path / "notes.txt"
    path.write_text(text)
    with pytest.raises(InvalidInput, match="is no row"):
        Store(path)
    assert path.read_text() == text


def test_a_file_that_cannot_be_used_is_named(tmp_path):
    with pytest.raises(InvalidInput, match="cannot be read"):
        Store(tmp_path)
    image = tmp_path / "image.png"
    image.write_bytes(b"\x89PNG\xff")
    with pytest.raises(InvalidInput, match="is no text"):
        Store(image)
    with pytest.raises(InvalidInput, match="cannot be written"):
        Store(image / "rows.jsonl").put("k", {})
