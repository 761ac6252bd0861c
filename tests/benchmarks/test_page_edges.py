"""Edge cases of pages: values at a threshold, selection and format of rows, tables with one row."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.invariants import page as invariants
from phasebench.benchmarks.experiments.orders import page as orders
from phasebench.benchmarks.experiments.references import page as references
from phasebench.benchmarks.experiments.structure import page as structure
from phasebench.benchmarks.page.page import ROWS
from phasebench.benchmarks.page.verdict import FAIL, FINDING, MISSING, PASS, Count
from support.pages import frame

# -- orders ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def fix_orders(monkeypatch):
    """A function that fabricates observed orders and returns the page's data.

    Its arguments: method=(order minus declared order, half-width of its interval, number of points).
    """

    def tell(**of):
        found = [
            {"method": name, "problem": "x", "kind": "phasebench", "declared": 0.0, "order": order, "points": points}
            | {"low": order - half, "high": order + half, "h_first": 0.1, "h_last": 0.01}
            for name, (order, half, points) in of.items()
        ]
        monkeypatch.setattr(orders, "orders", lambda records: found)
        return {"rows": frame({"method": "any"})}.get

    return tell


def test_order_exactly_0_1_off_is_not_confirmed(fix_orders):
    """0.1 off with an interval of +-0.1: neither as declared nor irregular, but in the table."""
    data = fix_orders(a=(0.1, 0.1, 3))
    assert orders.declared_orders(data).measured == Count(0, 1)
    assert orders.table(data).frame["measured"].tolist() == ["0.10 ± 0.10"]
    exact = frame({"method": "m", "problem": "x", "declared": 0.0, "order": 0.1, "digits": 40})
    assert orders.exact({"multiprecision": exact}.get).outcome == FAIL


@pytest.mark.parametrize("below", [("a",), ("a", "b")])
def test_order_half_below_the_declared_is_a_finding(fix_orders, below):
    found = orders.declared_orders(fix_orders(good=(0.0, 0.01, 9), **dict.fromkeys(below, (-0.5, 0.05, 3))))
    assert (found.outcome, found.measured) == (FINDING, Count(len(below), len(below) + 1))
    assert orders.declared_orders(fix_orders(a=(-0.49, 0.05, 3))).outcome == PASS


def test_order_without_a_window_has_no_interval(fix_orders):
    whole = orders.PAGE.whole(fix_orders(few=(0.5, 0.01, 2), endless=(0.5, np.inf, 9), sharp=(0.5, 0.01, 3)))
    assert whole["measured"].tolist() == ["no window", "no window", "0.50 ± 0.01"]
    nobody = fix_orders()
    assert orders.PAGE.whole(nobody) is None
    assert orders.table(nobody) is None


def test_orders_farthest_from_the_declared_are_shown(fix_orders):
    data = fix_orders(**{f"m{k}": (0.2 + 0.01 * k, 0.01, 5) for k in range(ROWS + 5)})
    shown = orders.table(data)
    assert shown.frame["method"].tolist() == [f"m{k}" for k in range(ROWS + 4, 4, -1)]
    assert f"the {ROWS + 5} others the {ROWS} farthest" in shown.caption


# -- structure ---------------------------------------------------------------------------------------------------------


def defects(*of: tuple[str, bool, float], name="symplecticity") -> pd.DataFrame:
    return frame(*({"property": name, "method": m, "declared": d, "defect": x} for m, d, x in of))


def test_defect_at_the_threshold_counts_as_none():
    line = structure.NOTHING
    data = {"structure": defects(("a", True, line), ("b", False, 1.0))}.get
    assert [v.outcome for v in (structure.symplectic(data), structure.others_not_symplectic(data))] == [PASS, PASS]
    hidden = structure.others_not_symplectic({"structure": defects(("a", True, 0.0), ("b", False, line))}.get)
    assert (hidden.outcome, hidden.measured, hidden.where) == (FAIL, Count(1, 1), "b")


def test_broken_and_undeclared_structure_are_two_verdicts():
    data = {"structure": defects(("a", True, 1.0), ("b", False, 0.0), name="symmetry")}.get
    assert [v.outcome for v in (structure.symmetric(data), structure.others_not_symmetric(data))] == [FAIL, FAIL]
    assert "0 of 2" in structure.answer(data)


def test_verdicts_with_methods_of_one_kind():
    others = {"structure": defects(("a", False, 1e-3), name="symmetry")}.get
    assert structure.symmetric(others).outcome == MISSING
    assert structure.others_not_symmetric(others).outcome == PASS
    alone = {"structure": defects(("a", True, 1e-30), name="symmetry")}.get
    assert structure.symmetric(alone).measured == 1e-30
    assert structure.others_not_symmetric(alone).outcome == MISSING


def test_declared_flag_is_written_as_yes_or_no():
    whole = structure.PAGE.whole({"structure": defects(("a", True, 0.0), ("b", False, 1.0))}.get)
    assert whole["declared"].tolist() == ["yes", "no"]


# -- references --------------------------------------------------------------------------------------------------------

CERTIFIED = {
    "problem": "a", "t_end": 10.0, "states": 4, "error": 1e-21, "uncertainty": 1e-20, "changed": None, "disagree": 0,
    "pairs": 5, "horizon": 10.0, "earliest": 10.0, "latest": 12.0, "unchecked": 0, "its uncertainty": 1e-15,
    "least bound": 4.0, "largest bound": 4.0, "no comparison": 0, "long double leaves": 10.0, "rate": np.nan,
    "distance": 1e-16,
}  # fmt: skip


def reference_data(*changes: dict):
    """The page's data: a table of certified references, one row with each of these changes."""
    return {"references": frame(*changes, **CERTIFIED)}.get


