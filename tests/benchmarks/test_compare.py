"""The comparison of tables finds numbers outside their bands, changed texts and unmatched rows, nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.store import compare
from phasebench.benchmarks.store.compare import EXACT, MISSING, PRESENT, ROW, Band, differences, match
from support import toy_cells

KEY, LIMITS = ["method", "h"], {"error": Band(0.01, 1e-15), "status": EXACT, "good": EXACT}
NAN = float("nan")


def rows() -> list[dict]:
    return [
        {"method": "scheme-i", "h": 0.1, "error": 1.23456789012345e-7, "steps": 3, "good": True, "status": "ok"},
        {"method": "avf", "h": 1 / 3, "error": NAN, "steps": 4, "good": False, "status": "diverged"},
        {"method": "a, b", "h": NAN, "error": float("inf"), "steps": 5, "good": True, "status": ""},
    ]


def replace_value(column, value, row=0) -> list[dict]:
    return [r | ({column: value} if k == row else {}) for k, r in enumerate(rows())]


def difference_tuples(measured, stored, limits=LIMITS, key=KEY) -> list[tuple]:
    """The differences between a measured and a stored table beyond their limits, each (column, measured, stored)."""
    return [(d.column, d.measured, d.stored) for d in differences(match(measured, stored, key), limits)]


@pytest.mark.parametrize(
    ("column", "value", "row"),
    [
        ("error", 1.26e-7, 0),
        ("error", 0.0, 0),
        ("error", NAN, 0),
        ("error", 1.0, 1),
        ("error", 1.0, 2),
        ("error", "lots", 0),
        ("status", "diverged", 0),
        ("status", "", 0),
        ("status", "ok", 2),
        ("good", False, 0),
    ],
)
def test_changed_cell_is_found_from_either_side(column, value, row):
    new = replace_value(column, value, row)
    assert [d[0] for d in difference_tuples(new, rows())] == [column]
    assert [d[0] for d in difference_tuples(rows(), new)] == [column]
    (difference,) = differences(match(new, rows(), KEY), LIMITS)
    assert difference.key == tuple("" if x != x else str(x) for x in (rows()[row]["method"], rows()[row]["h"]))


@pytest.mark.parametrize(("column", "value"), [("error", 1.24e-7), ("steps", 4), ("note", "new")])
def test_change_within_its_band_or_unlimited_is_equal(column, value):
    assert difference_tuples(replace_value(column, value), rows()) == []
    assert difference_tuples(rows(), replace_value(column, value)) == []


def test_equal_tables_in_any_order_and_as_text():
    assert difference_tuples(rows(), rows()) == []
    assert difference_tuples(rows()[::-1], rows()) == []
    texts = [{k: "" if v != v else str(v) for k, v in r.items()} for r in rows()]
    assert difference_tuples(rows(), texts) == difference_tuples(texts, rows()) == []
    assert difference_tuples([{"method": "avf", "h": 1}], [{"method": "avf", "h": "1.0"}]) == []


def test_unmatched_rows_are_found():
    assert difference_tuples(rows()[1:], rows()) == [(ROW, MISSING, PRESENT)]
    assert difference_tuples(rows(), rows()[:2]) == [(ROW, PRESENT, MISSING)]
    assert [d[0] for d in difference_tuples(replace_value("status", "slow", row=2)[1:], rows())] == [ROW, "status"]


def test_rows_of_one_key_match_in_order():
    twice = [*rows(), rows()[0] | {"error": 1.0}]
    assert difference_tuples(twice, twice) == []
    assert difference_tuples(twice, rows()) == [(ROW, PRESENT, MISSING)]
    assert difference_tuples([*rows(), rows()[0]], twice) == [("error", 1.23456789012345e-7, 1.0)]


def test_limits_of_a_band():
    band = {"error": Band(0.5, 0.25)}
    old = [{"k": k, "error": e} for k, e in ((1, 1.0), (2, 0.0), (3, 1.0))]
    new = [{"k": k, "error": e} for k, e in ((1, 1.75), (2, 0.25), (3, 1.76))]
    assert difference_tuples(new, old, band, ["k"]) == [("error", 1.76, 1.0)]
    assert difference_tuples([{"error": 1.0}], [{"error": np.inf}], band, []) != [], (
        "an infinite number allows no other"
    )


def test_difference_shows_both_numbers_and_their_ratio():
    (one,) = differences(match(replace_value("error", 2 * rows()[0]["error"]), rows(), KEY), LIMITS)
    assert one.ratio == 2
    assert all(x in str(one) for x in ("scheme-i", "0.1", "error", "2.4691357802469e-07", "1.23456789012345e-07"))
    (text,) = differences(match(replace_value("status", "x"), rows(), KEY), LIMITS)
    assert text.ratio is None


# -- the sample --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("factor", "seen"), [(1.1, True), (1.0001, False)])
def test_number_outside_its_band_is_named(factor, seen):
    cell = toy_cells.cell(1)
    stored = [{"n": "1", "order": "2.0", "symplecticity": "", "reversibility": "1e-30"}]
    measured = [{"n": 1, "order": 2.0 * factor, "reversibility": 2e-25}]
    differing = compare.of_cell(cell, "matrix", measured, stored)
    assert [(d.key, d.column, d.measured, d.stored) for d in differing] == [
        (("matrix", cell.label), "order", 2.2, "2.0")
    ] * seen
    assert not seen or differing[0].ratio == pytest.approx(1.1)


def test_missing_number_and_changed_status_are_found():
    cell = toy_cells.cell(1)
    assert compare.of_cell(cell, "matrix", [{"n": 1}], [{"n": "1", "order": "2.0"}])
    old = [{"order": "2.0", "status": "ok"}]
    assert compare.of_cell(cell, "matrix", [{"order": 2.0, "status": "diverged"}], old)
    assert not compare.of_cell(cell, "matrix", [{"order": 2.0, "status": "ok"}], old)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_changed_number_of_rows_is_a_difference(count):
    cell, row = toy_cells.cell(1), {"order": 2.0}
    stored = [{"order": "2.0"}] * 2
    assert {d.column for d in compare.of_cell(cell, "matrix", [row] * count, stored)} == {ROW}
    assert compare.of_cell(cell, "matrix", [row] * 2, stored) == []
    assert [d.column for d in compare.of_cell(cell, "matrix", [], [])] == [ROW], "nothing was compared"


@pytest.mark.parametrize(("factor", "seen"), [(1.0, False), (1 + 1e-12, True), (1.5, True), (0.5, True), (9.9, True)])
def test_stated_uncertainty_must_be_equal(factor, seen):
    """A stored certificate states a reference's uncertainty, so it does not depend on the machine."""
    cell, stated = toy_cells.cell(1), 5.2295517e-30
    differing = compare.of_cell(cell, "references", [{"uncertainty": stated * factor}], [{"uncertainty": repr(stated)}])
    assert bool(differing) is seen


def test_common_rows_of_a_ladder_are_compared():
    """The length of a ladder depends on the speed of the machine."""
    cell = toy_cells.cell(1)
    stored = [{"setting": "150 steps", "closed form": "0.12"}]
    measured = [{"setting": "150 steps", "closed form": 0.12}, {"setting": "300 steps", "closed form": 0.13}]
    assert not compare.of_cell(cell, "kepler", measured, stored)
    assert not compare.of_cell(cell, "kepler", measured[:1], [*stored, {"setting": "300 steps"}])
    assert compare.of_cell(cell, "kepler", [measured[0] | {"closed form": 0.1201}, measured[1]], stored)
    assert compare.of_cell(cell, "kepler", measured[1:], stored), "nothing is left to compare"
    own = [{"setting": f"{compare.OF_THE_MACHINE} 150 steps", "closed form": x} for x in (0.1, 0.2)]
    assert not compare.of_cell(cell, "kepler", [measured[0], own[0]], [*stored, own[1]]), "what a second allows"


def test_table_without_bands_is_not_compared():
    assert compare.of_cell(toy_cells.cell(1), "toys", [{"x": 1.0}], [{"x": "2.0"}]) == []
