"""Expressions in shared form: derivatives, linear systems and products are those of the plain expressions."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from phasebench.integrators.systems import shared

SYMBOLS = sp.symbols("x y z u", real=True)
POINT = (0.7, -1.3, 0.4, 1.9)


def value(definitions, expression):
    known = dict(zip(SYMBOLS, POINT, strict=True))
    for symbol, e in definitions:
        known[symbol] = sp.N(e.xreplace(known), 30)
    return float(sp.N(sp.sympify(expression).xreplace(known), 30))


def formula(rng, depth=3):
    """A random formula that is smooth at `POINT`: sums, products, roots and powers of positive sums, sines."""
    if depth == 0:
        return rng.choice(SYMBOLS) * sp.Rational(int(rng.integers(1, 5)), int(rng.integers(1, 3)))
    a, b = formula(rng, depth - 1), formula(rng, depth - 1)
    positive = a**2 + b**2 + 1
    power = sp.Rational(int(rng.choice([-7, -4, -3, -2, -1, 1])), int(rng.choice([1, 2])))
    return [a + b, a - b, a * b, a * positive**power, sp.sin(a - b), (a - b) / positive + b / positive**3][
        rng.integers(6)
    ]


@pytest.mark.parametrize("seed", range(6))
def test_derivatives_of_random_formulae(seed):
    e = formula(np.random.default_rng(seed))
    for derive in (shared.gradient, shared.lighter_gradient):
        definitions, found = derive(e, SYMBOLS)
        for x, slope in zip(SYMBOLS, found, strict=True):
            right = value((), sp.diff(e, x))
            assert value(definitions, slope) == pytest.approx(right, rel=1e-12, abs=1e-12)
    steps = shared.Steps()
    found = steps.rate(e, {SYMBOLS[0]: SYMBOLS[3], SYMBOLS[1]: sp.Integer(2)})
    right = value((), sp.diff(e, SYMBOLS[0]) * SYMBOLS[3] + 2 * sp.diff(e, SYMBOLS[1]))
    assert value(steps.definitions, found) == pytest.approx(right, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("symmetric", [True, False])
def test_solution_of_linear_equations(symmetric):
    rng = np.random.default_rng(1)
    A = rng.normal(size=(4, 4)) + 4 * np.eye(4)
    A[0, 3] = A[3, 0] = 0
    A, b = (A + A.T if symmetric else A), rng.normal(size=4)
    steps = shared.Steps()
    entries = [[sp.Float(A[i, j], 30) * (SYMBOLS[0] if A[i, j] else 0) for j in range(4)] for i in range(4)]
    found = steps.solve(sp.Matrix(entries), [sp.Float(x, 30) * SYMBOLS[1] for x in b])
    right = np.linalg.solve(POINT[0] * A, POINT[1] * b)
    assert np.allclose([value(steps.definitions, x) for x in found], right, rtol=1e-12)
    half = len(steps.definitions)
    other = shared.Steps()
    entries[1][2] *= 2
    other.solve(sp.Matrix(entries), [sp.Float(x, 30) * SYMBOLS[1] for x in b])
    assert (half < len(other.definitions)) == symmetric, "half of a symmetric matrix is eliminated"


def test_products_are_shared_across_sums_and_powers():
    x, y, z, _ = SYMBOLS
    steps = shared.Steps()
    found = steps.share_products([x**2 * y**2 + 1, z / (x**2 * y**2), x * y**2])
    ((name, e),) = steps.definitions
    assert e == x * y
    assert found == [name**2 + 1, z / name**2, name * y]


@pytest.mark.parametrize("name", ["a", "z"])
def test_shared_products_are_finite_where_the_expressions_are(name):
    """Whatever names sort first, x/r is shared by x/r and x^2/r^2, and not r/x, which is infinite at x = 0."""
    x, r = sp.Symbol(name, real=True), sp.Symbol("r", real=True)
    definitions, found = shared.gradient(x**2 / (1 + r) ** 2 + x * r / (1 + r), [x, r])
    for zero in (x, r):
        known = {x: sp.Rational(1, 3), r: sp.Rational(1, 5)} | {zero: sp.Integer(0)}
        for symbol, e in definitions:
            known[symbol] = e.xreplace(known)
            assert known[symbol].is_finite
        assert all(e.xreplace(known).is_finite for e in found)
