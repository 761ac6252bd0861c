"""Generating functions: the published K_1, K_2, K_3, the Hamilton-Jacobi equation, Scheme II.

The formulas are (15)-(17) of Wang, Bo & Cai (talk).
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import method
from phasebench.integrators.systems.generating import LAMBDA, coefficients


def system_of(name):
    return SYSTEMS[name]()[0] if name in SYSTEMS else problem(name).system


def talk_terms(H, v, u):
    """[K_1, K_2, K_3], the first terms of the generating function of H in powers of h, by the talk's formulas."""
    Hu, Hv = sp.Matrix([H.diff(x) for x in u]), sp.Matrix([H.diff(x) for x in v])
    Huu, Hvv = sp.hessian(H, u), sp.hessian(H, v)
    Huv = sp.Matrix(len(u), len(v), lambda i, j: H.diff(u[i], v[j]))  # rows u, columns v, as in (13)
    lam = LAMBDA
    K2 = (lam - sp.Rational(1, 2)) * (Hu.T * Hv)[0]
    K3 = (lam**2 - lam + sp.Rational(1, 3)) / 2 * ((Hu.T * Hvv * Hu)[0] + (Hv.T * Huu * Hv)[0])
    K3 += (lam**2 - lam + sp.Rational(1, 6)) * (Hv.T * Huv * Hu)[0]
    return [H, K2, K3]


def at(expression, point):
    return sp.N(expression.xreplace(point), 50)


def point_of(system, seed):
    rng = np.random.default_rng(seed)
    return {
        s: sp.Rational(int(n), 100)
        for s, n in zip((*system.q, *system.p), rng.integers(30, 90, 2 * system.d), strict=True)
    }


def test_coefficients_for_a_generic_hamiltonian():
    v, u = sp.symbols("v1 v2"), sp.symbols("u1 u2")
    H = sp.Function("H")(*v, *u)
    for a, b in zip(coefficients(H, v, u, 3), talk_terms(H, v, u), strict=True):
        assert sp.expand(a - b) == 0
    K3 = coefficients(H, v, u, 3)[2]
    assert sp.expand(K3.xreplace({LAMBDA: LAMBDA + 1}) - talk_terms(H, v, u)[2]) != 0, "the control"


def residual(K, system, lam, point, t):
    """The residual of the Hamilton-Jacobi equation, |S_t - H(u - (1 - lam) S_v, v + lam S_u)|, to 50 digits.

    K: the terms of S = sum of t^i K_i(u, v); ``point``: values of the variables.
    """
    S = sum(k.xreplace({LAMBDA: lam}) * t ** (i + 1) for i, k in enumerate(K))
    rate = sum((i + 1) * k.xreplace({LAMBDA: lam}) * t**i for i, k in enumerate(K))
    moved = {x: at(x + lam * S.diff(y), point) for x, y in zip(system.q, system.p, strict=True)}
    moved |= {y: at(y - (1 - lam) * S.diff(x), point) for x, y in zip(system.q, system.p, strict=True)}
    return abs(at(rate, point) - at(system.H, moved))


@pytest.mark.parametrize("order", [1, 3, 4])
@pytest.mark.parametrize("name", ["henon-heiles", "coupled"])
def test_the_hamilton_jacobi_residual_has_its_order(name, order):
    system, lam = system_of(name), sp.Rational(1, 3)
    K = coefficients(system.H, system.q, system.p, order)
    point = point_of(system, 5)
    a, b = (residual(K, system, lam, point, sp.Rational(1, n)) for n in (1000, 2000))
    assert abs(float(sp.log(a / b, 2)) - order) < 0.05
    K[-1] = K[-1] * sp.Rational(11, 10)
    a, b = (residual(K, system, lam, point, sp.Rational(1, n)) for n in (1000, 2000))
    assert float(sp.log(a / b, 2)) < order - 0.9, "the control"


@pytest.mark.parametrize(("name", "order"), [("henon-heiles", 5), ("harmonic-oscillator", 6)])
def test_orders_five_and_six_run(name, order):
    made = problem(name)
    s = integrate(made, method("generating-function", order=order, lam=Fraction(1, 3)), h=0.05, t_end=2.0)
    assert s.status == "ok"
    assert s.counts["hessian"] > 0
    error = np.ptp(made.system.observe(made.system.H, s.q, s.p))
    lower = integrate(made, method("generating-function", order=3, lam=Fraction(1, 3)), h=0.05, t_end=2.0)
    assert error < 0.1 * np.ptp(made.system.observe(made.system.H, lower.q, lower.p))


# -- Scheme I on the harmonic oscillator, with z = h omega -------------------------------------------------------------


LAMBDAS = (-1.0, 0.0, 1 / 3, 0.5, 2.5)
OSCILLATOR = problem("harmonic-oscillator")


def step_matrix(lam, z):
    columns = []
    for q, p in ((1.0, 0.0), (0.0, 1.0)):
        s = integrate(OSCILLATOR, method("scheme-i", lam=lam), h=z, steps=1, q0=[q], p0=[p])
        columns.append([s.q[-1, 0], s.p[-1, 0]])
    return np.array(columns).T


def trace(lam, z):
    """Derived from (19) of the talk."""
    return 2 - z**2 / (1 + lam * (1 - lam) * z**2)


@pytest.mark.parametrize("z", [0.1, 1.0, 1.9])
@pytest.mark.parametrize("lam", LAMBDAS)
def test_trace_and_determinant(lam, z):
    M = step_matrix(lam, z)
    scale = 1 + np.abs(M).max() ** 2
    assert abs(np.trace(M) - trace(lam, z)) < 2e-14 * scale
    assert abs(np.linalg.det(M) - 1) < 1e-13 * scale
    if lam not in (0.0, 1.0):
        wrong = 2 - z**2 / (1 + lam * (1 + lam) * z**2)
        assert abs(np.trace(M) - wrong) > 2e-14 * scale, "the control: another sign in the denominator"
