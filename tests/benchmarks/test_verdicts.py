"""Verdicts of the pages on printed tables, orders, structure, the matrix, invariants, energies and resonances.

Each sentence on tables made for it: its thresholds from both sides, its numbers, its names.  In `BOTH_SIDES` the values
on either side of a threshold stand as the pages say them, so that a threshold that moved fails here.
"""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.energy_preservation import bench_energy_preservation
from phasebench.benchmarks.experiments.energy_preservation import page as energies
from phasebench.benchmarks.experiments.invariants import page as invariants
from phasebench.benchmarks.experiments.matrix import matrix
from phasebench.benchmarks.experiments.matrix import page as matrix_page
from phasebench.benchmarks.experiments.orders import bench_orders
from phasebench.benchmarks.experiments.orders import page as orders
from phasebench.benchmarks.experiments.oscillatory import bench_oscillatory
from phasebench.benchmarks.experiments.oscillatory import page as oscillatory
from phasebench.benchmarks.experiments.structure import page as structure


def frame(*rows: dict, **same) -> pd.DataFrame:
    """A table of rows, each with what is the same in all."""
    return pd.DataFrame([same | row for row in rows])


def said(verdict, **tables):
    """The verdict on tables."""
    return verdict(tables.get)


# -- orders ------------------------------------------------------------------------------------------------------------


def orders_of(*measured: float) -> pd.DataFrame:
    return frame(*({"method": f"m{k}", "order": x} for k, x in enumerate(measured)), problem="x", declared=2, digits=40)


@pytest.mark.parametrize(("order", "holds"), [(2.09, True), (1.91, True), (2.11, False), (1.89, False), (3, False)])
def test_orders_without_round_off_have_a_gate_on_both_sides(order, holds):
    found = said(orders.exact, multiprecision=orders_of(2.0, order))
    assert found.holds is holds
    assert f"{1 + holds} of 2 orders are as declared" in found.text
    assert ("m1 on x" in found.text) is not holds
    rows = frame({"method": "m", "problem": "x", "declared": 2, "order": order}).to_dict("records")
    assert (not bench_orders.orders_off(rows)) is holds


def test_an_order_without_a_window_is_said_to_have_none():
    found = said(orders.exact, multiprecision=orders_of(2.0, np.nan, 3.25))
    assert not found.holds
    assert "m1 on x (no window) and m2 on x (3.25)." in found.text


def test_the_fewest_digits_are_named():
    table = orders_of(2.0, 2.0).assign(digits=[40, 80])
    assert "(40 digits or more)" in said(orders.exact, multiprecision=table).text


def ladder(name: str, order: float, bend: float = 0.0, points: int = 4) -> list[dict]:
    h = 0.1 / 2.0 ** np.arange(points)
    wave = np.exp(bend * np.array([1, -1, -1, 1, 1, -1])[:points])
    return [{"method": name, "h": x, "global_error": e} for x, e in zip(h, h**order * wave, strict=True)]


def in_doubles(*ladders) -> pd.DataFrame:
    same = {"purpose": "order", "status": "ok", "scene": "s", "problem": "x", "kind": "phasebench"}
    return frame(*(r for rows in ladders for r in rows), **same, declared_order=2, reference_uncertainty=0.0)


@pytest.mark.parametrize(("order", "good"), [(1.92, 1), (2.08, 1), (2.12, 0), (1.88, 0)])
def test_orders_in_doubles_are_counted_within_the_gate(order, good):
    found = said(orders.confirmed, rows=in_doubles(ladder("a", order)))
    assert found.holds
    assert f"{good} are within 0.1" in found.text


@pytest.mark.parametrize(("order", "holds"), [(1.55, True), (1.45, False)])
def test_an_order_too_low_in_doubles_is_a_finding(order, holds):
    found = said(orders.confirmed, rows=in_doubles(ladder("a", order), ladder("b", 2)))
    assert found.holds is holds
    assert (f"a on x ({order:.2f} for 2)" in found.text) is not holds


