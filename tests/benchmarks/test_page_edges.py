"""Edge cases of pages: values at a threshold, selection and format of rows, tables with one row."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.invariants import page as invariants
from phasebench.benchmarks.experiments.orders import page as orders
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
