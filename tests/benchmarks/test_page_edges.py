"""Pages at their edges: what lies just on a line, what is shown first and how it is written, tables with one row."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.invariants import page as invariants
from phasebench.benchmarks.experiments.orders import page as orders
from phasebench.benchmarks.experiments.oscillatory import page as oscillatory
from phasebench.benchmarks.experiments.printed import page as printed
from phasebench.benchmarks.experiments.references import page as references
from phasebench.benchmarks.experiments.structure import page as structure
from phasebench.benchmarks.experiments.waves import page as waves
from phasebench.benchmarks.page.page import ROWS


def frame(*rows: dict, **same) -> pd.DataFrame:
    """A table of rows, each with what is the same in all."""
    return pd.DataFrame([same | row for row in rows])


# -- orders ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def fitted(monkeypatch):
    """Orders in doubles as they are told: (order above the declared one, half-width, points) of each method."""

    def tell(**of):
        found = [
            {"method": name, "problem": "x", "kind": "phasebench", "declared": 0.0, "order": order, "points": points}
            | {"low": order - half, "high": order + half, "h_first": 0.1, "h_last": 0.01}
            for name, (order, half, points) in of.items()
        ]
        monkeypatch.setattr(orders.sweep, "orders", lambda records: found)
        return {"rows": frame({"method": "any"})}.get

    return tell


def test_an_order_that_is_just_a_gate_off_is_off_and_just_as_wide_is_sharp(fitted):
    """0.1 off with an interval of 0.1 to either side: not as declared, not irregular, and shown."""
    data = fitted(a=(0.1, 0.1, 3))
    said = orders.confirmed(data)
    assert "1 have a window of 3 steps above the noise: 0 are within 0.1 of the declared order, 0 converge" in said.text
    assert orders.table(data).frame["measured"].tolist() == ["0.10 ± 0.10"]
    exact = frame({"method": "m", "problem": "x", "declared": 0.0, "order": 0.1, "digits": 40})
    assert not orders.exact({"multiprecision": exact}.get).holds


@pytest.mark.parametrize(("below", "are"), [(("a",), "1 is"), (("a", "b"), "2 are")])
def test_half_an_order_below_is_an_order_too_low(fitted, below, are):
    data = fitted(good=(0.0, 0.01, 9), **dict.fromkeys(below, (-0.5, 0.05, 3)))
    said = orders.confirmed(data)
    assert not said.holds
    assert f"{are} an order too low: " in said.text
    assert (
        said.short
        == f"In doubles {len(below)} of {len(below) + 1} pairs with a window of steps {are[2:]} an order too low."
    )
    assert orders.confirmed(fitted(a=(-0.49, 0.05, 3))).short.startswith("In doubles 0 of 1 pairs")


def test_an_order_without_a_window_is_shown_without_an_interval(fitted):
    whole = orders.PAGE.whole(fitted(few=(0.5, 0.01, 2), endless=(0.5, np.inf, 9), sharp=(0.5, 0.01, 3)))
    assert whole["measured"].tolist() == ["no window", "no window", "0.50 ± 0.01"]
    nobody = fitted()
    assert orders.PAGE.whole(nobody) is None
    assert orders.table(nobody) is None


def test_of_many_orders_the_farthest_are_shown(fitted):
    data = fitted(**{f"m{k}": (0.2 + 0.01 * k, 0.01, 5) for k in range(ROWS + 5)})
    shown = orders.table(data)
    assert shown.frame["method"].tolist() == [f"m{k}" for k in range(ROWS + 4, 4, -1)]
    assert f"the {ROWS} farthest of the {ROWS + 5} pairs" in shown.caption


# -- structure ---------------------------------------------------------------------------------------------------------


def defects(*of: tuple[str, bool, float], name="symplecticity") -> pd.DataFrame:
    return frame(*({"property": name, "method": m, "declared": d, "defect": x} for m, d, x in of))


def test_a_defect_on_the_line_is_none():
    line = structure.NOTHING
    assert structure.symplecticity({"structure": defects(("a", True, line), ("b", False, 1.0))}.get).holds
    hidden = structure.symplecticity({"structure": defects(("a", True, 0.0), ("b", False, line))}.get)
    assert not hidden.holds
    assert "undeclared, it is had by b." in hidden.text


def test_one_that_breaks_and_one_that_hides_are_two_findings():
    both = structure.symmetry({"structure": defects(("a", True, 1.0), ("b", False, 0.0), name="symmetry")}.get)
    assert not both.holds
    assert both.short == "0 of 2 step maps are as declared in symmetry."


def test_methods_of_one_kind_alone_are_told():
    others = structure.symmetry({"structure": defects(("a", False, 1e-3), name="symmetry")}.get)
    assert others.text == "Symmetry: of the 1 others the least is 0.001."
    alone = structure.symmetry({"structure": defects(("a", True, 1e-30), name="symmetry")}.get)
    assert alone.text == "Symmetry: of 1 methods declared to have it the largest defect is 1.00e-30."


def test_what_is_declared_is_written_in_words():
    whole = structure.PAGE.whole({"structure": defects(("a", True, 0.0), ("b", False, 1.0))}.get)
    assert whole["declared"].tolist() == ["yes", "no"]


# -- resonances --------------------------------------------------------------------------------------------------------


def over(name: str, *of: tuple[float, str, float]) -> list[dict]:
    columns = (oscillatory.RATIO, "status", oscillatory.ENERGY)
    return [{"method": name, oscillatory.OSCILLATORY: r[2]} | dict(zip(columns, r, strict=True)) for r in of]


def test_an_error_of_just_the_limit_is_a_loss_and_is_listed():
    rows = frame(
        *over("a", (0.1, "ok", 1e-3), (0.5, "ok", oscillatory.LOST), (0.7, "refused", np.nan), (0.9, "ok", 0.5))
    )
    whole = oscillatory.PAGE.whole({"oscillatory": rows}.get)
    assert whole[oscillatory.RATIO].tolist() == [0.5, 0.7]
    (summed,) = oscillatory.table({"oscillatory": rows}.get).frame.to_dict("records")
    assert (summed["energy lost"], summed["first lost at h omega / pi"]) == (2, 0.5)
    assert not oscillatory.survivors({"oscillatory": rows}.get).holds


def test_where_the_energy_is_lost_and_who_is_best_are_no_findings():
    rows = frame(*over("a", (0.1, "ok", 1e-3), (1.1, "ok", 2.0), (1.3, "ok", 1e-3)))
    lost, best = oscillatory.resonances({"oscillatory": rows}.get), oscillatory.smallest({"oscillatory": rows}.get)
    assert lost.holds
    assert best.holds
    assert lost.text == "The others lose it: a near 1 π."
    farther = frame(*over("a", (0.1, "ok", 1e-3), (1.11, "ok", 2.0), (1.3, "ok", 1e-3)))
    assert oscillatory.resonances({"oscillatory": farther}.get).text.endswith("a at 1 step size elsewhere.")


def test_a_method_that_never_ends_has_no_greatest_error():
    rows = frame(*over("never", (0.1, "diverged", np.nan)), *over("ever", (0.1, "ok", 1e-3)))
    shown = oscillatory.table({"oscillatory": rows}.get).frame.set_index("method")
    assert np.isnan(shown.loc["never", "greatest energy error"])
    assert np.isnan(shown.loc["never", "at h omega / pi"])
    assert shown.loc["ever", "at h omega / pi"] == 0.1
    assert oscillatory.smallest({"oscillatory": rows.head(1)}.get) is None


# -- the printed columns -----------------------------------------------------------------------------------------------


def entry(scheme="scheme-v", units=0.0, **more) -> dict:
    row = {"scheme": scheme, "lambda": None, "h": 0.01, "printed": 4.23e-6, "refinement_difference": 4.23381e-6}
    return row | {"units": units, "order": 2.0, "global_error": 1.2345e-6} | more


def test_just_six_tenths_of_a_unit_is_agreement():
    said = printed.agreement({"printed": frame(entry(units=printed.AGREEMENT))}.get)
    assert said.holds
    assert "1 are what is measured, rounded, and 1 are within 0.6" in said.text
    column = [entry("scheme-iv", printed.AGREEMENT, h=h, refinement_difference=h**2) for h in (0.01, 0.005, 0.0025)]
    assert printed.scheme_iv({"printed": frame(*column)}.get).holds
    assert printed.scheme_iv({"printed": frame(*column[:2])}.get) is None


def test_entries_are_written_with_the_digits_that_the_talk_prints():
    whole = printed.PAGE.whole({"printed": frame(entry())}.get)
    assert whole[["printed", "measured", "global error", "lambda"]].iloc[0].tolist() == [
        "4.23e-06", "4.2338e-06", "1.23e-06", "",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("agreeing", "words"),
    [((1, 1, 1), "a, b and c come nearest, with 1 of the 2"), ((1, 0, 0), "a comes nearest, with 1"),
     ((2, 2, 0), "a and b explain it, with 2"), ((2, 0, 0), "a explains it, with 2")],
)  # fmt: skip
def test_one_or_more_ways_come_nearest_or_explain(agreeing, words):
    ways = [{"recipe": r, "entries that agree": n} for r, n in zip("abc", agreeing, strict=True)]
    columns = frame({"recipe": printed.CLAIM, "entries that agree": 2}, *ways, **{"0.01": 1.0, "0.005": 0.5})
    scans = frame({"steps": 9, "without a root": 0, "far roots": 1, "far root closest to 1/2": 3.0})
    said = printed.explanations({"riddle": scans, "riddle_columns": columns}.get)
    assert words in said.text
    assert said.holds == (max(agreeing) < 2)
    assert said.short.endswith(f"the best gives {max(agreeing)} of 2 entries.")


# -- references --------------------------------------------------------------------------------------------------------

CERTIFIED = {
    "problem": "a", "t_end": 10.0, "states": 4, "error": 1e-21, "uncertainty": 1e-20, "changed": None, "disagree": 0,
    "pairs": 5, "horizon": 10.0, "earliest": 10.0, "latest": 12.0, "unchecked": 0, "its uncertainty": 1e-15,
    "least bound": 4.0, "largest bound": 4.0, "no comparison": 0, "long double leaves": 10.0, "rate": np.nan,
    "distance": 1e-16,
}  # fmt: skip


def certified(*changes: dict):
    return {"references": frame(*changes, **CERTIFIED)}.get


def test_stored_digits_are_counted_and_the_least_certain_named():
    good = references.unmoved(certified({}, {"problem": "b", "uncertainty": 3e-18, "largest bound": 7.0}))
    assert good.holds
    assert "of all 8 stored states of 2 references" in good.text
    assert "which are 4 to 7 times the error and at most 3.0e-18 (b at t = 10)" in good.text
    assert "which are 4 times the error" in references.unmoved(certified({}, {})).text
    bad = references.unmoved(certified({}, {"problem": "b", "changed": "moved by 1e-9"}))
    assert not bad.holds
    assert bad.text == "Of 2 references these state what does not hold: b (moved by 1e-9)."
    assert bad.short == "1 of 2 references state what does not hold."
    assert good.short == "None of 2 references state what does not hold."


def test_rows_without_an_error_are_of_an_earlier_form():
    assert references.unmoved(certified({"error": np.nan})) is None
    assert references.unmoved({"references": frame(CERTIFIED).drop(columns="error")}.get) is None
    assert "of 1 references" in references.unmoved(certified({}, {"error": np.nan})).text


def test_comparisons_with_another_solver_are_added_up():
    good = references.second(certified({}, {"problem": "b", "its uncertainty": 3e-15, "no comparison": 1}))
    assert good.holds
    assert good.text.startswith("In all 10 comparisons with another solver the distance is within")
    assert "own is 2.0e-15 in the median; 1 more is no comparison" in good.text
    assert "2 more are no comparisons" in references.second(certified({"no comparison": 2})).text
    assert "no comparison" not in references.second(certified({})).text
    bad = references.second(certified({}, {"problem": "b", "disagree": 1}, {"problem": "c", "unchecked": 2}))
    assert not bad.holds
    assert bad.text.startswith("Solvers disagree beyond their uncertainties on b;")
    assert bad.text.endswith("No other solver compares on every state of c.")
    assert bad.short == "Solvers disagree on 1 of 3 references; 1 have a state without a comparison."


def test_horizons_are_told_the_earliest_first_and_long_double_beside_them():
    short = {"horizon": 5.0, "earliest": 4.0, "latest": 6.0, "long double leaves": 5.5}
    rows = [{}, {"problem": "b"} | short, {"problem": "c", "t_end": 100.0} | short]
    said = references.horizons(certified(*rows))
    assert (
        "to the end on 1 of 3 orbits, on the others to the horizon: c (t = 5 of 100) and b (t = 5 of 10)." in said.text
    )
    assert said.text.endswith("left the limit within the interval on 2 of 2.")
    assert said.short == "Horizons fall before the end on 2 of 3 orbits."
    assert references.horizons(certified({})).text == (
        "Rounding to long double stays within its limit to the end of every orbit."
    )
    early = references.horizons(certified({"problem": "b"} | short | {"long double leaves": 3.0}))
    assert "on 0 of 1, outside on b (t = 3)." in early.text


@pytest.mark.parametrize(("limited", "outside", "holds"), [(1, 0, True), (20, 3, True), (20, 4, False), (100, 11, True),
                                                           (100, 12, False), (1, 1, False)])  # fmt: skip
def test_of_many_runs_five_in_a_hundred_may_leave_early_or_late(limited, outside, holds):
    """And three standard deviations more: 5 + 6.5 of 100, 1 + 2.9 of 20, 0.05 + 0.65 of one."""
    short = {"horizon": 5.0, "earliest": 4.0, "latest": 6.0}
    rows = [short | {"long double leaves": 9.0 if k < outside else 5.0} for k in range(limited)]
    assert references.horizons(certified(*rows)).holds == holds


def test_the_table_has_orbits_that_part_and_then_the_ten_least_certain():
    easy = [{"problem": f"e{k}", "uncertainty": 1e-20 * (k + 1)} for k in range(12)]
    hard = [{"problem": "fast", "rate": 0.1}, {"problem": "soon", "earliest": 9.0}]
    shown = references.table(certified(*easy, *hard)).frame
    assert shown["problem"].tolist() == ["fast", "soon", *(f"e{k}" for k in range(11, 1, -1))]
    many = references.table(certified(*({"problem": f"h{k}", "rate": 0.1} for k in range(30)))).frame
    assert many["problem"].tolist() == [f"h{k}" for k in range(ROWS)]
    assert len(references.PAGE.whole(certified(*easy, *hard))) == 14


# -- long runs ---------------------------------------------------------------------------------------------------------

LONG = {
    "purpose": "drift", "status": "ok", "kind": "phasebench", "t_end": 1000.0, "h": 0.1, "fallbacks": 0,
    "scene": "pendulum-t1000", "problem": "pendulum:swinging", "energy_drift": 0.0, "energy_drift_low": -1e-20,
    "energy_drift_high": 1e-20, "energy_max": 1e-15, "energy_end": 0.0, "angular-momentum_max": 1e-15,
}  # fmt: skip


def long_runs(*changes: dict):
    return {"rows": frame(*({"method": c["id"]} | c for c in changes), **LONG)}.get


def test_an_error_of_just_the_limit_is_kept():
    limit = invariants.KEPT
    assert invariants.energy(long_runs({"id": "avf", "energy_max": limit})).holds
    assert invariants.momentum(long_runs({"id": "gauss-2", "angular-momentum_max": limit})).holds


def test_the_table_of_long_runs_has_scenes_as_they_come_and_the_first_to_stop():
    scenes = [{"id": "avf", "scene": s} for s in ("z", "a")]
    names = list("abcdefgh")
    stopped = [{"id": "rk4", "method": m, "status": "diverged"} for m in names]
    shown = invariants.table(long_runs(*scenes, *stopped)).frame
    assert shown["scene"].tolist()[:2] == ["z", "a"]
    assert shown[shown["why"] == "stopped early"]["method"].tolist() == names[:6]


# -- waves -------------------------------------------------------------------------------------------------------------

WAVE = {
    "problem": "klein-gordon", "method": "scheme-v", "invariant": "charge", "fallbacks": 0, "h": 0.1, "status": "ok",
    "energy class": "round-off", "quadratic class": "round-off", "energy is kept": True, "energy error": 1e-15,
    "invariant is kept": True, "invariant error": 1e-16, "evaluations per step": 9, "seconds": 1.0,
}  # fmt: skip


def pde(*changes: dict):
    return {"pde": frame(*changes, **WAVE)}.get


def test_who_keeps_what_it_declares_is_counted_and_the_others_are_told():
    bounded = {"energy class": "bounded", "quadratic class": "bounded"}
    loses = {"energy is kept": False, "invariant is kept": False}
    rows = [{}, {"energy error": 1e-14, "invariant error": 1e-14}, {"method": "b"} | loses]
    rows += [{"method": "c"} | bounded | loses | {k: x} for x in (0.5, 0.25) for k in ("energy error",)]
    rows += [{"method": "d", "energy error": 1e-16} | bounded, {"method": "e", "status": "diverged"} | loses]
    said = waves.energy(pde(*rows))
    assert said.text == (
        "The energy (on steps with a root) is kept to round-off in 2 of 3 runs whose method declares it (at most "
        "1.00e-14), not by b; the other methods' error is at least 0.25."
    )
    assert not said.holds
    assert said.short == "The energy (on steps with a root) is kept in 2 of 3 runs that declare it."
    mass = {"invariant": "mass", "invariant is kept": False}
    charge = waves.charge(pde({}, mass))
    assert charge.holds
    assert charge.text.endswith("is kept to round-off in 1 of 1 runs whose method declares it (at most 1.00e-16).")
    assert waves.charge(pde(mass)) is None
    nobody = waves.energy(pde({"energy is kept": False}))
    assert nobody.text.endswith("in 0 of 1 runs whose method declares it, not by scheme-v.")
    assert waves.energy(pde({"status": "diverged"})) is None


def test_steps_without_a_root_are_added_up():
    said = waves.roots(pde({}, {"fallbacks": 1}, {"method": "b", "h": 0.05, "fallbacks": 3}))
    assert not said.holds
    assert said.text == (
        "Steps without a root: scheme-v on klein-gordon at h = 0.1: 1 and b on klein-gordon at h = 0.05: 3."
    )
    assert said.short.startswith("4 steps have no root")
    none = waves.roots(pde({}))
    assert none.holds
    assert none.text == "No step of any run is without a root."
    assert waves.roots(pde({"status": "diverged"})) is None


def test_the_table_of_waves_has_the_smallest_steps_in_their_order():
    rows = [{"method": m, "h": h} for m in ("z", "a") for h in (0.2, 0.05, 0.1)]
    shown = waves.table(pde(*rows)).frame
    assert shown[["method", "h"]].to_numpy().tolist() == [["z", 0.05], ["a", 0.05]]
    many = waves.table(pde(*({"method": f"m{k}"} for k in range(30)))).frame
    assert many["method"].tolist() == [f"m{k}" for k in range(ROWS)]
    assert len(waves.PAGE.whole(pde(*rows))) == 6
