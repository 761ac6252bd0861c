"""Multiprecision numbers: conversions are exact, generated functions keep all digits, precision is set in one place."""

from __future__ import annotations

import math
from fractions import Fraction

import mpmath
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from phasebench.integrators.compile import codegen, printing
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, precision, to_number
from phasebench.integrators.errors import InvalidInput

DIGITS = 40


def many(x) -> Fraction:
    """A multiprecision number as a fraction."""
    return Fraction(*map(int, x.as_integer_ratio()))


@given(st.fractions(), st.integers(-200, 200))
def test_fractions_are_rounded_as_by_mpmath(x, shift):
    x *= Fraction(2) ** shift
    with precision(DIGITS):
        other = mpmath.mpf(x.numerator) / x.denominator
        assert many(to_number(x, MULTIPRECISION)) == Fraction(*map(int, mpmath.libmp.to_rational(other._mpf_)))
        assert to_number(other, MULTIPRECISION) == to_number(x, MULTIPRECISION)


def test_text_and_constants_have_all_digits():
    with precision(DIGITS):
        assert abs(to_number("0.1", MULTIPRECISION) - to_number(Fraction(1, 10), MULTIPRECISION)) < 1e-40
        assert to_number(0.1, MULTIPRECISION) != to_number("0.1", MULTIPRECISION), "the control: the double is another"
        assert mpmath.mpf(str(to_number(mpmath.mp.pi, MULTIPRECISION))) == +mpmath.mp.pi


def test_precision_set_in_mpmath_only_is_refused():
    with mpmath.workdps(DIGITS), pytest.raises(InvalidInput, match="precision"):
        codegen.vector([1])
    with precision(DIGITS):
        assert codegen.vector([1]) == [1]


x, y = sp.symbols("x y", positive=True)
EXPRESSIONS = [
    sp.sqrt(x + y) * sp.pi,
    (x + 2 * y) ** sp.Rational(-3, 2),
    (x + y) ** sp.Rational(1, 3) + x**15,
    (x + y) ** sp.Rational(-1, 3) - x**-3 * y**2,
    (x + y) ** (x * y),
    sp.sin(x) * sp.cos(y) + sp.tan(x) - sp.exp(-y) + sp.log(x + y),
    sp.sinh(x) * sp.cosh(y) / sp.tanh(x) + sp.E,
    sp.asin(x / 2) + sp.acos(y / 3) - sp.atan(x * y) + abs(x - y),
    x / 3 - sp.Rational(2, 7) * y + sp.Rational(0.1),
]


#: Import of functions for lanes in place of the library's; their arguments select the arithmetic.
OF_LANES = "from phasebench.integrators.values.elementary import cos, cosh, exp, sin, sinh, sqrt, tanh\n"


@pytest.mark.parametrize("header", ["", OF_LANES], ids=["alone", "in-lanes"])
@pytest.mark.parametrize("expression", [*EXPRESSIONS, sp.sqrt(2) * x + sp.exp(3) * sp.sin(2) / y], ids=str)
def test_generated_functions_keep_all_digits(expression, header):
    def build(arithmetic):
        return header + printing.source("f", [("q", [x]), ("p", [y])], [expression], arithmetic)

    f = codegen.function(header + str(expression), build, None, MULTIPRECISION)
    with precision(DIGITS):
        value = f(codegen.vector([Fraction(2, 3)]), codegen.vector([Fraction(5, 7)]))
        expected = sp.N(expression.subs({x: sp.Rational(2, 3), y: sp.Rational(5, 7)}), DIGITS + 10)
        error = abs(value - to_number(mpmath.mpf(str(expected)), MULTIPRECISION))
    assert error < 1e-37
    assert abs(float(value) - value) > 1e-20, "the control: a double has not these digits"


def test_unknown_and_doubled_symbols_are_reported():
    for arguments, words in (([], r"neither coordinates nor momenta.*z"), ([("t", x)], "have the same symbol")):
        with pytest.raises(ValueError, match=words):
            printing.source("f", [("q", [x]), *arguments], [[x * sp.Symbol("z")]], DOUBLE)


@pytest.mark.parametrize("n", [2, 7, 37, 48, 49, -1, -2, -13, -49])
def test_integer_powers_up_to_a_bound_are_products(n):
    """Products round in the same way everywhere; higher powers use the library."""
    text = printing.source("f", [("q", [x])], [x**n], DOUBLE)
    assert ("**" in text) == (abs(n) > codegen.MAX_POWER)
    namespace = {"number": float}
    exec(text, namespace)
    assert namespace["f"]((2.0,)) == 2.0**n


def test_numbers_in_formulas_are_rounded_once():
    numbers = [sp.Rational(0.1), sp.Rational(1, 3), sp.pi, sp.Integer(2) ** 70, sp.Rational(3**50, 7**40)]
    text = printing.source("f", [("q", [x])], [[n * x for n in numbers]], DOUBLE)
    assert str(2**70) not in text, "integers beyond Numba's are doubles"
    namespace = {"value": tuple, "number": float}
    exec(text, namespace)
    wanted = [0.1, 1 / 3, math.pi, 2.0**70, 3**50 / 7**40]
    assert list(namespace["f"]((2.0,))) == [2 * n for n in wanted]
