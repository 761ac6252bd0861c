"""Declared properties on random Hamiltonians in multiprecision; and random runs compiled and on plain NumPy.

A declared property holds for every system and lambda. One that is not declared fails for some system, and so does one
that is destroyed by an error in the ninth digit of a coefficient. `test_formula` and `test_bad_input` read random
formulas.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest
import sympy as sp

from phasebench.integrators.compile.codegen import compiled
from phasebench.integrators.record import ROUND_OFF
from phasebench.integrators.registry import BY_ID, METHODS, method
from support import properties
from support.properties import SLIPS, VISIBLE
from support.random_systems import Case, cases, draws

#: Bounds on defects measured with 30 digits; Jacobians are difference quotients with half as many digits.
BOUNDS = {"symplecticity": 1e-17}
BOUND = 1e-24
#: Methods with averages or projections along the gradient at one point, or with a second copy of the state that is
#: carried along, which do not conserve linear invariants.
LOSE_LINEAR = {
    "gonzalez",
    "itoh-abe",
    "pavf",
    "rk4-projected-energy",
    "stormer-verlet-symmetric-projection",
    "tao-2",
    "pihajoki-2",
}
#: Families that require more than a formula of any kind, or choose their own step sizes: they have tests of their own.
ELSEWHERE = {"adaptive", "field", "wisdom_holman", "magnetic", "force_gradient", "processed"}
ELSEWHERE |= {"rattle", "manifold", "multistep", "fcirk", "rigid", "parts"}


def is_declared(what: str, id: str) -> bool:
    """Whether a method has a property according to its record or its family."""
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
HOLDS = [cell for cell in CELLS if is_declared(*cell)]
FAILS = [cell for cell in CELLS if not is_declared(*cell)]


def name(x):
    """The id of a test for its parameter x."""
    return getattr(x, "label", x)


@pytest.fixture(scope="module")
def measured(uncompiled):
    """Results of `support.properties`, measured without compilation."""
    return uncompiled("support/properties.py")


@pytest.fixture(scope="module")
def found(measured):
    """The measured properties, {property: {method or planted fault: result}}."""
    return measured["properties"]


def check_holds(what: str, row: dict):
    """Assert that at least half of the random cases were solved, and that the largest defect is within its bound."""
    assert row["judged"] >= row["drawn"] / 2, "too few steps were solved"
    assert row["worst"] < BOUNDS.get(what, BOUND), row["case"]


@pytest.mark.parametrize(("what", "id"), HOLDS)
def test_declared_properties_hold_on_random_systems(found, what, id):
    check_holds(what, found[what][id])


@pytest.mark.parametrize(("what", "id"), FAILS)
def test_control_undeclared_properties_fail_on_some_system(found, what, id):
    assert found[what][id]["worst"] > VISIBLE


@pytest.mark.parametrize(("what", "slip"), [(what, s) for s in SLIPS for what in s.breaks], ids=name)
def test_control_a_planted_fault_is_seen(found, what, slip):
    assert is_declared(what, slip.id)
    assert found[what][slip.label]["worst"] > VISIBLE


@pytest.mark.parametrize(("what", "slip"), [(what, s) for s in SLIPS for what in s.keeps], ids=name)
def test_a_planted_fault_leaves_other_properties(found, what, slip):
    assert found[what][slip.label]["planted"], "there was no fault"
    check_holds(what, found[what][slip.label])


def test_every_property_holds_for_some_and_fails_for_others():
    assert {what for what, _ in HOLDS} == set(properties.MEASURES)
    assert {what for what, _ in FAILS} | {what for s in SLIPS for what in s.breaks} == set(properties.MEASURES)


def test_every_family_is_tested():
    assert {BY_ID[id].family for id in properties.METHODS} == {m.family for m in METHODS} - ELSEWHERE


# -- what the strategies draw ------------------------------------------------------------------------------------------


def test_random_systems_are_of_every_kind():
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


def test_random_systems_are_of_the_kind_required():
    assert all(c.system.separable for c in draws(cases("separable"), 10))
    assert all(c.system.quadratic_kinetic for c in draws(cases("quadratic"), 10))
    assert all(c.system.unit_mass for c in draws(cases("unit"), 10))
    assert all(c.system.polynomial_degree <= 4 for c in draws(cases("polynomial"), 10))


# -- compiled ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ends(measured):
    """End states of runs in double precision without compilation, one row for each case and method."""
    return measured["ends"]


def numbers(row: dict):
    """The end state, an array, of such a row, where numbers are hexadecimal text."""
    return np.array([float.fromhex(x) for x in row["end"]])


def test_compiled_and_uncompiled_random_runs_agree(ends):
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
