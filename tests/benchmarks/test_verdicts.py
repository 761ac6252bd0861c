"""Verdicts of the pages on orders, structure, the matrix and invariants.

Fabricated tables test each threshold from both sides, the counts, and where the worst value is. `BOTH_SIDES` repeats
the numbers that the pages state, so that a changed threshold fails here.
"""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.invariants import page as invariants
from phasebench.benchmarks.experiments.matrix import matrix
from phasebench.benchmarks.experiments.matrix import page as matrix_page
from phasebench.benchmarks.experiments.orders import bench_orders
from phasebench.benchmarks.experiments.orders import page as orders
from phasebench.benchmarks.experiments.structure import page as structure
from phasebench.benchmarks.page.verdict import FAIL, FINDING, MISSING, PASS, Count
from support.pages import data, frame

# -- orders ------------------------------------------------------------------------------------------------------------


def orders_of(*measured: float) -> pd.DataFrame:
    return frame(*({"method": f"m{k}", "order": x} for k, x in enumerate(measured)), problem="x", declared=2, digits=40)


@pytest.mark.parametrize(("order", "holds"), [(2.09, True), (1.91, True), (2.11, False), (1.89, False), (3, False)])
def test_exact_orders_are_gated_on_both_sides(order, holds):
    found = orders.exact(data(multiprecision=orders_of(2.0, order)))
    assert (found.outcome, found.measured) == (PASS if holds else FAIL, Count(1 + holds, 2))
    assert ("m1 on x" in found.where) is not holds
    rows = frame({"method": "m", "problem": "x", "declared": 2, "order": order}).to_dict("records")
    assert (not bench_orders.orders_off(rows)) is holds


def test_order_without_a_window_is_not_as_declared():
    found = orders.exact(data(multiprecision=orders_of(2.0, np.nan, 3.25)))
    assert (found.outcome, found.measured) == (FAIL, Count(1, 3))
    assert "3.25" in found.where


def ladder(name: str, order: float, bend: float = 0.0, points: int = 4) -> list[dict]:
    """Fabricated rows of a method with errors h^order at halved h; ``bend`` shifts them alternately up and down."""
    h = 0.1 / 2.0 ** np.arange(points)
    wave = np.exp(bend * np.array([1, -1, -1, 1, 1, -1])[:points])
    return [{"method": name, "h": x, "global_error": e} for x, e in zip(h, h**order * wave, strict=True)]


def in_doubles(*ladders) -> pd.DataFrame:
    """One table of these fabricated rows of runs in double precision, all with the declared order 2."""
    same = {"purpose": "order", "status": "ok", "scene": "s", "problem": "x", "kind": "phasebench"}
    return frame(*(r for rows in ladders for r in rows), **same, declared_order=2, reference_uncertainty=0.0)


@pytest.mark.parametrize(("order", "good"), [(1.92, 1), (2.08, 1), (2.12, 0), (1.88, 0)])
def test_orders_in_doubles_are_counted_within_the_gate(order, good):
    rows = in_doubles(ladder("a", order))
    assert orders.declared_orders(data(rows=rows)).outcome == PASS
    assert f"{good} are within 0.1" in orders.table({"rows": rows}.get).caption


@pytest.mark.parametrize(("order", "holds"), [(1.55, True), (1.45, False)])
def test_too_low_order_in_doubles_is_a_finding(order, holds):
    found = orders.declared_orders(data(rows=in_doubles(ladder("a", order), ladder("b", 2))))
    assert (found.outcome, found.measured) == (PASS if holds else FINDING, Count(0 if holds else 1, 2))
    assert found.where == ("" if holds else f"a on x: {order:.2f} for 2")


def test_order_with_a_wide_interval_is_no_finding():
    assert orders.declared_orders(data(rows=in_doubles(ladder("a", 1.2, bend=0.4)))).outcome == PASS
    bent = in_doubles(ladder("a", 1.2, bend=0.4), ladder("b", 1.98, bend=0.25))
    assert "1 are within 0.1 of the declared order, 1 converge irregularly" in orders.table({"rows": bent}.get).caption
    none = orders.declared_orders(data(rows=in_doubles(ladder("a", 1.2, points=2))))
    assert (none.outcome, none.measured) == (MISSING, Count(0, 0))
    others = in_doubles(ladder("a", 1.0)).assign(kind="rebound")
    assert orders.declared_orders(data(rows=others)) is None


