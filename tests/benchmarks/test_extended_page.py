"""The experiment on extended phase space: its measurements, and verdicts that change with their rows."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.extended import bench_extended, measure, page
from phasebench.benchmarks.experiments.extended.measure import BOTH, JUMPED, ONE, ORDERS, SPECIAL, STRUCTURE
from phasebench.benchmarks.page.verdict import FAIL, FINDING, MISSING, PASS, Range
from phasebench.benchmarks.problems import problem
from phasebench.integrators.compile.codegen import precision
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import BY_ID

MAPS = (
    ("tao-2", BOTH, 1e-28),
    ("jayawardana-ohsawa-4", ONE, 1e-33),
    ("extended-midpoint-2", ONE, 1e-12),
    ("extended-midpoint-4", ONE, 1e-18),
    ("tao-2", ONE, 1e-6),
)
TABLE = pd.DataFrame(
    [
        {"method": id, "map": of, "problem": "tao", "defect": x, page.DEFECT_ORDER: 6.0 if x > 1e-20 else np.nan}
        for id, of, x in MAPS
    ]
)
FINEST = (("tao-4(omega=2)", 4, 3.99), ("jayawardana-ohsawa-2", 2, 2.0), (SPECIAL, 4, 2.0), (JUMPED, 4, 4.0))
STEPS = pd.DataFrame(
    [
        {"method": id, "declared": p, "h": h, "steps": int(2 / h), "error": h**order, "order": found}
        for id, p, order in FINEST
        for h, found in ((0.5, np.nan), (0.25, 1.0), (0.125, order))
    ]
)


def changed(frame: pd.DataFrame, where, **values) -> pd.DataFrame:
    """The table with other values in the rows where the condition holds."""
    frame = frame.copy()
    for name, value in values.items():
        frame.loc[where, name] = value
    return frame


@pytest.mark.parametrize(
    ("verdict", "row", "otherwise"),
    [(page.tao, 0, FAIL), (page.semiexplicit, 1, FAIL), (page.midpoint, 2, FINDING)],
)
def test_a_defect_decides(verdict, row, otherwise):
    for defect, outcome in ((1e-23, PASS), (1e-21, otherwise)):
        table = changed(TABLE, TABLE.index.isin([row]), defect=defect)
        if verdict is page.midpoint:
            table = changed(table, table.index == 3, defect=1e-30)
        assert verdict({STRUCTURE: table}.get).outcome == outcome
    assert verdict(lambda name: None) is None


def test_the_projection_to_the_midpoint_is_a_finding_where_its_defect_is_largest():
    found = page.midpoint({STRUCTURE: TABLE}.get)
    assert (found.outcome, found.measured, found.where) == (FINDING, 1e-12, "extended-midpoint-2 on tao")


@pytest.mark.parametrize(("order", "outcome"), [(3.91, PASS), (3.89, FAIL), (4.11, FAIL)])
def test_orders_of_methods_for_every_h_are_gated_on_both_sides(order, outcome):
    rows = changed(STEPS, (STEPS["method"] == "tao-4(omega=2)") & (STEPS["h"] == 0.125), order=order)
    found = page.general({ORDERS: rows}.get)
    assert found.outcome == outcome
    assert isinstance(found.measured, Range)
    assert found.where.startswith("tao-4")


@pytest.mark.parametrize(("order", "outcome"), [(2.0, PASS), (3.0, PASS), (3.1, FINDING), (np.nan, MISSING)])
def test_the_special_splitting_is_judged_at_its_smallest_step(order, outcome):
    rows = changed(STEPS, (STEPS["method"] == SPECIAL) & (STEPS["h"] == 0.125), order=order)
    assert page.special({ORDERS: rows}.get).outcome == outcome
    assert page.special({ORDERS: STEPS[STEPS["method"] != SPECIAL]}.get) is None


def test_the_answer_says_what_the_verdicts_say():
    text = page.answer({STRUCTURE: TABLE}.get)
    assert "not symplectic" in text
    assert len(text.split()) <= 30
    held = changed(TABLE, TABLE["method"].str.startswith("extended-midpoint"), defect=1e-30)
    assert "not" not in page.answer({STRUCTURE: held}.get)
    assert page.answer(lambda name: None) is None


def test_tables_and_figure(tmp_path):
    tables = {STRUCTURE: TABLE, ORDERS: STEPS}.get
    shown = page.table(tables).frame
    assert list(shown["method"]) == [id for id, _, _ in MAPS]
    assert shown[page.DEFECT_ORDER].tolist()[:3] == ["", "", "6.0 to 6.0"]
    assert len(page.PAGE.whole(tables)) == len(STEPS)
    (picture,) = page.draw(tables, tmp_path)
    assert (tmp_path / picture.file).stat().st_size > 1000


def test_checks_of_the_run():
    rows = TABLE.to_dict("records")
    assert not bench_extended.maps_off(rows)
    assert len(bench_extended.maps_off([r | {"defect": 1e-9} for r in rows])) == 2
    steps = STEPS.to_dict("records")
    assert not bench_extended.orders_off(steps)
    kept = [r | {"order": 4.0} if r["method"] in (SPECIAL, "jayawardana-ohsawa-2") else r for r in steps]
    assert len(bench_extended.orders_off(kept)) == 2


def test_every_map_and_method_has_a_cell():
    made = measure.cells()
    assert len({c.content for c in made}) == len(made) == len(measure.MAPS) + len(measure.GENERAL) + 2
    assert measure.cells(quick=True) == []
    assert measure.record_of("extended-midpoint-2").order == 2
    assert measure.record_of("extended-midpoint-4") is BY_ID["extended-midpoint-4"]


def test_the_orbit_is_that_of_the_schwarzschild_problem():
    """Radius and momentum after a while, in units of the semilatus rectum."""
    with precision(measure.DIGITS):
        whole, _, _, y = measure.orbit()
    size = float(1 / measure.EPSILON)
    made = problem("schwarzschild:precessing", semilatus=size, e=float(measure.ECCENTRICITY))
    own = integrate(whole, "gauss-4", h=0.01, steps=200, q0=[float(x) for x in y[:2]], p0=[float(x) for x in y[2:]])
    other = integrate(made, "gauss-4", h=0.01 * size**1.5, steps=200)
    r, phi = other.q[-1, 1:] / (size, 1)
    np.testing.assert_allclose(own.q[-1], [r * np.cos(phi), r * np.sin(phi)], rtol=0, atol=1e-9)
    assert abs(own.q[-1, 0] - own.q[0, 0]) > 0.1


@pytest.fixture(scope="module")
def measured(uncompiled):
    """Some rows, measured without compilation."""
    return uncompiled("benchmarks/test_extended_page.py")


def test_measured_defects_and_orders(measured):
    both, one, midpoint = (measured[x] for x in ("both", "one", "midpoint"))
    assert max(r["defect"] for r in both) < 1e-26 < 1e-8 < max(r["defect"] for r in one)
    assert [r[page.DEFECT_ORDER] for r in both] == [None] * 3
    by_name = {r["problem"]: r for r in midpoint}
    assert by_name["coupled"]["defect"] > 1e-13
    assert abs(by_name["coupled"][page.DEFECT_ORDER] - 6) < 0.05
    special, jumped = ([r["order"] for r in measured[x]] for x in ("special", "jumped"))
    assert special[0] is None
    assert abs(special[-1] - 2) < 0.1
    assert abs(jumped[-1] - 4) < 0.1
    assert measured["special"][0]["error"] < measured["jumped"][0]["error"] / 100


if __name__ == "__main__":
    measure.LADDER = (4, 16, 32)
    rows = {name: measure.structure(id, of)[STRUCTURE] for name, id, of in
            (("both", "tao-2", BOTH), ("one", "tao-2", ONE), ("midpoint", "extended-midpoint-2", ONE))}  # fmt: skip
    rows |= {name: measure.orders(id)[ORDERS] for name, id in (("special", SPECIAL), ("jumped", JUMPED))}
    print(json.dumps({"result": rows}))
