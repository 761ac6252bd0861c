"""Implicit equations of steps so wide that a fixed point is not found: Newton's method finds their solution."""

from __future__ import annotations

import pytest

from phasebench.integrators.record import ROUND_OFF
from support import stiff

#: States are of the size of 1, energies of 50, and a Jacobian's entries of 60.
BOUND = 1e-12


@pytest.fixture(scope="module")
def solved(of_each):
    return of_each(stiff)


@pytest.mark.parametrize("label", stiff.METHODS)
def test_doubles_and_many_digits_solve_the_same_equations(solved, label):
    found = solved(label)
    assert found["steps"] == 3 * [stiff.STEPS]
    assert min(found["newton"]) >= stiff.STEPS
    assert found["apart"] < BOUND


@pytest.mark.parametrize("label", [label for label, m in stiff.METHODS.items() if m.symmetric])
def test_what_is_symmetric_comes_back(solved, label):
    assert solved(label)["back"] < BOUND


@pytest.mark.parametrize("label", [label for label, m in stiff.METHODS.items() if m.energy == ROUND_OFF])
def test_what_keeps_the_energy_keeps_it(solved, label):
    assert solved(label)["energy"] < BOUND


def test_controls(solved):
    assert solved("implicit-euler")["back"] > 0.1
    assert solved("implicit-midpoint")["energy"] > 0.01
    assert {m.family for m in stiff.METHODS.values()} == stiff.FAMILIES