def test_changed_reference_fails():
    good = references.confirmations(reference_data({}, {"problem": "b"}))
    assert (good.outcome, good.measured, good.where) == (PASS, Count(2, 2), "")
    bad = references.confirmations(reference_data({}, {"problem": "b", "changed": "moved by 1e-9"}))
    assert (bad.outcome, bad.measured, bad.where) == (FAIL, Count(1, 2), "b")


def test_rows_without_an_error_have_an_older_format():
    assert references.confirmations(reference_data({"error": np.nan})) is None
    assert references.confirmations({"references": frame(CERTIFIED).drop(columns="error")}.get) is None
    assert references.confirmations(reference_data({}, {"error": np.nan})).measured == Count(1, 1)


def test_comparisons_with_another_solver_are_added_up():
    good = reference_data({}, {"problem": "b", "no comparison": 1})
    assert (references.second(good).outcome, references.second(good).measured) == (PASS, Count(0, 10))
    assert (references.comparisons(good).outcome, references.comparisons(good).measured) == (PASS, Count(8, 8))
    bad = reference_data({}, {"problem": "b", "disagree": 1}, {"problem": "c", "unchecked": 2})
    apart, bare = references.second(bad), references.comparisons(bad)
    assert (apart.outcome, apart.measured, apart.where) == (FAIL, Count(1, 15), "b")
    assert (bare.outcome, bare.measured, bare.where) == (FAIL, Count(10, 12), "c")


def test_horizons_are_compared_with_a_long_double_run():
    short = {"horizon": 5.0, "earliest": 4.0, "latest": 6.0, "long double leaves": 5.5}
    data = reference_data({}, {"problem": "b"} | short, {"problem": "c", "t_end": 100.0} | short)
    assert references.horizons(data).measured == Count(2, 2)
    assert "; 2 of them " in references.answer(data)
    assert references.horizons(reference_data({})) is None
    early = references.horizons(reference_data({"problem": "b"} | short | {"long double leaves": 3.0}))
    assert (early.outcome, early.measured, early.where) == (FAIL, Count(0, 1), "b")


def test_smallest_uncertainty_between_states_is_named():
    row = {"problem": "kepler", "error": 1e-16, "uncertainty": 1e-15}
    rows = [row | {"t": 0.25}, row | {"t": 0.75, "uncertainty": 3e-16}]
    found = references.odd_times({references.ODD: frame(*rows)}.get)
    assert (found.outcome, found.measured, found.where) == (PASS, Count(2, 2), "kepler, t = 0.75")
    bad = references.odd_times({references.ODD: frame(*rows, row | {"t": 0.5, "error": 2e-15})}.get)
    assert (bad.outcome, bad.measured, bad.where) == (FAIL, Count(2, 3), "kepler, t = 0.5")


@pytest.mark.parametrize(("limited", "outside", "holds"), [(1, 0, True), (20, 3, True), (20, 4, False), (100, 11, True),
                                                           (100, 12, False), (1, 1, False)])  # fmt: skip
def test_five_percent_of_runs_may_miss_the_horizon(limited, outside, holds):
    """Allowed are 5% plus three standard deviations: 5 + 6.5 of 100, 1 + 2.9 of 20, 0.05 + 0.65 of 1."""
    short = {"horizon": 5.0, "earliest": 4.0, "latest": 6.0}
    rows = [short | {"long double leaves": 9.0 if k < outside else 5.0} for k in range(limited)]
    assert references.horizons(reference_data(*rows)).outcome == (PASS if holds else FAIL)


def test_table_has_diverging_orbits_then_least_certain():
    easy = [{"problem": f"e{k}", "uncertainty": 1e-20 * (k + 1)} for k in range(12)]
    hard = [{"problem": "fast", "rate": 0.1}, {"problem": "soon", "earliest": 9.0}]
    shown = references.table(reference_data(*easy, *hard)).frame
    assert shown["problem"].tolist() == ["fast", "soon", *(f"e{k}" for k in range(11, 1, -1))]
    many = references.table(reference_data(*({"problem": f"h{k}", "rate": 0.1} for k in range(30)))).frame
    assert many["problem"].tolist() == [f"h{k}" for k in range(ROWS)]
    assert len(references.PAGE.whole(reference_data(*easy, *hard))) == 14


# -- long runs ---------------------------------------------------------------------------------------------------------

LONG = {
    "purpose": "drift", "status": "ok", "kind": "phasebench", "t_end": 1000.0, "h": 0.1, "fallbacks": 0,
    "scene": "pendulum-t1000", "problem": "pendulum:swinging", "energy_drift": 0.0, "energy_drift_low": -1e-20,
    "energy_drift_high": 1e-20, "energy_max": 1e-15, "energy_end": 0.0, "angular-momentum_max": 1e-15,
}  # fmt: skip


def long_runs(*changes: dict):
    """The page's data: a table of long runs, one row with each of these changes."""
    return {"rows": frame(*({"method": c["id"]} | c for c in changes), **LONG)}.get


def test_error_equal_to_the_limit_is_preserved():
    limit = invariants.KEPT
    assert invariants.energy(long_runs({"id": "avf", "energy_max": limit})).outcome == PASS
    assert invariants.momentum(long_runs({"id": "gauss-2", "angular-momentum_max": limit})).outcome == PASS


def test_table_of_long_runs_keeps_the_order_of_scenes():
    scenes = [{"id": "avf", "scene": s} for s in ("z", "a")]
    names = list("abcdefgh")
    stopped = [{"id": "rk4", "method": m, "status": "diverged"} for m in names]
    shown = invariants.table(long_runs(*scenes, *stopped)).frame
    assert shown["scene"].tolist()[:2] == ["z", "a"]
    assert shown[shown["why"] == "stopped early"]["method"].tolist() == names[:6]
