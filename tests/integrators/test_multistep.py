"""Symmetric multistep methods: exact checks of their numbers, a plain implementation in 30 digits, and reversal."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.measure import oscillator
from phasebench.benchmarks.measure.integrator import integrator
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


# -- runs ------------------------------------------------------------------------------------------------------------


def test_a_start_from_the_end_returns_to_its_truncation_error_only():
    """(q, p) is not the state: a new run from the end starts with other earlier positions."""
    made = problem("henon-heiles:box")
    there = integrate(made, "quinlan-tremaine-8", h=0.1, steps=200)
    back = integrate(made, "quinlan-tremaine-8", h=-0.1, steps=200, q0=there.q[-1], p0=there.p[-1])
    assert 1e-12 < np.abs(back.q[-1] - made.q0).max() < 1e-5


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


@pytest.mark.parametrize("order", [8])
def test_runs_beside_the_limit_stay_bounded_or_grow(order):
    chosen = integrator(f"quinlan-tremaine-{order}")
    found = oscillator.find(chosen)
    assert found.how == oscillator.ROOTS
    assert found.limit == numbers.stable_intervals(TABLES[order])[0][1]
    assert not oscillator.failure_of_run(chosen, 0.999 * found.limit, 10_000)
    assert oscillator.failure_of_run(chosen, 1.001 * found.limit, 10_000)
    answer = pb.stability(f"quinlan-tremaine-{order}")
    assert answer.limit == found.limit


# -- runs --------------------------------------------------------------------------------------------------------------

KEPLER = problem("kepler")


def test_systems_of_another_kind_are_refused():
    for H in ("(q**2 + 1)*(p**2 + 1)/2", "p**4/4 + q**2/2"):
        with pytest.raises(InvalidInput, match=r"separable|quadratic kinetic"):
            integrate(Hamiltonian(q="q", p="p", H=H), "quinlan-tremaine-8", h=0.1, steps=3, q0=[0.1], p0=[0.2])
    with pytest.raises(InvalidInput, match="quinlan-tremaine-8"):
        integrate(KEPLER, "quinlan-tremaine-9", h=0.1, steps=3)


def test_a_first_step_that_cannot_be_solved_ends_the_run():
    system = Hamiltonian(q="q", p="p", H="p**2/2 + 200*q**4")
    s = integrate(system, "quinlan-tremaine-8", h=3.0, steps=30, q0=[1.0], p0=[0.0])
    assert s.status == "not-converged"
    assert "smaller h" in s.reason


# -- long times --------------------------------------------------------------------------------------------------------


def drift(chosen, orbits: int) -> tuple[float, float]:
    """(end of a line through the energy errors of e = 0.2 with 200 steps an orbit, the largest deviation from it)."""
    n = 200
    s = integrate(KEPLER, chosen, h=2 * pi / n, steps=orbits * n, save_every=n, q0=[0.8, 0.0], p0=[0.0, 1.5**0.5])
    line = np.polyfit(s.t, s.energy(), 1)
    return abs(line[0]) * s.t[-1], np.abs(s.energy() - np.polyval(line, s.t)).max()


def test_energy_has_no_drift_and_stormers_method_has():
    """Over 2,000 orbits; the control, Stormer's unsymmetric method of order 7 by the same kernel, drifts over 20."""
    slope, around = drift(record(8), 2000)
    assert slope < 2e-11
    assert around < 2e-10
    control = replace(record(8), id="stormer-7", order=7, data=tuple(numbers.stormer(7, 8)), symmetric=False)
    assert drift(control, 20)[0] > 1e-9, "over a hundredth of the time"
