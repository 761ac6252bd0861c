"""The benchmark harness: sweeps, orders, bands, stored tables, reports."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.ladder import bench_errors, peer_rows, sweep
from phasebench.benchmarks.measure.orders import orders
from phasebench.benchmarks.page import markdown
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.scenes import BY_ID, DRIFT, ORDER, SCENES
from phasebench.benchmarks.store import error_tables
from phasebench.integrators import integrate
from phasebench.integrators.registry import METHODS

SCENE = BY_ID["lotka-volterra-t1"]
OSCILLATOR = BY_ID["oscillator-t2"]


def timeless(rows):
    """Rows without their times, which differ between two runs."""
    return [{k: v for k, v in r.items() if k != "seconds"} for r in rows]


def same(a, b) -> bool:
    """True if the rows are equal up to their times, with NaN equal to NaN."""
    return json.dumps(timeless(a), sort_keys=True) == json.dumps(timeless(b), sort_keys=True)


# -- scenes and tasks --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("quick", [False, True])
def test_every_method_and_peer_has_a_cell_on_every_scene(quick):
    cells = sweep.cells(quick)
    names = {(c.key["scene"], n) for c in cells for n in c.names}
    assert names >= {(s.id, x.id) for s in SCENES for x in (*METHODS, *peer_rows.swept())}
    assert all(c.key["scene"] in c.names for c in cells)


def test_quick_tier_has_a_few_methods():
    handful = {c.key["method"] for c in sweep.cells(quick=True) if c.quick}
    assert {"stormer-verlet", "implicit-midpoint", "heyoka", "rebound-leapfrog"} <= handful
    assert len(handful) < 10


def test_tasks_of_one_method_in_both_tiers():
    full, quick = (sweep.tasks([SCENE], q, lambda m: m.id == "rk4") for q in (False, True))
    assert [t.h for t in full] == list(SCENE.steps)
    assert [t.h for t in quick] == list(SCENE.steps[:4])
    assert {t.method for t in full} == {"rk4"}


def test_order_scenes_halve_steps_that_divide_the_span():
    for s in SCENES:
        assert sorted(s.steps, reverse=True) == list(s.steps)
        assert s.purpose in (ORDER, DRIFT)
        if s.purpose == ORDER:
            assert all(a == 2 * b for a, b in pairwise(s.steps)), s.id
            assert all(abs(s.t_end / h - round(s.t_end / h)) < 1e-9 for h in s.steps), s.id


# -- rows --------------------------------------------------------------------------------------------------------------

ALWAYS = {"scene", "problem", "method", "h", "status", "versions"}
MEASURED = {"global_error", "reference_uncertainty", "energy_max", "energy_end", "gradient", "iterations", "fallbacks"}


def test_row_has_the_columns_of_the_design():
    row = sweep.measure(sweep.Task(SCENE.id, "rk4", (), 0.03), repeats=1)
    assert set(row) >= ALWAYS | MEASURED | {"reason", "seconds", "refinement_difference", "steps"}
    assert (row["status"], row["reason"], row["steps"], row["gradient"]) == ("ok", "", 40, 160)
    assert row["seconds"] > 0
    assert "numpy" in row["versions"]


def test_drift_row_has_a_slope_inside_its_interval():
    row = sweep.measure(sweep.Task("lotka-volterra-t120", "rk4", (), 0.12), repeats=1)
    assert row["energy_drift_low"] < row["energy_drift"] < row["energy_drift_high"]
    assert row["energy_drift"] != 0


def test_state_outside_the_domain_of_h_has_diverged():
    """Explicit Euler takes a Lotka-Volterra population below zero, where log is undefined."""
    row = sweep.measure(sweep.Task("lotka-volterra-t120", "explicit-euler", (), 0.03), repeats=1)
    assert row["status"] == "diverged"
    assert "outside H's domain" in row["reason"]
    assert "energy_drift" not in row


def test_invariants_of_the_problem_are_columns():
    """The largest errors of q1 p2 - q2 p1, preserved by Stormer-Verlet, and of p x L - q/|q|, not preserved."""
    for id in ("rk4", "stormer-verlet"):
        row = sweep.measure(sweep.Task("kepler-t1", id, (), 0.01), repeats=1)
        s = integrate(problem("kepler"), id, h=0.01, t_end=1)
        L = s.q[:, 0] * s.p[:, 1] - s.q[:, 1] * s.p[:, 0]
        pericentre = s.p[:, 1] * L - s.q[:, 0] / np.hypot(*s.q.T)
        assert row["angular-momentum_max"] == pytest.approx(np.abs(L - L[0]).max(), abs=1e-15)
        assert row["laplace-runge-lenz-1_max"] == pytest.approx(np.abs(pericentre - pericentre[0]).max(), abs=1e-14)
        assert row["laplace-runge-lenz-1_max"] > 1e-12
        assert (row["angular-momentum_max"] < 1e-14) is (id == "stormer-verlet")


@pytest.mark.parametrize("id", ["rk4", "stormer-verlet"])
def test_global_error_and_refinement_difference(id):
    """||y_h - y_2h|| from two runs; the error of the oscillator against (cos t, -sin t)."""
    h = OSCILLATOR.steps[2]
    row = sweep.measure(sweep.Task(OSCILLATOR.id, id, (), h), repeats=1)
    y, y2 = (
        np.concatenate([s.q[-1], s.p[-1]])
        for s in (integrate(problem(OSCILLATOR.problem), id, h=k * h, t_end=OSCILLATOR.t_end) for k in (1, 2))
    )
    exact = np.array([np.cos(OSCILLATOR.t_end), -np.sin(OSCILLATOR.t_end)])
    assert row["refinement_difference"] == np.abs(y - y2).max()
    assert row["global_error"] == pytest.approx(np.abs(y - exact).max(), abs=1e-15)
    assert row["global_error"] < 0.5 * row["refinement_difference"]


def test_coarsest_row_has_no_refinement_difference():
    row = sweep.measure(sweep.Task(OSCILLATOR.id, "rk4", (), OSCILLATOR.steps[0]), repeats=1)
    assert "refinement_difference" not in row
    assert row["global_error"] > 0


def test_skipped_row_has_its_reason():
    row = sweep.measure(sweep.Task(SCENE.id, "avf", (), 0.12))
    assert row["status"] == "skipped"
    assert "canonical" in row["reason"]
    assert "global_error" not in row
    assert set(row) >= ALWAYS


def test_failed_row_has_its_reason_and_no_error(monkeypatch):
    """Explicit Euler at h = 1 escapes from the Henon-Heiles potential."""
    scene = replace(
        BY_ID["henon-heiles-box-t1"], id="escape", problem="henon-heiles:chaotic", t_end=100.0, steps=(1.0,)
    )
    monkeypatch.setitem(sweep.BY_ID, "escape", scene)
    row = sweep.measure(sweep.Task("escape", "explicit-euler", (), 1.0))
    assert row["status"] == "diverged"
    assert row["reason"]
    assert "global_error" not in row
    assert "seconds" not in row


# -- a sweep -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def todo():
    return sweep.tasks([SCENE, OSCILLATOR], True, lambda m: m.id in ("rk4", "scheme-ii", "avf"))


@pytest.fixture(scope="module")
def rows(todo):
    return sweep.measure_rows(todo, 1)["rows"]


def test_rows_are_in_the_order_of_their_tasks(todo, rows):
    assert [(r["scene"], r["h"]) for r in rows] == [(t.scene, t.h) for t in todo]


def test_cell_can_be_pickled_and_measured():
    (cell,) = sweep.cells(True, [SCENE], lambda m: m.id == "rk4")
    measure, arguments = pickle.loads(pickle.dumps((cell.measure, cell.arguments)))
    assert same(measure(*arguments)["rows"], cell()["rows"])
    assert [r["h"] for r in cell()["rows"]] == list(SCENE.ladder(quick=True))


def test_control_other_tasks_measure_other_rows(todo, rows):
    assert not same(sweep.measure_rows(todo[1:2], 1)["rows"], rows[:1])


# -- orders ------------------------------------------------------------------------------------------------------------


def ladder(order=2, uncertainty=1e-20, floor=0.0, **more):
    """Fabricated rows of a method at seven step sizes with the error h^order + floor."""
    base = {"purpose": ORDER, "scene": "s", "method": "m", "problem": "x", "status": "ok", "declared_order": order}
    steps = [0.1 / 2**k for k in range(7)]
    return [
        base | {"h": h, "global_error": h**order + floor, "reference_uncertainty": uncertainty} | more for h in steps
    ]


def test_order_of_a_power_law_and_its_window():
    (found,) = orders(ladder(order=3))
    assert found["order"] == pytest.approx(3)
    assert (found["h_first"], found["h_last"], found["points"]) == (0.1, 0.1 / 64, 7)
    assert found["declared"] == 3


@pytest.mark.parametrize("status", ["diverged", "not-converged", "collision", "timeout", "skipped"])
def test_failed_rows_do_not_enter_an_order(status):
    rows = ladder()
    rows[0] |= {"status": status}  # its error would fit the power law
    rows[1] |= {"status": status, "global_error": None}
    (found,) = orders(rows)
    assert found["order"] == pytest.approx(2)
    assert (found["h_first"], found["points"]) == (0.025, 5)


def test_control_outlier_widens_the_interval():
    rows = ladder()
    for k, r in enumerate(rows):
        r["global_error"] *= 2 ** ((-1) ** k)
    assert orders(rows)[0]["high"] - orders(rows)[0]["low"] > 0.1


def test_errors_below_the_reference_uncertainty_are_left_out():
    uncertainty = 1e-7
    kept = [r["h"] for r in ladder() if r["global_error"] > 100 * uncertainty]
    assert len(kept) == 5
    (found,) = orders(ladder(uncertainty=uncertainty))
    assert (found["points"], found["h_last"]) == (5, kept[-1])


def test_orders_per_method_without_drift_rows():
    rows = ladder(order=2) + ladder(order=4, method="n", uncertainty=1e-30) + ladder(purpose=DRIFT, scene="long")
    assert {r["method"]: round(r["order"]) for r in orders(rows)} == {"m": 2, "n": 4}


def test_orders_of_measured_rows(rows):
    found = {(r["scene"], r["method"]): r for r in orders(rows)}
    assert found[OSCILLATOR.id, "rk4"]["order"] == pytest.approx(4, abs=0.1)
    assert (SCENE.id, "avf") not in found


# -- bands -------------------------------------------------------------------------------------------------------------


def table_of(name):
    return error_tables.load(name)[0]


def rows_of(table):
    return table.astype(object).where(table.notna(), None).to_dict("records")


@pytest.mark.parametrize("column", ["global_error", "refinement_difference", "energy_max"])
def test_number_outside_its_band_is_reported(column):
    stored = table_of(SCENE.id)
    measured = stored.copy()
    row = measured.index[(measured["method"] == "rk4") & measured[column].notna()][-1]
    old = measured.loc[row, column]
    measured.loc[row, column] = new = old * 1.01
    (found,) = bench_errors.regressions(rows_of(measured), stored, SCENE)
    assert (*found.key, found.column) == ("rk4", str(measured.loc[row, "h"]), column)
    assert (found.measured, found.stored, found.ratio) == (new, old, pytest.approx(1.01))


def test_number_within_its_band_passes():
    stored = table_of(SCENE.id)
    measured = stored.copy()
    measured["global_error"] *= 1 + 0.5 * SCENE.relative
    assert bench_errors.regressions(rows_of(measured), stored, SCENE) == []


def test_band_of_methods_that_choose_a_root():
    """A larger change of the trajectory's error than usual is accepted, but not of the energy error."""
    scene = BY_ID["kepler-t1"]
    stored = table_of(scene.id)
    row = stored.index[(stored["method"] == "scheme-iv") & (stored["global_error"] > 1e-6)][0]
    for factor, violations in ((1.3, 0), (1.7, 1)):
        measured = stored.copy()
        measured.loc[row, "global_error"] *= factor
        assert len(bench_errors.regressions(rows_of(measured), stored, scene)) == violations
    stored.loc[row, "energy_max"] = 1e-6
    measured = stored.copy()
    measured.loc[row, "energy_max"] *= 1.3
    assert [d.column for d in bench_errors.regressions(rows_of(measured), stored, scene)] == ["energy_max"]