def test_answer_counts_the_orders():
    tables = {"multiprecision": orders_of(2.0, 3.0), "rows": in_doubles(ladder("a", 1.45), ladder("b", 2))}
    assert all(part in orders.answer(tables.get) for part in ("1 of 2", "0.1", "1 of 2 is"))
    assert orders.answer({"rows": tables["rows"]}.get) is None


def test_orders_farthest_from_the_declared_are_shown():
    shown = orders.table({"rows": in_doubles(ladder("a", 2.5), ladder("b", 1.2), ladder("c", 2.05))}.get).frame
    assert list(shown["method"]) == ["b", "a"]
    assert shown["measured"].iloc[0].startswith("1.20")


def test_figure_of_deviations_has_every_pair(tmp_path):
    (picture,) = orders.draw({"multiprecision": orders_of(2.0, 2.2)}.get, tmp_path)
    assert "2 pairs" in picture.caption
    assert "±0.1" in picture.caption


# -- structure ---------------------------------------------------------------------------------------------------------


def defects(*of: tuple[str, bool, float]) -> pd.DataFrame:
    both = [{"property": p, "method": m, "declared": d, "defect": x} for p in structure.PROPERTIES for m, d, x in of]
    return frame(*both)


BOTH = [
    (structure.symplectic, structure.others_not_symplectic, structure.NOTHING),
    (structure.symmetric, structure.others_not_symmetric, structure.NOTHING),
]


@pytest.mark.parametrize(("declared", "others", "least"), BOTH, ids=structure.PROPERTIES[:2])
def test_structure_is_judged_by_the_threshold(declared, others, least):
    def both(*of):
        return [verdict(data(structure=defects(*of))) for verdict in (declared, others)]

    having, lacking = both(("a", True, 0.9e-22), ("b", False, 1.1 * least), ("c", True, 1e-30))
    assert (having.outcome, having.measured, having.where) == (PASS, 0.9e-22, "a")
    assert (lacking.outcome, lacking.measured) == (PASS, Count(0, 1))
    broken, fine = both(("a", True, 1.1e-22), ("b", False, 1e-3), ("d", False, 1e-5))
    assert (broken.outcome, broken.where, fine.outcome) == (FAIL, "a", PASS)
    fine, hidden = both(("a", True, 0.0), ("b", False, 0.9 * least))
    assert (fine.outcome, hidden.outcome, hidden.measured, hidden.where) == (PASS, FAIL, Count(1, 1), "b")
    assert both(("a", True, 0.0), ("b", False, np.nan))[1].measured == Count(1, 1), "a defect must be seen"
    assert declared(data(structure=defects(("a", True, 0.0)).iloc[:0])) is None


def test_high_orders_are_seen_by_their_digits():
    """Gauss of order 16 is measured in 128 digits: a defect far above half of them is one, and one below is not."""
    for others, off in ((structure.others_not_symplectic, 1e-23), (structure.others_not_symmetric, 1e-26)):
        judged = [others(data(structure=defects((m, False, off)))) for m in ("gauss-8-field", "rk4-relaxation")]
        assert [x.outcome for x in judged] == [PASS, FAIL]
        assert others(data(structure=defects(("gauss-8-field", False, 1e-65)))).outcome == FAIL
    rows = [{"method": "gauss-8-field", "property": "symplecticity", "defect": x} for x in (1e-23, 1e-65)]
    assert [len(bench_orders.structure_off([r | {"declared": d}])) for r in rows for d in (False, True)] == [0, 1, 1, 0]


def test_volume_is_kept_where_declared_and_by_no_control():
    fine = structure.volume(data(structure=defects(("a", True, 0.9e-22), ("b", False, 1.1e-22))))
    assert (fine.outcome, fine.measured) == (PASS, Count(2, 2))
    for wrong in (("c", True, 1.1e-22), ("c", False, 0.9e-22), ("c", True, np.nan), ("c", False, np.nan)):
        judged = structure.volume(data(structure=defects(("a", True, 0.0), wrong)))
        assert (judged.outcome, judged.measured, judged.where) == (FAIL, Count(1, 2), "c")
    none = defects(("a", True, 0.0))
    assert structure.volume(data(structure=none[none["property"] != "volume"])).outcome == MISSING


