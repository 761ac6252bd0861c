"""Steps too long for fixed-point iteration: Newton's method solves the implicit equations."""

from __future__ import annotations

import pytest

from phasebench.integrators.record import ROUND_OFF
from support import stiff

#: Bound on errors; states are of size 1, energies of 50, entries of the Jacobian of 60.
BOUND = 1e-12


@pytest.fixture(scope="module")
def results_of(of_each):
    """Function: label of a method -> its results from `support.stiff.of`, runs with steps solved by Newton's method."""
    return of_each(stiff)


@pytest.mark.parametrize("label", stiff.METHODS)
def test_doubles_and_multiprecision_solve_the_same_equations(results_of, label):
    found = results_of(label)
    assert found["steps"] == 3 * [stiff.STEPS]
    assert min(found["newton"]) >= stiff.STEPS
    assert found["apart"] < BOUND


@pytest.mark.parametrize("label", [label for label, m in stiff.METHODS.items() if m.symmetric])
def test_symmetric_methods_return(results_of, label):
    assert results_of(label)["back"] < BOUND


@pytest.mark.parametrize("label", [label for label, m in stiff.METHODS.items() if m.energy == ROUND_OFF])
def test_energy_is_conserved_where_declared(results_of, label):
    assert results_of(label)["energy"] < BOUND


def test_control_other_methods_neither_return_nor_conserve_energy(results_of):
    assert results_of("implicit-euler")["back"] > 0.1
    assert results_of("implicit-midpoint")["energy"] > 0.01


def test_every_family_is_tested():
    assert {m.family for m in stiff.METHODS.values()} == stiff.FAMILIES
