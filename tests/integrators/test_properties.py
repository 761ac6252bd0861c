"""What a record declares, on random Hamiltonians, without round-off; and the same runs compiled and on plain NumPy.

A declared property holds of every system, whatever its lambda; one that is not declared fails on some, and so does one
that a coefficient loses which is off in its ninth digit.  `test_formula` and `test_bad_input` read random formulae.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest
import sympy as sp

from phasebench.integrators.engine.codegen import compiled
from phasebench.integrators.record import ROUND_OFF
from phasebench.integrators.registry import BY_ID, METHODS, method
from support import properties
from support.properties import SLIPS, VISIBLE
from support.random_systems import Case, cases, draws

#: Of measurements in 30 digits; a Jacobian is a difference quotient, with half as many at the least.
BOUNDS = {"symplecticity": 1e-17}
BOUND = 1e-24
#: Averages and projections along the gradient of H at one place lose linear invariants, discrete gradients for parts.
LOSE_LINEAR = {
    "gonzalez",
    "itoh-abe",
    "pavf",
    "rk4-projected-energy",
    "stormer-verlet-symmetric-projection",
}
#: These need more of a system than a formula.
ELSEWHERE = {"adaptive", "wisdom_holman"}


def declared(what: str, id: str) -> bool:
    """Whether a method has a property: by its record, or by what its family is."""
    m = method(id)
    return {
        "symplecticity": m.symplectic,
        "symmetry": m.symmetric,
        "energy": m.energy == ROUND_OFF,
        "bilinear": m.quadratic == ROUND_OFF,
        "linear": id not in LOSE_LINEAR,
        "adjoint": True,
    }[what]


CELLS = properties.cells()
HOLDS = [cell for cell in CELLS if declared(*cell)]
FAILS = [cell for cell in CELLS if not declared(*cell)]


def name(x):
    return getattr(x, "label", x)


@pytest.fixture(scope="module")
def measured(uncompiled):
    return uncompiled("support/properties.py")


@pytest.fixture(scope="module")
def found(measured):
    return measured["properties"]


def check_holds(what: str, row: dict):
    assert row["judged"] >= row["drawn"] / 2, "too few steps were solved"
    assert row["worst"] < BOUNDS.get(what, BOUND), row["case"]


@pytest.mark.parametrize(("what", "id"), HOLDS)
def test_what_is_declared_holds_of_random_systems(found, what, id):
    check_holds(what, found[what][id])


@pytest.mark.parametrize(("what", "id"), FAILS)
def test_control_what_is_not_declared_fails_on_one(found, what, id):
    assert found[what][id]["worst"] > VISIBLE


@pytest.mark.parametrize(("what", "slip"), [(what, s) for s in SLIPS for what in s.breaks], ids=name)
def test_control_a_slip_is_seen(found, what, slip):
    assert declared(what, slip.id)
    assert found[what][slip.label]["worst"] > VISIBLE


@pytest.mark.parametrize(("what", "slip"), [(what, s) for s in SLIPS for what in s.keeps], ids=name)
def test_a_slip_leaves_what_does_not_depend_on_it(found, what, slip):
    check_holds(what, found[what][slip.label])


def test_every_property_holds_of_some_method_and_fails_of_another():
    assert {what for what, _ in HOLDS} == set(properties.MEASURES)
    assert {what for what, _ in FAILS} | {what for s in SLIPS for what in s.breaks} == set(properties.MEASURES)


def test_every_family_is_among_them():
    assert {BY_ID[id].family for id in properties.METHODS} == {m.family for m in METHODS} - ELSEWHERE


# -- what the strategies draw ------------------------------------------------------------------------------------------


def test_what_is_drawn_is_of_every_kind():
    some = draws(cases(), 40)
    assert {c.d for c in some} == {1, 2, 3}
    assert {c.system.separable for c in some} == {True, False}
    assert {c.system.polynomial_degree is None for c in some} == {True, False}
    assert {type(f).__name__ for c in some for f in c.system.H.atoms(sp.Function)} == {"sin", "cos", "exp"}
    assert any("sqrt" in str(c.system.H) for c in some)
    lams = [c.lam for c in some]
    assert min(lams) < -5
    assert max(lams) > 6
    assert any(0 < x < 1 for x in lams)


def test_a_required_kind_is_what_is_drawn():
    assert all(c.system.separable for c in draws(cases("separable"), 10))
    assert all(c.system.quadratic_kinetic for c in draws(cases("quadratic"), 10))
    assert all(c.system.unit_mass for c in draws(cases("unit"), 10))
    assert all(c.system.polynomial_degree <= 4 for c in draws(cases("polynomial"), 10))


# -- compiled ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ends(measured):
    return measured["ends"]


def numbers(row: dict):
    return np.array([float.fromhex(x) for x in row["end"]])


def test_compiled_and_plain_agree_on_random_systems(ends):
    assert compiled()
    assert sum(row["status"] == "ok" for row in ends) > 0.9 * len(ends)
    for row in ends:
        here, there = properties.run(Case.read(row["case"]), row["id"]), numbers(row)
        assert here["status"] == row["status"], row
        assert np.abs(numbers(here) - there).max() < 1e-12 * (1 + np.abs(there).max()), row


def test_control_another_method_or_lambda_ends_elsewhere(ends):
    for _, rows in groupby(ends, lambda row: row["case"]):
        end = {row["id"]: numbers(row) for row in rows}
        assert np.abs(end["rk4"] - end["stormer-verlet"]).max() > 1e-10
    case = Case.read(ends[0]["case"])
    a, b = (numbers(properties.run(replace(case, lam=case.lam + k), "scheme-i")) for k in (0, 1))
    assert np.abs(a - b).max() > 1e-10
