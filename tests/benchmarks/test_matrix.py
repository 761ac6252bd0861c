"""The table of every method on every problem: its rows, and contradictions of declarations."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.judge.evidence import NO_DEFECT
from phasebench.benchmarks.measure import every_problem
from phasebench.benchmarks.measure.multiprecision import observed_order
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies.declared import matrix
from phasebench.integrators.registry import BY_ID
from support import cells


@pytest.fixture(scope="module")
def matrix_rows(uncompiled):
    rows = uncompiled("support/cells.py")
    return {(r["method"], r["problem"]): r for r in rows}


def test_every_missing_number_has_a_reason(matrix_rows):
    assert len(matrix_rows) == len(cells.METHODS) * len(cells.PROBLEMS)
    for row in matrix_rows.values():
        assert row.get("reason") or all(k in row or f"{k}_reason" in row for k in every_problem.MEASURED), row


@pytest.mark.parametrize("id", cells.METHODS)
def test_measured_order_is_the_declared_one(matrix_rows, id):
    told = [row for name in cells.PROBLEMS if not (row := matrix_rows[id, name]).get("reason")]
    measured = [row for row in told if "order" in row]
    assert measured or {row["order_reason"] for row in told} == {"exact"}
    for row in measured:
        assert abs(row["order"] - BY_ID[id].order) < 0.1, row


def test_defects_separate_the_methods(matrix_rows):
    assert matrix_rows["stormer-verlet", "pendulum"]["symplecticity"] < NO_DEFECT
    assert matrix_rows["rk4", "pendulum"]["symplecticity"] > 1e6 * NO_DEFECT
    assert matrix_rows["stormer-verlet", "pendulum"]["reversibility"] < NO_DEFECT
    assert matrix_rows["rk4", "pendulum"]["reversibility"] > 1e6 * NO_DEFECT
    assert matrix_rows["avf", "kepler"]["energy"] < 1e-14 < matrix_rows["gauss-2", "kepler"]["energy"]
    assert matrix_rows["gauss-2", "kepler"]["quadratic"] < 1e-14 < matrix_rows["avf", "kepler"]["quadratic"]


def test_cell_without_a_number_has_its_reason(matrix_rows):
    assert matrix_rows["wisdom-holman", "kepler"]["order_reason"] == "exact"
    assert matrix_rows["wisdom-holman", "pendulum"]["reason"] == "requires: Kepler part"
    assert matrix_rows["avf", "lotka-volterra"]["reason"] == "requires: canonical"
    assert matrix_rows["rk4", "lotka-volterra"]["symplecticity_reason"] == "not canonical"
    assert "even in p" in matrix_rows["rk4", "lotka-volterra-log"]["reversibility_reason"]


def test_no_declaration_is_contradicted(matrix_rows):
    assert not [c for row in matrix_rows.values() for c in matrix.contradictions(row)]


LIES = [
    ("rk4", {"declared_order": 5}, "order"),
    ("rk4", {"symplectic": True}, "symplecticity"),
    ("rk4", {"symmetric": True}, "reversibility"),
    ("stormer-verlet", {"energy_class": "round-off"}, "energy"),
    ("avf", {"quadratic_class": "round-off"}, "q.D p"),
]


@pytest.mark.parametrize(("id", "lie", "said"), LIES)
def test_control_false_declaration_is_contradicted(matrix_rows, id, lie, said):
    found = matrix.contradictions(matrix_rows[id, "kepler"] | lie)
    assert len(found) == 1
    assert found[0].startswith(said)


CELL = {"method": "rk4", "problem": "pendulum", "declared_order": 4, "order": 4.0, "symplectic": True,
        "symmetric": True, "symplecticity": 0.0, "reversibility": 0.0, "energy_class": "round-off",
        "quadratic_class": "round-off", "energy": 0.0, "quadratic": 0.0}  # fmt: skip
UNDECLARED = {"symplecticity": {"symplectic": False}, "reversibility": {"symmetric": False},
              "energy": {"energy_class": "bounded"}, "quadratic": {"quadratic_class": "drift"}}  # fmt: skip


@pytest.mark.parametrize(
    ("column", "good", "bad"),
    [("order", 3.91, 3.89), ("symplecticity", 0.9e-22, 1.1e-22), ("reversibility", 0.9e-22, 1.1e-22),
     ("energy", 199 * 2.0**-52, 201 * 2.0**-52), ("quadratic", 199 * 2.0**-52, 201 * 2.0**-52)],
)  # fmt: skip
def test_a_row_is_compared_with_what_is_declared(column, good, bad):
    assert not matrix.contradictions(CELL | {column: good})
    assert not matrix.contradictions(CELL | {column: None})
    (contradiction,) = matrix.contradictions(CELL | {column: bad})
    assert contradiction.startswith({"quadratic": "q.D p"}.get(column, column))
    assert bool(matrix.contradictions(CELL | {column: np.inf})) == (column != "order")
    if column in UNDECLARED:
        assert not matrix.contradictions(CELL | UNDECLARED[column] | {column: 1.0})


def test_only_known_contradictions_are_explained():
    said = "energy error 1.0e-10 of its terms, declared round-off"
    hbvm = {"method": "hbvm-2-1", "problem": "pendulum"}
    assert "polynomial" in matrix.explanation(hbvm, said)
    assert not matrix.explanation(hbvm, "order 1.00, declared 2")
    assert not matrix.explanation(hbvm | {"problem": "henon-heiles"}, said)
    assert not matrix.explanation(hbvm | {"method": "cpg-1"}, said)
    assert "fallbacks" in matrix.explanation(hbvm | {"method": "gauss-equip-2", "fallbacks": 3}, said)
    assert not matrix.explanation(hbvm | {"method": "gauss-equip-2", "fallbacks": 0}, said)


def test_order_with_variable_steps_is_in_its_interval():
    row = {"method": "gauss-4-adaptive", "problem": "figure-eight", "declared_order": 8, "low": 7.1, "high": 8.2}
    assert "interval" in matrix.explanation(row, "order 7.65, declared 8")
    assert not matrix.explanation(row | {"high": 7.9}, "order 7.65, declared 8")
    assert not matrix.explanation(row | {"low": 8.1}, "order 8.15, declared 8")
    assert not matrix.explanation(row | {"method": "gauss-4"}, "order 7.65, declared 8")


EPS = 2.0**-30


@pytest.mark.parametrize(
    ("error", "doubt", "end", "exact"),
    [(9, 1, 0, True), (11, 1, 0, False), (0.9e6 * EPS, 0, 1, True), (1.1e6 * EPS, 0, 1, False)],
    ids=["within the doubt", "beyond it", "round-off", "more than round-off"],
)
def test_method_is_exact_within_doubt_and_round_off(monkeypatch, error, doubt, end, exact):
    monkeypatch.setattr(every_problem, "epsilon", lambda arithmetic: EPS)
    monkeypatch.setattr(every_problem, "_at", lambda name, places: (None, None, mpmath.mpf(1)))
    monkeypatch.setattr(every_problem, "_truth", lambda name, span, places: (np.array([end]), doubt))
    monkeypatch.setattr(
        every_problem, "advance", lambda system, chosen, y, h, steps: np.array([end + mpmath.mpf(error)])
    )
    assert (every_problem._order(BY_ID["rk4"], "pendulum") == {"order_reason": "exact"}) is exact


def test_errors_near_the_doubt_do_not_enter_an_order():
    row = {"h": [1.0, 0.5, 0.25, 0.125], "error": [1.0, 0.25, 0.0625, 0.015625]}
    assert observed_order(row | {"doubt": 0.0015}).points == 4
    assert observed_order(row | {"doubt": 0.0016}).points == 3


def test_variable_steps_have_the_length_of_fixed_ones():
    """Steps of an adaptive method are divided by sigma = r^(3/2) at the start where that is above 1.

    r is near 5 on the geodesic; sigma < 1 on the Kepler orbit.
    """
    geodesic, orbit = problem("schwarzschild"), problem("kepler")
    parts = [
        every_problem._parts(BY_ID[id], made.system, np.array([*made.q0, *made.p0]))
        for id, made in (("gauss-4-adaptive", geodesic), ("gauss-4", geodesic), ("gauss-4-adaptive", orbit))
    ]
    sigma = float(geodesic.system.distances([geodesic.q0], [geodesic.p0])[0, 0]) ** 1.5
    assert parts == [round(sigma), 1, 1]
    assert sigma > 9