def test_an_order_with_a_wide_interval_is_no_finding_and_is_counted():
    found = said(orders.confirmed, rows=in_doubles(ladder("a", 1.2, bend=0.4)))
    assert found.holds
    assert "1 converge irregularly" in found.text
    bent = in_doubles(ladder("a", 1.2, bend=0.4), ladder("b", 1.98, bend=0.25))
    assert "0 are within" in said(orders.confirmed, rows=bent.iloc[:4]).text
    assert "1 are within 0.1 of the declared order, 1 converge irregularly" in said(orders.confirmed, rows=bent).text
    none = said(orders.confirmed, rows=in_doubles(ladder("a", 1.2, points=2)))
    assert "of 1 pairs 0 have a window" in none.text
    others = in_doubles(ladder("a", 1.0)).assign(kind="rebound")
    assert said(orders.confirmed, rows=others) is None


def test_the_farthest_orders_are_shown():
    shown = orders.table({"rows": in_doubles(ladder("a", 2.5), ladder("b", 1.2), ladder("c", 2.05))}.get).frame
    assert list(shown["method"]) == ["b", "a"]
    assert shown["measured"].iloc[0].startswith("1.20")


def test_a_picture_of_a_deviation_is_of_every_pair(tmp_path):
    (picture,) = orders.draw({"multiprecision": orders_of(2.0, 2.2)}.get, tmp_path)
    assert "2 pairs" in picture.caption
    assert "±0.1" in picture.caption


# -- structure ---------------------------------------------------------------------------------------------------------


def defects(*of: tuple[str, bool, float]) -> pd.DataFrame:
    both = [{"property": p, "method": m, "declared": d, "defect": x} for p in structure.PROPERTIES for m, d, x in of]
    return frame(*both)


@pytest.mark.parametrize("verdict", [structure.symplecticity, structure.symmetry])
def test_structure_is_judged_by_the_line(verdict):
    good = said(verdict, structure=defects(("a", True, 0.9e-22), ("b", False, 1.1e-22), ("c", True, 1e-30)))
    assert good.holds
    assert "2 methods declared to have it the largest defect is 9.00e-23; of the 1 others the least is 1.10e-22" in (
        good.text
    )
    broken = said(verdict, structure=defects(("a", True, 1.1e-22), ("b", False, 1e-3), ("d", False, 1e-5)))
    assert not broken.holds
    assert "it is broken by a." in broken.text
    assert "the least is 1.00e-05" in broken.text
    assert "2 of 3 step maps" in broken.short
    hidden = said(verdict, structure=defects(("a", True, 0.0), ("b", False, 0.9e-22)))
    assert not hidden.holds
    assert "undeclared, it is had by b." in hidden.text
    assert said(verdict, structure=defects(("a", True, 0.0)).iloc[:0]) is None


def test_the_defects_nearest_to_the_line_are_shown():
    many = defects(
        *((f"y{k}", True, 10.0 ** (-30 - k)) for k in range(9)), *((f"n{k}", False, 0.1**k) for k in range(9))
    )
    shown = structure.table({"structure": many}.get).frame
    first = shown[shown["property"] == "symplecticity"]
    assert list(first["method"]) == [*(f"y{k}" for k in range(6)), *(f"n{k}" for k in range(8, 2, -1))]
    assert set(shown["declared"]) == {"yes", "no"}


@pytest.mark.parametrize(
    ("declared", "defect", "off"),
    [(True, 0.9e-26, 0), (True, 1.1e-26, 1), (False, 1.1e-22, 0), (False, 0.9e-22, 1), (False, 1e-30, 1)],
)
def test_the_main_job_holds_structure_to_round_off(declared, defect, off):
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
def test_a_cell_is_held_to_its_declaration(column, good, bad):
    assert not matrix.contradictions(CELL | {column: good})
    (contradiction,) = matrix.contradictions(CELL | {column: bad})
    word = {"quadratic": "q.D p"}.get(column, column)
    assert contradiction.startswith(word)
    assert not matrix.contradictions(CELL | {column: None})
    assert matrix.contradictions(CELL | {column: np.inf}) or column == "order"
    assert not matrix.contradictions(CELL | {column: bad, "reason": "requires: separable"})