def test_defects_nearest_to_the_threshold_are_shown():
    many = defects(
        *((f"y{k}", True, 10.0 ** (-30 - k)) for k in range(9)), *((f"n{k}", False, 0.1**k) for k in range(9))
    )
    shown = structure.table({"structure": many}.get).frame
    first = shown[shown["property"] == "symplecticity"]
    assert list(first["method"]) == [*(f"y{k}" for k in range(4)), *(f"n{k}" for k in range(8, 4, -1))]
    assert len(shown) == 24
    assert set(shown["declared"]) == {"yes", "no"}


@pytest.mark.parametrize(
    ("declared", "defect", "off"),
    [(True, 0.9e-26, 0), (True, 1.1e-26, 1), (False, 1.1e-22, 0), (False, 0.9e-22, 1), (False, 1e-30, 1)],
)
def test_bench_requires_structure_to_round_off(declared, defect, off):
    rows = [{"method": "a", "property": "symmetry", "declared": declared, "defect": defect}]
    assert len(bench_orders.structure_off(rows)) == off


# -- the matrix --------------------------------------------------------------------------------------------------------

CELL = {"method": "rk4", "problem": "pendulum", "declared_order": 4, "order": 4.0, "symplectic": True,
        "symmetric": True, "symplecticity": 0.0, "reversibility": 0.0, "energy_class": "round-off",
        "quadratic_class": "round-off", "energy": 0.0, "quadratic": 0.0, "reason": None}  # fmt: skip
BOTH_SIDES = [
    ("order", 3.91, 3.89),
    ("symplecticity", 0.9e-22, 1.1e-22),
    ("reversibility", 0.9e-22, 1.1e-22),
    ("energy", 199 * 2.0**-52, 201 * 2.0**-52),
    ("quadratic", 199 * 2.0**-52, 201 * 2.0**-52),
]


@pytest.mark.parametrize(("column", "good", "bad"), BOTH_SIDES)
def test_cell_is_compared_with_its_declaration(column, good, bad):
    assert not matrix.contradictions(CELL | {column: good})
    (contradiction,) = matrix.contradictions(CELL | {column: bad})
    word = {"quadratic": "q.D p"}.get(column, column)
    assert contradiction.startswith(word)
    assert not matrix.contradictions(CELL | {column: None})
    assert bool(matrix.contradictions(CELL | {column: np.inf})) == (column != "order")
    assert not matrix.contradictions(CELL | {column: bad, "reason": "requires: separable"})


@pytest.mark.parametrize(
    ("column", "lie"),
    [("symplectic", "symplecticity"), ("symmetric", "reversibility"), ("energy_class", "energy"),
     ("quadratic_class", "quadratic")],
)  # fmt: skip
def test_undeclared_property_is_not_contradicted(column, lie):
    undeclared = "bounded" if column.endswith("class") else False
    assert not matrix.contradictions(CELL | {column: undeclared, lie: 1.0})


def test_unexplained_shortfalls_are_counted():
    known = {"method": "gauss-equip-2", "energy": 1e-9, "fallbacks": 2}
    cells = frame(CELL, CELL | {"method": "avf", "order": 1.0, "declared_order": 2}, CELL | known)
    found = matrix_page.declarations(data(matrix=cells))
    assert (found.outcome, found.measured) == (FAIL, Count(1, 3))
    assert found.where == "avf on pendulum: order 1.00, declared 2"
    assert all(part in matrix_page.answer({"matrix": cells}.get) for part in ("1 of 3", "2 fall short", "1 for"))
    explained = matrix_page.declarations(data(matrix=cells.drop(index=1)))
    assert (explained.outcome, explained.measured) == (PASS, Count(0, 2))
    lines = matrix_page.table({"matrix": cells}.get).frame
    assert list(lines["why"].str[:3]) == ["NOT", "ste"]


