"""The page on local laws: one cell that breaks a law is enough, round-off has no order, the worst is shown."""

from __future__ import annotations

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.waves import laws, spacetime, spacetime_page

SIZES = [*(("time", 17, 0.1 / 2**k) for k in range(4)), *(("space", n, 0.01) for n in (17, 33, 65))]
ROUND_OFF = 1e-15


def scheme(id: str, declared: bool, keeps: str, **changed) -> list[dict]:
    """The rows of a scheme; ``changed`` is column -> {number of a row: its value}."""
    rows = []
    for falls, cells, h in SIZES:
        values = {
            laws.TWO_FORM: ROUND_OFF if declared else 1e-4,
            laws.FOLLOWS: 1e-3,
            laws.ENERGY: 1e-16 if keeps == "cell" else h**4,
            laws.MOMENTUM: 1 / cells**2,
        }
        row = {"equation": "nls", "id": id, "scheme": id, "falls": falls, "N": cells, "h": h, "order": 4}
        row |= {"multisymplectic": declared, "keeps": keeps, "status": "ok", "reason": ""} | values
        row |= {f"{law}, largest term": 1.0 for law in values} | {f"{law}, round-off": ROUND_OFF for law in values}
        rows.append(row | {"total energy error": 1e-14, "quadratic invariant error": 0.0, "steps without a root": 0})
    for column, of in changed.items():
        for k, value in of.items():
            rows[k][column] = value
    return rows


def said(verdict, equip=None, avf=None):
    """The verdict on an EQUIP and an AVF box with these changes."""
    rows = scheme("equip-box", True, "total", **(equip or {})) + scheme("avf-box", False, "cell", **(avf or {}))
    return verdict({spacetime.TABLE: pd.DataFrame(rows)}.get)


@pytest.mark.parametrize(("units", "kept"), [(10, 1), (50, 0)])
def test_the_worst_cell_of_all_runs_tells_of_the_law(units, kept):
    """Ten units of round-off are round-off."""
    found = said(spacetime_page.two_form, {laws.TWO_FORM: {2: units * ROUND_OFF}})
    assert found.holds == bool(kept)
    assert f"in {kept} of 1 pairs of a scheme and an equation that declare it, to {units} units" in found.text
    assert found.short == f"{kept} of 1 keep the multisymplectic law in every cell."


def test_the_control_that_comes_nearest_is_told():
    found = said(spacetime_page.two_form, avf={laws.TWO_FORM: {3: 2e-12}})
    assert found.holds
    assert "the controls miss it by 2e+03 units and more." in found.text
    assert not said(spacetime_page.two_form, avf={laws.TWO_FORM: {3: 9e-15}}).holds


def test_one_run_that_loses_the_energy_of_a_cell_is_enough():
    assert "kept by avf-box;" in said(spacetime_page.energy).text
    lost = said(spacetime_page.energy, avf={laws.ENERGY: {1: 1e-10}})
    assert not lost.holds
    assert "kept by none;" in lost.text
    assert lost.short == "The energy law is kept or falls as declared, not by avf-box (nls)."
    elsewhere = said(spacetime_page.energy, avf={laws.ENERGY: {5: 1e-10}})
    assert elsewhere.holds, "a run of the ladder in space"


def test_totals_are_of_the_worst_run_and_missed_roots_are_added_up():
    more = {"total energy error": {3: 9e-13}, "steps without a root": {0: 2, 4: 3}}
    found = said(spacetime_page.energy, more)
    assert found.holds
    assert "EQUIP keeps the total to 9.0e-13, with 5 steps without a root" in found.text
    assert not said(spacetime_page.energy, {"total energy error": {3: 1.1e-12}}).holds
    assert found.short == "The energy law is kept or falls as declared."


def test_residuals_of_round_off_have_no_order():
    """The last one of the ladder is just ten units: what is left falls with h^4."""
    energy = said(spacetime_page.energy, {laws.ENERGY: {3: 10 * ROUND_OFF}})
    assert energy.holds
    assert "the method's order in 1 of 1 pairs. EQUIP" in energy.text
    assert not said(spacetime_page.energy, {laws.ENERGY: dict.fromkeys(range(4), ROUND_OFF)}).holds
    assert not said(spacetime_page.momentum, {laws.MOMENTUM: {6: 10 * ROUND_OFF}}).holds, "two sizes tell no order"


def test_ten_units_of_round_off_are_no_residual_that_has_an_order():
    column = spacetime_page.COLUMNS["energy order"]
    for units, empty in ((10, True), (11, False)):
        falling = {laws.ENERGY: {k: units * ROUND_OFF * (1 if empty else 16 ** (3 - k)) for k in range(4)}}
        shown = said(spacetime_page.PAGE.table, falling).frame.set_index("scheme")
        assert pd.isna(shown.loc["equip-box", column]) == empty


def test_of_several_controls_the_nearest_is_told():
    rows = [scheme("avf-box", False, "cell", **{laws.TWO_FORM: dict.fromkeys(range(7), v)}) for v in (4e-12, 3e-12)]
    table = pd.DataFrame([*scheme("equip-box", True, "total"), *rows[0], *({**r, "id": "b"} for r in rows[1])])
    found = spacetime_page.two_form({spacetime.TABLE: table}.get)
    assert "the controls miss it by 3000 units and more." in found.text


def test_momenta_are_counted_of_those_that_declare_the_law():
    good, bad = said(spacetime_page.momentum), said(spacetime_page.momentum, {laws.MOMENTUM: {6: 1.0}})
    assert good.text == "The momentum law's residual falls with Δx² in 1 of 1 pairs."
    assert bad.text == "The momentum law's residual falls with Δx² in 0 of 1 pairs, not equip-box (nls)."
    assert [good.holds, bad.holds] == [True, False]


def test_a_run_that_stops_is_left_out_and_without_any_nothing_is_said():
    failed = {"status": dict.fromkeys(range(7), "not-solved")}
    assert "of 0 pairs" in said(spacetime_page.two_form, failed).text
    for verdict in spacetime_page.PAGE.verdicts:
        assert said(verdict, failed, failed) is None
    assert said(spacetime_page.PAGE.table, failed, failed) is None


def test_the_largest_of_all_runs_is_shown():
    more = {
        laws.TWO_FORM: {1: 4e-15},
        f"{laws.TWO_FORM}, largest term": {1: 2.0},
        "quadratic invariant error": {2: 3e-3},
    }
    shown = said(spacetime_page.PAGE.table, more).frame.set_index("scheme")
    line = shown.loc["equip-box"].tolist()
    assert 2e-15 in line
    assert 3e-3 in line
    assert len(said(spacetime_page.PAGE.whole)) == 14