@pytest.mark.parametrize(
    ("column", "lie"),
    [("symplectic", "symplecticity"), ("symmetric", "reversibility"), ("energy_class", "energy"),
     ("quadratic_class", "quadratic")],
)  # fmt: skip
def test_what_is_not_declared_is_not_contradicted(column, lie):
    undeclared = "bounded" if column.endswith("class") else False
    assert not matrix.contradictions(CELL | {column: undeclared, lie: 1.0})


def test_cells_that_fall_short_are_counted_and_explained_ones_are_told_apart():
    known = {"method": "gauss-equip-2", "energy": 1e-9, "fallbacks": 2}
    cells = frame(CELL, CELL | {"method": "avf", "order": 1.0, "declared_order": 2}, CELL | known)
    found = said(matrix_page.declared, matrix=cells)
    assert not found.holds
    assert found.text.startswith("2 cells fall short of their declaration, 1 of them for a known reason")
    assert "not so avf on pendulum: order 1.00, declared 2." in found.text
    assert found.short.startswith("1 of 3 pairs")
    explained = said(matrix_page.declared, matrix=cells.drop(index=1))
    assert explained.holds
    assert explained.text.startswith("1 cells fall short of their declaration, 1 of them")
    assert explained.short.startswith("None of 2")
    lines = matrix_page.table({"matrix": cells}.get).frame
    assert list(lines["why"].str[:3]) == ["NOT", "ste"]


def test_pairs_that_are_missing_or_cannot_run_are_counted():
    pairs = [{"method": m, "problem": p} for m in ("a", "b") for p in ("x", "y", "z")]
    whole = frame(*(CELL | p for p in pairs))
    whole.loc[0, "reason"] = "requires: separable"
    good = said(matrix_page.complete, matrix=whole)
    assert good.holds
    assert good.text.startswith("2 methods on 3 problems: 5 pairs run, in 1 the problem lacks")
    assert good.text.endswith("none is missing.")
    bad = said(matrix_page.complete, matrix=whole.iloc[:4])
    assert not bad.holds
    assert bad.text.endswith("2 are missing.")
    assert bad.short == "2 pairs are missing."


@pytest.mark.parametrize(("order", "more"), [(4.09, False), (4.11, True)])
def test_orders_above_the_declared_one_are_said(order, more):
    found = said(matrix_page.superconvergent, matrix=frame(CELL, CELL | {"problem": "fpu", "order": order}))
    assert (found is not None) is more
    if more:
        assert "On 1 pairs" in found.text
        assert "fpu 1" in found.text
    cannot = CELL | {"problem": "fpu", "order": 9.0, "reason": "requires: separable"}
    assert said(matrix_page.superconvergent, matrix=frame(CELL, cannot)) is None


# -- invariants --------------------------------------------------------------------------------------------------------

LONG = {"purpose": "drift", "status": "ok", "kind": "phasebench", "t_end": 1000.0, "h": 0.1, "fallbacks": 0}
LONG |= {"scene": "pendulum-t1000", "problem": "pendulum:swinging", "energy_drift": 0.0, "energy_drift_low": -1e-20}
LONG |= {"energy_drift_high": 1e-20, "energy_max": 1e-15, "angular-momentum_max": 1e-15}


def runs(*changes: dict) -> pd.DataFrame:
    return frame(*({"method": c["id"]} | c for c in changes), **LONG)


def test_the_energy_is_kept_up_to_what_the_page_says():
    good = said(invariants.energy, rows=runs({"id": "avf", "energy_max": 0.9e-11}, {"id": "avf", "energy_max": 1e-15}))
    assert good.holds
    assert "to 9.00e-12 at worst (avf, pendulum-t1000) over 2 long runs" in good.text
    bad = said(invariants.energy, rows=runs({"id": "avf", "energy_max": 1.1e-11}, {"id": "cpg-1"}))
    assert not bad.holds
    assert bad.text.endswith("above 1e-11: avf.")
    assert "The 2 energy-preserving methods" in bad.text