def test_missing_row_and_changed_status_are_violations():
    stored = table_of(SCENE.id)
    row = stored.index[stored["status"] == "ok"][0]
    extra = pd.concat([stored, stored.loc[[row]].assign(global_error=1.0)], ignore_index=True)
    assert [d.column for d in bench_errors.regressions(rows_of(extra), stored, SCENE)] == ["row"]
    assert [d.column for d in bench_errors.regressions(rows_of(stored), extra, SCENE)] == ["row"]
    measured = stored.copy()
    measured.loc[row, "status"] = "diverged"
    assert [d.column for d in bench_errors.regressions(rows_of(measured), stored, SCENE)] == ["status"]


def test_measured_rows_are_within_the_stored_bands(rows):
    for scene in (SCENE, OSCILLATOR):
        own = [r for r in rows if r["scene"] == scene.id]
        assert len(own) > 8
        assert bench_errors.regressions(own, table_of(scene.id), scene) == []


def test_regression_fails_the_run_with_both_numbers():
    rows = rows_of(table_of(SCENE.id))
    bad = max((r for r in rows if r["method"] == "rk4"), key=lambda r: r["h"])
    some = [r for r in rows if r["method"] in ("rk4", "stormer-verlet")]
    old = bad["global_error"]
    bad["global_error"] = new = 1.01 * old
    with pytest.raises(AssertionError) as error:
        bench_errors.bench_scene(SCENE, lambda table: [r | {"scene": SCENE.id} for r in some], False, False, [])
    assert all(x in str(error.value) for x in (SCENE.id, "rk4", repr(new), repr(old)))
    bad["global_error"] = old
    bench_errors.bench_scene(SCENE, lambda table: [r | {"scene": SCENE.id} for r in some], False, False, [])


