"""Symmetric multistep methods: exact checks of their numbers, a plain implementation in 30 digits, and reversal."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.coefficients import multistep as numbers
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.registry import method

TABLES = numbers.QUINLAN_TREMAINE
ORDERS = tuple(TABLES)


def record(order: int):
    return method(f"quinlan-tremaine-{order}")


# -- the numbers, in exact fractions -----------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ORDERS)
def test_the_numbers_have_their_order_and_are_symmetric(order):
    table = TABLES[order]
    rho, sigma = table.rho, table.sigma
    assert len(rho) == len(sigma) == order + 1 == record(order).earlier + 2
    assert rho == rho[::-1]
    assert sigma == sigma[::-1]
    assert sigma[0] == 0
    assert rho[-1] == 1
    assert numbers.order(rho, sigma) == order


@pytest.mark.parametrize("order", ORDERS)
def test_control_a_number_changed_by_one_loses_the_order(order):
    alpha, beta, denominator = TABLES[order]
    for k in range(1, order):
        wrong = numbers.Multistep(alpha, (*beta[:k], beta[k] + 1, *beta[k + 1 :]), denominator)
        assert numbers.order(wrong.rho, wrong.sigma) < 2
    sign = numbers.symmetric((1, -2, 2, -1, 0), (0, 17671, -23622, 61449, 50516), 12096)  # printed so once
    assert numbers.order(sign.rho, sign.sigma) == 0


@pytest.mark.parametrize("order", ORDERS)
def test_zero_stability_all_parasitic_roots_are_simple_and_on_the_unit_circle(order):
    roots = numbers.parasitic_roots(TABLES[order].rho)
    assert len(roots) == order - 2
    assert max(abs(abs(z) - 1) for z in roots) < 1e-50
    assert min(abs(y - z) for i, y in enumerate(roots) for z in roots[:i]) > 0.05
    assert all(x.denominator == 1 for x in numbers.reduced(TABLES[order].rho))
    # rho is a product of (z - 1)^2 and of cyclotomic polynomials: parasitic roots are roots of unity
    turns = {8: (5, 6), 10: (5, 6), 12: (18,), 14: (11, 6)}[order]
    assert all(min(abs(z**n - 1) for n in turns) < 1e-40 for z in roots)


# -- stable steps ------------------------------------------------------------------------------------------------------


def spectral_radius(table, H: float) -> float:
    line = [float(a) + H**2 * float(b) for a, b in zip(table.rho, table.sigma, strict=True)]
    return float(np.abs(np.roots(line[::-1])).max())


@pytest.mark.parametrize("order", ORDERS)
def test_the_limit_is_where_a_root_leaves_the_unit_circle(order):
    ((low, high),) = numbers.stable_intervals(TABLES[order])
    assert low == 0
    for part in (0.1, 0.5, 0.9, 0.999):
        assert spectral_radius(TABLES[order], part * high) < 1 + 1e-6
    for part in (1.001, 1.1, 1.5, 3.0, 20.0):
        assert spectral_radius(TABLES[order], part * high) > 1 + 1e-3


def test_stormer_verlets_limit_follows_from_the_same_formula():
    assert numbers.stable_intervals(numbers.symmetric((1, -2), (0, 1), 1)) == [(0.0, 2.0)]
    found = numbers.stable_intervals(numbers.symmetric((1, -2), (1, 10), 12))  # Numerov's method: H^2 = 6
    assert found[0][1] == pytest.approx(6**0.5, abs=1e-15)


# -- runs --------------------------------------------------------------------------------------------------------------

KEPLER = problem("kepler")


def test_systems_of_another_kind_are_refused():
    for H in ("(q**2 + 1)*(p**2 + 1)/2", "p**4/4 + q**2/2"):
        with pytest.raises(InvalidInput, match=r"separable|quadratic kinetic"):
            integrate(Hamiltonian(q="q", p="p", H=H), "quinlan-tremaine-8", h=0.1, steps=3, q0=[0.1], p0=[0.2])
    with pytest.raises(InvalidInput, match="quinlan-tremaine-8"):
        integrate(KEPLER, "quinlan-tremaine-9", h=0.1, steps=3)