@pytest.mark.parametrize(
    "left_out",
    [{"id": "avf", "fallbacks": 1}, {"id": "hbvm-2-1"}, {"id": "rk4"}, {"id": "avf", "status": "diverged"},
     {"id": "avf", "kind": "rebound"}, {"id": "avf", "purpose": "order"}],
)  # fmt: skip
def test_what_does_not_claim_to_keep_the_energy_is_not_held_to_it(left_out):
    found = said(invariants.energy, rows=runs({"id": "cpg-1"}, left_out | {"energy_max": 1e-3}))
    assert found.holds
    assert "The 1 energy-preserving methods" in found.text


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
def test_an_undeclared_drift_is_a_finding(sign):
    low, high = sorted(sign * DRIFTING[f"energy_drift_{side}"] for side in ("low", "high"))
    drift = DRIFTING | {"energy_drift": sign * 0.6e-9, "energy_drift_low": low, "energy_drift_high": high}
    drift |= {"energy_end": sign * 0.51e-6}
    bad = said(invariants.drifting, rows=runs({"id": "stormer-verlet"} | drift, {"id": "rk4"} | drift))
    assert not bad.holds
    assert "drifts in rk4 as declared, and in stormer-verlet (pendulum-t1000, h = 0.1), undeclared." in bad.text
    assert bad.short.startswith("1 methods drift undeclared")
    declared = said(invariants.drifting, rows=runs({"id": "rk4"} | drift))
    assert declared.holds
    assert "in rk4 as declared, and in no method" in declared.text


@pytest.mark.parametrize("change", NOT_DRIFTING)
def test_what_is_no_drift_is_no_finding(change):
    found = said(invariants.drifting, rows=runs({"id": "rk4"} | DRIFTING, {"id": "stormer-verlet"} | DRIFTING | change))
    assert found.holds
    assert "stormer-verlet" not in found.text


def test_an_angular_momentum_that_is_lost_is_a_finding():
    other = {"id": "rk4", "angular-momentum_max": 1e-3}
    rows = runs({"id": "stormer-verlet", "angular-momentum_max": 0.9e-11}, other, {"id": "gauss-2"})
    good = said(invariants.momentum, rows=rows)
    assert good.holds
    assert "kept to 9.00e-12 by the 2 methods declared to keep it; the 1 others lose up to 0.001." in good.text
    lost = {"id": "stormer-verlet", "angular-momentum_max": 1.1e-11}
    bad = said(invariants.momentum, rows=runs(lost, other, {"id": "gauss-2"}))
    assert not bad.holds
    assert bad.text.endswith("above 1e-11: stormer-verlet.")
    assert bad.short.startswith("1 methods lose")
    assert said(invariants.momentum, rows=runs(other)) is None


def test_the_best_of_each_class_and_the_drifts_are_shown():
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


# -- energies of Schemes IV and V --------------------------------------------------------------------------------------

STEP = {"problem": "x", "scheme": "scheme-iv", "status": "ok", "h": 0.05, "steps": 100, "without a root": 2,
        energies.WITH: 1e-15, energies.WITHOUT: 1e-8, "scanned steps": 2,
        "scan finds a root within the radius": 0}  # fmt: skip


def steps(*changes: dict) -> pd.DataFrame:
    return frame(*(STEP | c for c in changes))


def test_the_energy_of_schemes_iv_and_v_is_held_to_round_off_on_every_step():
    every = {"without a root": 0, energies.WITHOUT: np.nan}
    for error, holds in ((0.9e-13, True), (1.1e-13, False)):
        found = said(energies.kept, energy_preservation=steps(every | {energies.WITH: error}, every))
        assert found.holds is holds
        assert f"energy error is at most {error:.2e} (scheme-iv on x, h = 0.05); none of 200 steps" in found.text
    left = said(energies.kept, energy_preservation=steps({}, every))
    assert not left.holds
    assert "2 of 200 steps have none" in left.short
    for change in ({"scheme": "scheme-iv-v"}, {"status": "diverged"}):
        assert said(energies.kept, energy_preservation=steps(every, change | {energies.WITH: 1.0})).holds
        assert said(energies.kept, energy_preservation=steps(change)) is None
    assert not said(energies.kept, energy_preservation=steps(every, every | {"h": 0.06, energies.WITH: 1.0})).holds