def test_changes_of_a_table_are_summarized():
    old = table_of(SCENE.id)
    assert bench_errors.changes(old, old) == ""
    assert f"{len(old)} rows" in bench_errors.changes(None, old)
    new = old.drop(columns="energy_max").iloc[1:].reset_index(drop=True)
    new.loc[3, "global_error"] *= 2
    new.loc[4, "global_error"] *= 1 + 1e-6
    lines = bench_errors.changes(old, new).splitlines()
    assert len(lines) == 4
    for word, line in zip(("energy_max", ": row", "ratio 2", " 1 "), lines, strict=True):
        assert word in line


def test_new_table_keeps_unmeasured_methods():
    stored = table_of(SCENE.id)
    some = [r | {"global_error": 7.0} for r in rows_of(stored) if r["method"] == "rk4"]
    new = bench_errors.record(some, stored, SCENE)
    assert new["method"].tolist() == stored["method"].tolist()
    assert (new[new["method"] == "rk4"]["global_error"] == 7.0).all()
    others = new["method"] != "rk4"
    assert (new[others]["global_error"].dropna() == stored[others]["global_error"].dropna()).all()
    gone = pd.concat([stored, stored[stored["method"] == "rk4"].assign(method="nobody")])
    assert "nobody" not in set(bench_errors.record(some, gone, SCENE)["method"])


