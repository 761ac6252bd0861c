r"""Sine, cosine, exponential and square root of lanes: the first three by polynomials after a reduction, no branch.

.. math::
    \sin x = (-1)^n \sin r,\quad r = x - n\pi;\qquad \cos x = (-1)^n \sin r,\quad r = x - (n - \tfrac12)\pi;\qquad
    e^x = 2^n e^r,\quad r = x - n \log 2,

with the n that make :math:`|r| \le \pi/2`, or :math:`\tfrac12 \log 2`.  Pi and log 2 are subtracted in parts of which
the first have so few bits that their products with n are exact (Cody & Waite 1980).  The polynomials interpolate at
Chebyshev's points, :math:`(\sin r / r - 1)/r^2` by degree 7 in :math:`r^2`, and :math:`(e^r - 1 - r)/r^2` by degree 9
in r; their relative errors are 4e-17 and 2e-17.

Errors, which a test measures against 40 digits: sine and cosine below 2.5 units in the last place where :math:`|x| \le
10^6`; from there to 1e12 by a unit of the argument's last place more, as if x had been rounded again; beyond, NaN.  The
exponential: below 1.5 units; it overflows to infinity and underflows to zero as it should.  The square root is the
processor's.

Lanes have no others: numbers, and whatever is not compiled, get the functions of the mathematics library.

Source: W. J. Cody, W. Waite, Software Manual for the Elementary Functions (1980), chapters 6 and 8.
"""

from __future__ import annotations

import math

import gmpy2
import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic, overload

from .lanes import NUMBER, OPTIONS, Lanes, call, polynomial, spread

PI = (3.1415926534682512, 1.215420100718692e-10, 5.825464112186712e-20)
LOG_2 = (0.6931471803691238, 1.9082149292705877e-10)
SINE = (
    -0.16666666666666666,
    0.008333333333333316,
    -0.00019841269841254955,
    2.755731921915843e-06,
    -2.5052107616384624e-08,
    1.6058977272817488e-10,
    -7.64396903111606e-13,
    2.7314289869116175e-15,
)
EXPONENTIAL = (
    0.5000000000000001,
    0.16666666666666669,
    0.041666666666624094,
    0.00833333333333006,
    0.0013888888917230724,
    0.00019841269863066696,
    2.4801521269532122e-05,
    2.7557268439678e-06,
    2.7620101012098e-07,
    2.5100395159429243e-08,
)
#: Added and taken away again, it rounds to an integer; its last bits are then the integer's.
ROUND = 1.5 * 2.0**52
LARGEST = 1e12
OVERFLOW, UNDERFLOW = 710.0, -746.0


def _vector(builder, number: float, n: int):
    return ir.Constant(ir.VectorType(NUMBER, n), [ir.Constant(NUMBER, number)] * n)


@intrinsic
def _bounded(typing_context, x, low, high, beyond):
    """x within the bounds; else the bound, or NaN where ``beyond`` is an integer."""

    def codegen(context, builder, sig, args):
        bounds = [spread(context, builder, a, t, x.n) for a, t in zip(args[1:3], sig.args[1:3], strict=True)]
        found = args[0]
        for comparison, bound in zip("<>", bounds, strict=True):
            outside = builder.fcmp_ordered(comparison, args[0], bound)
            other = _vector(builder, math.nan, x.n) if isinstance(beyond, types.Integer) else bound
            found = builder.select(outside, other, found)
        return found

    return x(x, low, high, beyond), codegen


@intrinsic
def _two_to(typing_context, n):
    """2^n of integers in lanes, from -1022 to 1023."""

    def codegen(context, builder, sig, args):
        integers = ir.VectorType(ir.IntType(64), n.n)

        def all_of(i):
            return ir.Constant(integers, [ir.Constant(ir.IntType(64), i)] * n.n)

        bits = builder.bitcast(builder.fadd(args[0], _vector(builder, ROUND, n.n)), integers)
        exponent = builder.add(builder.shl(bits, all_of(52)), all_of(1023 << 52))
        return builder.bitcast(exponent, ir.VectorType(NUMBER, n.n))

    return n(n), codegen


@intrinsic
def _root(typing_context, x):
    return x(x), lambda context, builder, sig, args: call(builder, "sqrt", x.n, args[0])


@njit(**OPTIONS)
def _nearest(x):
    return (x + ROUND) - ROUND


@njit(**OPTIONS)
def _sine_of_part(x, n, sign):
    """The sign times sin(x - n pi), where x - n pi is at most pi/2."""
    r = ((x - n * PI[0]) - n * PI[1]) - n * PI[2]
    z = r * r
    s = sign * r
    return s + s * (z * polynomial(SINE, z, SINE))


@njit(**OPTIONS)
def _sign(n):
    """(-1)^n."""
    odd = n - 2.0 * _nearest(0.5 * n)
    return 1.0 - 2.0 * (odd * odd)


@njit(**OPTIONS)
def _sin(x):
    x = _bounded(x, -LARGEST, LARGEST, 0)
    n = _nearest(x * (1 / math.pi))
    return _sine_of_part(x, n, _sign(n))


@njit(**OPTIONS)
def _cos(x):
    x = _bounded(x, -LARGEST, LARGEST, 0)
    n = _nearest(x * (1 / math.pi) + 0.5)
    return _sine_of_part(x, n - 0.5, _sign(n))


@njit(**OPTIONS)
def _exp(x):
    x = _bounded(x, UNDERFLOW, OVERFLOW, 0.0)
    n = _nearest(x * (1 / math.log(2)))
    r = (x - n * LOG_2[0]) - n * LOG_2[1]
    half = _nearest(0.5 * n)
    return (1.0 + (r + (r * r) * polynomial(EXPONENTIAL, r, EXPONENTIAL))) * _two_to(half) * _two_to(n - half)


def _function(name: str, of_lanes):
    """The function of that name: of lanes, of numbers, and uncompiled of numbers of either kind or arrays of them."""
    of_number = getattr(math, name)

    def plain(x):
        if isinstance(x, np.ndarray):
            return np.array([plain(a) for a in x], x.dtype)
        return getattr(gmpy2, name)(x) if isinstance(x, type(gmpy2.mpfr(0))) else of_number(x)

    def choose(x):
        if isinstance(x, Lanes):
            return lambda x: of_lanes(x)
        return (lambda x: of_number(x)) if isinstance(x, types.Number) else None

    plain.__name__ = name
    overload(plain, jit_options=OPTIONS)(choose)
    return plain


sin, cos, exp, sqrt = (_function(*pair) for pair in (("sin", _sin), ("cos", _cos), ("exp", _exp), ("sqrt", _root)))