def test_a_pair_whose_run_stopped_is_not_as_declared():
    stopped = CELL | {"problem": "fpu", "energy": None, "energy_reason": "no-root"}
    cells = frame(CELL, stopped)
    found = matrix_page.ended(data(matrix=cells))
    assert (found.outcome, found.measured) == (FINDING, Count(1, 2))
    assert found.where.endswith("on fpu (no-root)")
    assert matrix_page.answer({"matrix": cells}.get).startswith("1 of 2 pairs")
    assert matrix_page.ended(data(matrix=frame(CELL))).outcome == PASS


def test_missing_and_unsuitable_pairs_are_counted(monkeypatch):
    monkeypatch.setattr(matrix_page.matrix, "METHODS", [SimpleNamespace(id="a"), SimpleNamespace(id="b")])
    monkeypatch.setattr(matrix_page.matrix, "PROBLEMS", ("x", "y", "z"))
    pairs = [{"method": m, "problem": p} for m in ("a", "b") for p in ("x", "y", "z")]
    whole = frame(*(CELL | p for p in pairs))
    whole.loc[0, "reason"] = "requires: separable"
    good = matrix_page.complete(data(matrix=whole))
    assert (good.outcome, good.measured) == (PASS, Count(6, 6))
    assert matrix_page.declarations(data(matrix=whole)).measured == Count(0, 5)
    bad = matrix_page.complete(data(matrix=whole.iloc[:4]))
    assert (bad.outcome, bad.measured, bad.where) == (FAIL, Count(4, 6), "b on y and b on z")


@pytest.mark.parametrize(("order", "more"), [(4.09, False), (4.11, True)])
def test_orders_above_the_declared_one_are_shown(order, more):
    shown = matrix_page.table({"matrix": frame(CELL, CELL | {"problem": "fpu", "order": order})}.get)
    assert (shown is not None) is more
    if more:
        assert shown.frame["problems"].tolist() == ["fpu"]
    cannot = CELL | {"problem": "fpu", "order": 9.0, "reason": "requires: separable"}
    assert matrix_page.table({"matrix": frame(CELL, cannot)}.get) is None


# -- invariants --------------------------------------------------------------------------------------------------------

LONG = {"purpose": "drift", "status": "ok", "kind": "phasebench", "t_end": 1000.0, "h": 0.1, "fallbacks": 0}
LONG |= {"scene": "pendulum-t1000", "problem": "pendulum:swinging", "energy_drift": 0.0, "energy_drift_low": -1e-20}
LONG |= {"energy_drift_high": 1e-20, "energy_max": 1e-15, "angular-momentum_max": 1e-15}


def runs(*changes: dict) -> pd.DataFrame:
    return frame(*({"method": c["id"]} | c for c in changes), **LONG)


def test_energy_limit_is_that_of_the_page():
    good = invariants.energy(data(rows=runs({"id": "avf", "energy_max": 0.9e-11}, {"id": "avf", "energy_max": 1e-15})))
    assert (good.outcome, good.measured, good.where) == (PASS, 0.9e-11, "avf on pendulum-t1000")
    for error in (1.1e-11, np.nan):
        bad = invariants.energy(data(rows=runs({"id": "avf", "energy_max": error}, {"id": "cpg-1"})))
        assert (bad.outcome, bad.where) == (FAIL, "avf on pendulum-t1000")


@pytest.mark.parametrize(
    "left_out",
    [{"id": "avf", "fallbacks": 1}, {"id": "hbvm-2-1"}, {"id": "rk4"}, {"id": "avf", "status": "diverged"},
     {"id": "avf", "kind": "rebound"}, {"id": "avf", "purpose": "order"}],
)  # fmt: skip
def test_only_energy_preserving_methods_are_judged(left_out):
    found = invariants.energy(data(rows=runs({"id": "cpg-1"}, left_out | {"energy_max": 1e-3})))
    assert (found.outcome, found.measured) == (PASS, 1e-15)


DRIFTING = {"energy_max": 1e-6, "energy_drift": 0.6e-9, "energy_drift_low": 0.51e-9, "energy_drift_high": 0.7e-9}
DRIFTING |= {"energy_end": 0.51e-6}
NOT_DRIFTING = [
    {"energy_drift_low": 0.49e-9},
    {"energy_end": 0.49e-6},
    {"energy_end": -1e-6},
    {"energy_drift_low": -0.1e-9},
    {"energy_max": 0.9e-12, "energy_end": 0.9e-12},
    {"scene": "lotka-volterra-t120", "problem": "lotka-volterra"},
]