# -- reports -----------------------------------------------------------------------------------------------------------


def test_markdown_table():
    frame = pd.DataFrame({"method": ["rk4", "a long name"], "h": [0.1, None], "n": [12345, 7], "x": [1.23456e-9, -0.5]})
    lines = markdown.table(frame, {"method": "method", "x": "error", "h": "h"}).splitlines()
    assert len({len(x) for x in lines}) == 1
    assert lines[0].split("|")[1:-1] == [" method      ", "    error ", "   h "]
    assert [c.strip() for c in lines[2].split("|")[1:-1]] == ["rk4", "1.23e-09", "0.1"]
    assert [c.strip() for c in lines[3].split("|")[1:-1]] == ["a long name", "-0.5", ""]
    assert set(lines[1]) == set("|-: ")
    assert len(markdown.table(frame.iloc[:0]).splitlines()) == 2


@pytest.mark.parametrize(
    ("x", "text"),
    [(0.0, "0"), (3.0, "3"), (0.012345, "0.0123"), (1.2345e-5, "1.23e-05"), (None, ""), (float("nan"), ""), ("a", "a")],
)
def test_number(x, text):
    assert markdown.number(x) == text


def test_listed_names():
    assert markdown.join_list([]) == "none"
    assert markdown.join_list(["a"]) == "a"
    assert markdown.join_list(["a", "b", "c"]) == "a, b and c"
    assert markdown.join_list(list("abcd"), 2) == "a, b and 2 more"