def test_steps_without_a_root_are_added_up_and_the_largest_error_named():
    found = said(energies.kept, energy_preservation=steps({energies.WITHOUT: 1e-9}, {"scheme": "scheme-v"}))
    assert "4 of 200 steps have none, with an error up to 1.00e-08 (scheme-v on x, h = 0.05)." in found.text
    both = steps({}, {}, {"scheme": "scheme-iv-v", "without a root": 1}, {"scheme": "scheme-iv-v", "without a root": 2})
    other = said(energies.alternating, energy_preservation=both)
    assert "leaves 3 steps of scheme-iv-v without a root (scheme-iv: 4)" in other.text
    assert not other.holds
    assert said(energies.alternating, energy_preservation=steps({"scheme": "scheme-iv-v"})) is not None
    assert said(energies.alternating, energy_preservation=steps({}, {"scheme": "scheme-v-iv"})) is None


def test_a_missed_root_is_a_finding():
    good = said(energies.searched, energy_preservation=steps({}, {}))
    assert good.holds
    assert good.text.startswith("All 4 steps that the root finder leaves")
    assert ": 0 have a root within |λ − 1/2| < 2." in good.text
    bad = said(energies.searched, energy_preservation=steps({}, {"scan finds a root within the radius": 1}))
    assert not bad.holds
    assert bad.short == "The finder misses a root on 1 of 4 steps."
    assert said(energies.searched, energy_preservation=steps({"scanned steps": 0})) is None


def test_steps_without_a_root_in_either_scheme_are_a_finding():
    counts = {"scheme-iv": 5, "scheme-v": 3, "scheme-iv-v": 0, "scheme-v-iv": 0}

    def table(**other):
        return steps(*({"scheme": s, "without a root": n} for s, n in (counts | other).items()))

    good = said(energies.alternating, energy_preservation=table())
    assert good.holds
    assert "leaves 0 steps of scheme-iv-v without a root (scheme-iv: 5) and 0 of scheme-v-iv (scheme-v: 3)" in good.text
    for scheme in ("scheme-iv-v", "scheme-v-iv"):
        bad = said(energies.alternating, energy_preservation=table(**{scheme: 1}))
        assert not bad.holds
        assert bad.short == "1 steps have a root in neither scheme."


def test_the_runs_without_roots_come_first_in_the_table():
    rows = steps({"without a root": 0, energies.WITH: 1.0}, {"without a root": 0, energies.WITH: 2.0}, {})
    rows = rows.assign(**{"one step later": 0.0, "least lambda": 0.4, "greatest lambda": 0.6})
    shown = energies.table({"energy_preservation": rows}.get).frame
    assert list(shown["energy error with one"]) == [1e-15, 2.0, 1.0]
    many = energies.table({"energy_preservation": pd.concat([rows] * 7)}.get).frame
    assert list(many["without a root"]) == [2] * 7 + [0] * 11
    assert len(energies.PAGE.whole({"energy_preservation": rows}.get)) == 3


@pytest.mark.parametrize(
    ("change", "off"),
    [({energies.WITH: 0.9e-14}, 0), ({energies.WITH: 1.1e-14}, 1), ({"angular momentum error": 4.9e-14}, 0),
     ({"angular momentum error": 5.1e-14}, 1), ({"scan finds a root within the radius": 1}, 1),
     ({energies.WITH: 1.0, "status": "diverged"}, 0)],
)  # fmt: skip
def test_the_main_job_holds_schemes_iv_and_v_to_round_off(change, off):
    assert len(bench_energy_preservation.off([STEP | change])) == off


# -- highly oscillatory systems ----------------------------------------------------------------------------------------


def resonant(name: str, **errors: float) -> list[dict]:
    """Rows of a method over h omega / pi, at the multiples given by a name p_10 for 1.0, with their errors."""
    same = {"method": name, "status": "ok", "reason": ""}
    return [
        same | {oscillatory.RATIO: int(k[2:]) / 10, oscillatory.ENERGY: e, oscillatory.OSCILLATORY: 2 * e}
        for k, e in errors.items()
    ]


CALM = resonant("calm", p_1=1e-3, p_10=0.99, p_20=0.5, p_31=0.1)
WILD = resonant("wild", p_1=1e-4, p_10=1.01, p_20=0.5, p_31=3.0, p_35=7.0, p_37=0.1)