@pytest.mark.parametrize("sign", [1, -1])
def test_undeclared_drift_is_a_finding(sign):
    low, high = sorted(sign * DRIFTING[f"energy_drift_{side}"] for side in ("low", "high"))
    drift = DRIFTING | {"energy_drift": sign * 0.6e-9, "energy_drift_low": low, "energy_drift_high": high}
    drift |= {"energy_end": sign * 0.51e-6}
    bad = invariants.drifting(data(rows=runs({"id": "stormer-verlet"} | drift, {"id": "rk4"} | drift)))
    assert (bad.outcome, bad.measured) == (FAIL, Count(1, 1))
    assert bad.where == "stormer-verlet on pendulum-t1000, h = 0.1"
    both = runs({"id": "rk4"} | drift, {"id": "stormer-verlet"})
    declared = invariants.drifting(data(rows=both))
    assert (declared.outcome, declared.measured) == (PASS, Count(0, 1))
    assert "rk4 drifts" in invariants.answer({"rows": both}.get)


@pytest.mark.parametrize("change", NOT_DRIFTING)
def test_small_or_uncertain_drift_is_no_finding(change):
    found = invariants.drifting(data(rows=runs({"id": "rk4"} | DRIFTING, {"id": "stormer-verlet"} | DRIFTING | change)))
    judged = "problem" not in change  # Lotka-Volterra is not canonical
    assert (found.outcome, found.measured, found.where) == (PASS if judged else MISSING, Count(0, int(judged)), "")


def test_lost_angular_momentum_is_a_finding():
    other = {"id": "rk4", "angular-momentum_max": 1e-3}
    rows = runs({"id": "stormer-verlet", "angular-momentum_max": 0.9e-11}, other, {"id": "gauss-2"})
    good = invariants.momentum(data(rows=rows))
    assert (good.outcome, good.measured, good.where) == (PASS, 0.9e-11, "stormer-verlet on pendulum-t1000")
    lost = {"id": "stormer-verlet", "angular-momentum_max": 1.1e-11}
    bad = invariants.momentum(data(rows=runs(lost, other, {"id": "gauss-2"})))
    assert (bad.outcome, bad.where) == (FAIL, "stormer-verlet on pendulum-t1000")
    assert invariants.momentum(data(rows=runs(other))) is None


def test_best_of_each_class_and_the_drifts_are_shown():
    small, large = ({"id": "avf", "energy_max": e, "method": f"avf {e}"} for e in (1e-15, 1e-13))
    more = {
        "id": "rk4",
        "energy_max": 0.5,
        "energy_drift": 0.4e-3,
        "energy_drift_low": 0.3e-3,
        "energy_drift_high": 1.0,
    }
    rows = runs(
        large,
        small,
        {"id": "stormer-verlet", "energy_max": 1e-6},
        {"id": "explicit-euler"} | DRIFTING,
        more,
        {"id": "rk4", "status": "diverged"},
    )
    shown = invariants.table({"rows": rows}.get).frame
    assert list(shown["why"]) == [
        "least, declared round-off", "least, declared bounded", "drifts", "drifts", "stopped early",
    ]  # fmt: skip
    assert list(shown["energy error"].iloc[[0, 2, 3]]) == [1e-15, 0.5, 1e-6]
    assert shown["drift a unit of time"].iloc[3] == "6.0e-10"


# -- stated thresholds -------------------------------------------------------------------------------------------------

STATED = [
    (orders.PAGE, ("within 0.1", "at least 0.5", "at least 3 steps", "40 digits")),
    (structure.PAGE, ("1e-22", "40 digits")),
    (matrix_page.PAGE, ("it is 0.1 off", "3 step sizes", "1e+06 units", "10 times", "1e-22", "200 units", "60 steps")),
    (invariants.PAGE, ("50%", "1e-12", "1e-11")),
]


@pytest.mark.parametrize(("page", "numbers"), STATED, ids=lambda x: getattr(x, "id", ""))
def test_thresholds_are_stated_on_their_page(page, numbers):
    text = " ".join((*page.setting, *page.limits))
    assert [n for n in numbers if n not in text] == []
    assert not re.search("mpmath", text)
