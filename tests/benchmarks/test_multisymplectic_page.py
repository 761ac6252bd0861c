"""The page on local laws: the worst cell decides, round-off has no order, totals are over all runs."""

from __future__ import annotations

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.waves import laws, spacetime, spacetime_page
from phasebench.benchmarks.experiments.waves.bench_waves import failures
from phasebench.benchmarks.page.verdict import FAIL, FINDING, MISSING, PASS, Count

SIZES = [*(("time", 17, 0.1 / 2**k) for k in range(4)), *(("space", n, 0.01) for n in (17, 33, 65))]
ROUND_OFF = 1e-15


def scheme(id: str, declared: bool, keeps: str, **changed) -> list[dict]:
    """Fabricated result rows of a box scheme that conserves energy as ``keeps`` says, in each "cell" or in "total".

    ``declared``: whether it is multisymplectic; ``changed``: {column: {row number: value}}.
    """
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


def both(equip=None, avf=None) -> list[dict]:
    """Fabricated rows of an EQUIP and an AVF box; changes are {column: {row number: value}}."""
    return scheme("equip-box", True, "total", **(equip or {})) + scheme("avf-box", False, "cell", **(avf or {}))


def judge(verdict, equip=None, avf=None):
    """The page's verdict on fabricated rows of an EQUIP and an AVF box, changed as by `both`."""
    return verdict({spacetime.TABLE: pd.DataFrame(both(equip, avf))}.get)


@pytest.mark.parametrize(("units", "kept"), [(10, 1), (50, 0)])
def test_worst_run_decides_on_the_law(units, kept):
    """A local law holds if its largest residual over all runs is at most ten units of round-off."""
    found = judge(spacetime_page.two_form, {laws.TWO_FORM: {2: units * ROUND_OFF}})
    assert found.measured == Count(kept, 1)
    assert (found.outcome, found.where) == ((PASS, "") if kept else (FAIL, "equip-box (nls)"))


@pytest.mark.parametrize(("least", "outcome"), [(2e-12, PASS), (9e-15, FAIL)])
def test_control_that_satisfies_the_law_once_fails(least, outcome):
    found = judge(spacetime_page.controls, avf={laws.TWO_FORM: {3: least}})
    assert (found.outcome, found.where) == (outcome, "" if outcome == PASS else "avf-box (nls)")
    assert found.measured == Count(int(outcome == PASS), 1)


def test_local_energy_is_judged_by_the_worst_run():
    assert judge(spacetime_page.energy).measured == Count(2, 2)
    lost = judge(spacetime_page.energy, avf={laws.ENERGY: {1: 1e-10}})
    assert (lost.measured, lost.outcome, lost.where) == (Count(1, 2), FAIL, "avf-box (nls)")
    elsewhere = judge(spacetime_page.energy, avf={laws.ENERGY: {5: 1e-10}})
    assert elsewhere.outcome == PASS, "a run of the ladder in space"


@pytest.mark.parametrize(("error", "outcome"), [(9e-13, PASS), (1.1e-12, FAIL)])
def test_total_energy_is_judged_by_the_worst_run(error, outcome):
    found = judge(spacetime_page.energy, {"total energy error": {3: error}})
    assert (found.outcome, found.where) == (outcome, "" if outcome == PASS else "equip-box (nls)")


@pytest.mark.parametrize(("off", "good"), [(0.0, True), (-0.2, False), (0.2, False)])
def test_orders_may_be_neither_lower_nor_higher(off, good):
    """The residuals of energy and momentum fall with the powers 4 + off of h and 2 + off of 1/N."""
    falling = {
        laws.ENERGY: {k: h ** (4 + off) for k, (_, _, h) in enumerate(SIZES)},
        laws.MOMENTUM: {k: n ** -(2 + off) for k, (_, n, _) in enumerate(SIZES)},
    }
    for verdict in (spacetime_page.energy_order, spacetime_page.momentum):
        found = judge(verdict, falling)
        assert (found.outcome, found.measured) == (PASS if good else FINDING, Count(int(good), 1))
        assert found.where == ("" if good else "equip-box (nls)")


def test_bench_names_violated_laws():
    assert failures(both()) == []
    lost = failures(both({laws.TWO_FORM: {2: 1e-13}}))
    assert [line.partition(",")[0] for line in lost] == ["equip-box on nls"]
    assert len(failures(both(avf={laws.TWO_FORM: dict.fromkeys(range(7), ROUND_OFF)}))) == 7
    (failed,) = failures(both({"status": {0: "not-converged"}, "reason": {0: "a smaller h"}}))
    assert failed.endswith("a smaller h")


def test_steps_without_a_root_are_added_up():
    shown = judge(spacetime_page.table, {"steps without a root": {0: 2, 4: 3}}).frame
    assert shown["steps without a root"].tolist() == [5, 0]


def test_residuals_at_round_off_have_no_order():
    """An order needs three residuals above ten units of round-off; those at round-off are left out."""
    last = {laws.ENERGY: {3: 10 * ROUND_OFF}}
    assert judge(spacetime_page.energy_order, last).measured == Count(1, 1)
    none = {laws.ENERGY: dict.fromkeys(range(4), ROUND_OFF)}
    assert judge(spacetime_page.energy_order, none).measured == Count(0, 1)
    two = {laws.MOMENTUM: {6: 10 * ROUND_OFF}}
    assert judge(spacetime_page.momentum, two).measured == Count(0, 1), "two sizes tell no order"


def test_order_starts_above_ten_units_of_round_off():
    column = spacetime_page.COLUMNS["energy order"]
    for units, empty in ((10, True), (11, False)):
        falling = {laws.ENERGY: {k: units * ROUND_OFF * (1 if empty else 16 ** (3 - k)) for k in range(4)}}
        shown = judge(spacetime_page.PAGE.table, falling).frame.set_index("scheme")
        assert pd.isna(shown.loc["equip-box", column]) == empty


def test_smallest_residual_of_a_control_is_judged():
    rows = scheme("avf-box", False, "cell", **{laws.TWO_FORM: {k: (4 - k % 2) * 1e-12 for k in range(7)}})
    assert spacetime_page.orders(pd.DataFrame(rows))["least"].tolist() == [pytest.approx(3000)]


def test_only_multisymplectic_schemes_have_judged_orders():
    good, bad = judge(spacetime_page.momentum), judge(spacetime_page.momentum, {laws.MOMENTUM: {6: 1.0}})
    assert (good.measured, good.outcome) == (Count(1, 1), PASS)
    assert (bad.measured, bad.outcome, bad.where) == (Count(0, 1), FINDING, "equip-box (nls)")


def test_failed_run_is_left_out():
    failed = {"status": dict.fromkeys(range(7), "not-solved")}
    assert judge(spacetime_page.two_form, failed).outcome == MISSING
    for verdict in spacetime_page.PAGE.verdicts:
        assert judge(verdict, failed, failed) is None
    assert judge(spacetime_page.PAGE.table, failed, failed) is None
    assert judge(spacetime_page.PAGE.answer, failed, failed) is None


def test_table_shows_the_largest_values():
    more = {
        laws.TWO_FORM: {1: 4e-15},
        f"{laws.TWO_FORM}, largest term": {1: 2.0},
        "quadratic invariant error": {2: 3e-3},
    }
    shown = judge(spacetime_page.PAGE.table, more).frame.set_index("scheme")
    line = shown.loc["equip-box"].tolist()
    assert 2e-15 in line
    assert 3e-3 in line
    assert len(judge(spacetime_page.PAGE.whole)) == 14