def test_survivors_are_named_with_their_greatest_error():
    found = said(oscillatory.survivors, oscillatory=frame(*CALM, *WILD))
    assert found.holds
    assert "by calm (energy error at most 0.99)." in found.text
    assert "up to hω = 3.7 π" in found.text
    assert found.short.startswith("1 of 2 methods survive")
    none = said(oscillatory.survivors, oscillatory=frame(*WILD))
    assert not none.holds
    assert none.text.endswith("by no method.")


def test_a_run_that_stops_is_a_loss():
    stopped = [r | {"status": "diverged", oscillatory.ENERGY: np.nan} if r[oscillatory.RATIO] == 2 else r for r in CALM]
    found = said(oscillatory.survivors, oscillatory=frame(*stopped))
    assert not found.holds
    assert "calm near 2 π" in said(oscillatory.resonances, oscillatory=frame(*stopped)).text


def test_the_places_of_resonances_are_named():
    found = said(oscillatory.resonances, oscillatory=frame(*CALM, *WILD))
    assert found.text == "The others lose it: wild near 1 π and 3 π and at 1 step size elsewhere."
    assert said(oscillatory.resonances, oscillatory=frame(*CALM)) is None
    cliff = resonant("cliff", p_1=1e-3, p_5=0.1, p_6=2.0, p_9=4.0)
    assert said(oscillatory.resonances, oscillatory=frame(*cliff)).text.endswith("cliff above 0.5 π.")
    off = resonant("off", p_1=1e-3, p_12=2.0, p_13=1e-2, p_14=3.0, p_16=0.1)
    assert said(oscillatory.resonances, oscillatory=frame(*off)).text.endswith("off at 2 step sizes elsewhere.")


def test_the_best_at_the_smallest_step_is_named():
    found = said(oscillatory.smallest, oscillatory=frame(*CALM, *WILD))
    assert found.text == "Least energy error at the smallest step, hω = 0.1 π: wild, 1.00e-04."
    assert said(oscillatory.smallest, oscillatory=frame(*CALM, *WILD[1:])).text.endswith("calm, 0.001.")


def test_the_table_sums_up_a_method():
    shown = oscillatory.table({"oscillatory": frame(*WILD)}.get).frame
    (row,) = shown.to_dict("records")
    assert (row["step sizes"], row["energy lost"], row["first lost at h omega / pi"]) == (6, 3, 1.0)
    assert (row["greatest energy error"], row["at h omega / pi"], row["greatest error of I"]) == (7.0, 3.5, 14.0)
    assert (row["median energy error"], row["median error of I"]) == (0.1, 0.2)


@pytest.mark.parametrize(("ratio", "off"), [(0.57, 1), (0.58, 0)])
def test_below_the_limit_of_stormer_verlet_every_method_has_to_get_through(ratio, off):
    row = {"method": "a", oscillatory.RATIO: ratio, "status": "diverged", "reason": "it grew"}
    assert len(bench_oscillatory.off([row])) == off
    assert not bench_oscillatory.off([row | {"status": "ok"}])


# -- what stands on the pages ------------------------------------------------------------------------------------------

STATED = [
    (orders.PAGE, ("GATE = 0.1", "BELOW = 0.5", "at least 3 steps", "40 digits")),
    (structure.PAGE, ("1e-22", "40-digit")),
    (matrix_page.PAGE, ("from 0.1 on", "3 step sizes", "1e+06 units", "10 times", "1e-22", "200 units", "60 steps")),
    (invariants.PAGE, ("SHARE = 0.5", "1e-12", "1e-11")),
    (energies.PAGE, ("1e-13", "< 2")),
    (oscillatory.PAGE, ("error of 1 on", "within 0.1 π")),
]


@pytest.mark.parametrize(("page", "numbers"), STATED, ids=lambda x: getattr(x, "id", ""))
def test_thresholds_stand_on_their_page(page, numbers):
    text = " ".join((*page.setting, *page.limits))
    assert [n for n in numbers if n not in text] == []
    assert not re.search("mpmath", text)
