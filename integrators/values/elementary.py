r"""Sine, cosine, exponential, hyperbolic functions and square root of SIMD lanes, without branches.

.. math::
    \sin x = (-1)^n \sin r,\quad r = x - n\pi;\qquad \cos x = (-1)^n \sin r,\quad r = x - (n - \tfrac12)\pi;\qquad
    e^x = 2^n e^r,\quad r = x - n \log 2,

where the integer n is chosen such that :math:`|r| \le \pi/2`, for the exponential :math:`|r| \le \tfrac12 \log 2`.
Pi and log 2 are sums of numbers that are subtracted in turn; the first have so few bits that their products with n are
exact (Cody & Waite 1980).  The polynomials interpolate at Chebyshev points: :math:`(\sin r / r - 1)/r^2` with degree 7
in :math:`r^2`, and :math:`(e^r - 1 - r)/r^2` with degree 9 in r; their relative errors are 4e-17 and 2e-17.  The
hyperbolic functions are computed from the exponential, but near 0 sinh (:math:`|x| < 1`) and tanh (:math:`|x| < 0.625`)
from polynomials of the same kind in :math:`x^2`, of degree 6 and 11.

Errors, which a test measures against 40 digits.  Sine and cosine: below 2.5 units in the last place for :math:`|x| \le
10^6`; up to 1e12 the effect of a change of x by one unit in its last place is added; beyond, the result is NaN.
Exponential: below 1.5 units; it overflows to infinity and underflows to zero where the exact value does.  Hyperbolic
sine, cosine and tangent: below 3 units; sinh and cosh overflow where the exponential does, at an x that is smaller by
0.7 than where their exact values would.  The square root is the processor's.

Only lanes use these formulae: scalars, and all uncompiled code, call the mathematics library.

Source: W. J. Cody, W. Waite, Software Manual for the Elementary Functions (1980), chapters 6 and 8.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import gmpy2
import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic, overload

from .lanes import NUMBER, OPTIONS, Lanes, broadcast, call, polynomial

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Function, Number

#: Pi and log 2 as sums of parts; then the coefficients of the polynomials, lowest power first.
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
HYPERBOLIC_SINE = (
    0.16666666666666666,
    0.008333333333333299,
    0.00019841269841324198,
    2.7557319191381816e-06,
    2.5052117695907823e-08,
    1.6057679623801638e-10,
    7.746178593018827e-13,
)
HYPERBOLIC_TANGENT = (
    -0.3333333333333333,
    0.13333333333333042,
    -0.05396825396789699,
    0.021869488519008305,
    -0.008863235103240878,
    0.0035921217511549622,
    -0.0014557754120478055,
    0.0005896606577757043,
    -0.0002375906496055562,
    9.257116129556769e-05,
    -3.12011014257974e-05,
    6.485163482793113e-06,
)
#: Size of the argument below which sinh and tanh use the polynomials.
NEAR_SINE, NEAR_TANGENT = 1.0, 0.625
#: Adding and subtracting it rounds to the nearest integer; the last bits of the sum are those of the integer.
ROUND = 1.5 * 2.0**52
#: Largest argument of sine and cosine.
LARGEST = 1e12
#: Arguments beyond which the exponential is infinite, or zero.
OVERFLOW, UNDERFLOW = 710.0, -746.0


def _vector(builder: Any, number: float, n: int) -> Any:
    """Return the LLVM constant with ``number`` in each of n lanes."""
    return ir.Constant(ir.VectorType(NUMBER, n), [ir.Constant(NUMBER, number)] * n)


@intrinsic
def _clip(typing_context: Any, x: types.Type, low: types.Type, high: types.Type, beyond: types.Type) -> tuple:
    """Clip the lanes of x to [low, high]; or, if ``beyond`` is an integer, replace lanes outside by NaN.

    Only the type of ``beyond`` counts, not its value: 0 asks for NaN, 0.0 for clipping.
    """

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bounds = [broadcast(context, builder, a, t, x.n) for a, t in zip(args[1:3], sig.args[1:3], strict=True)]
        clipped = args[0]
        for comparison, bound in zip("<>", bounds, strict=True):
            outside = builder.fcmp_ordered(comparison, args[0], bound)
            replacement = _vector(builder, math.nan, x.n) if isinstance(beyond, types.Integer) else bound
            clipped = builder.select(outside, replacement, clipped)
        return clipped

    return x(x, low, high, beyond), codegen


@intrinsic
def _power_of_two(typing_context: Any, n: types.Type) -> tuple:
    """2**n for integers n in lanes, from -1022 to 1023."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        integers = ir.VectorType(ir.IntType(64), n.n)

        def all_of(i: int) -> Any:
            return ir.Constant(integers, [ir.Constant(ir.IntType(64), i)] * n.n)

        bits = builder.bitcast(builder.fadd(args[0], _vector(builder, ROUND, n.n)), integers)
        exponent = builder.add(builder.shl(bits, all_of(52)), all_of(1023 << 52))
        return builder.bitcast(exponent, ir.VectorType(NUMBER, n.n))

    return n(n), codegen


@intrinsic
def _select_below(typing_context: Any, x: types.Type, bound: types.Type, near: types.Type, far: types.Type) -> tuple:
    """Choose ``near`` in the lanes where x < bound, ``far`` in the others."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        less = builder.fcmp_ordered("<", args[0], broadcast(context, builder, args[1], sig.args[1], x.n))
        return builder.select(less, args[2], args[3])

    return x(x, bound, near, far), codegen


@intrinsic
def _sqrt(typing_context: Any, x: types.Type) -> tuple:
    """The square root of each lane of x, by the processor's instruction."""
    return x(x), lambda context, builder, sig, args: call(builder, "sqrt", x.n, args[0])


@njit(**OPTIONS)
def _round(x: Number) -> Number:
    """x rounded to the nearest integer."""
    return (x + ROUND) - ROUND


@njit(**OPTIONS)
def _reduced_sine(x: Number, n: Number, sign: Number) -> Number:
    """The value sign * sin(x - n pi) in each lane, for |x - n pi| <= pi/2, by a polynomial."""
    r = ((x - n * PI[0]) - n * PI[1]) - n * PI[2]
    z = r * r
    s = sign * r
    return s + s * (z * polynomial(SINE, z, SINE))


@njit(**OPTIONS)
def _sign(n: Number) -> Number:
    """(-1)**n for integers n."""
    odd = n - 2.0 * _round(0.5 * n)
    return 1.0 - 2.0 * (odd * odd)


@njit(**OPTIONS)
def _sin(x: Number) -> Number:
    x = _clip(x, -LARGEST, LARGEST, 0)
    n = _round(x * (1 / math.pi))
    return _reduced_sine(x, n, _sign(n))


@njit(**OPTIONS)
def _cos(x: Number) -> Number:
    x = _clip(x, -LARGEST, LARGEST, 0)
    n = _round(x * (1 / math.pi) + 0.5)
    return _reduced_sine(x, n - 0.5, _sign(n))


@njit(**OPTIONS)
def _exp(x: Number) -> Number:
    x = _clip(x, UNDERFLOW, OVERFLOW, 0.0)
    n = _round(x * (1 / math.log(2)))
    r = (x - n * LOG_2[0]) - n * LOG_2[1]
    half = _round(0.5 * n)
    return (
        (1.0 + (r + (r * r) * polynomial(EXPONENTIAL, r, EXPONENTIAL))) * _power_of_two(half) * _power_of_two(n - half)
    )


@njit(**OPTIONS)
def _cosh(x: Number) -> Number:
    e = _exp(x)
    return 0.5 * (e + 1.0 / e)


@njit(**OPTIONS)
def _sinh(x: Number) -> Number:
    e, z = _exp(x), x * x
    near = x + x * (z * polynomial(HYPERBOLIC_SINE, z, HYPERBOLIC_SINE))
    return _select_below(z, NEAR_SINE * NEAR_SINE, near, 0.5 * (e - 1.0 / e))


@njit(**OPTIONS)
def _tanh(x: Number) -> Number:
    z = x * x
    near = x + x * (z * polynomial(HYPERBOLIC_TANGENT, z, HYPERBOLIC_TANGENT))
    return _select_below(z, NEAR_TANGENT * NEAR_TANGENT, near, 1.0 - 2.0 / (_exp(2.0 * x) + 1.0))


def _overload(name: str, of_lanes: Function) -> Function:
    """Make the function ``name`` of the module math for numbers, MPFR numbers, arrays and, compiled, for SIMD lanes.

    ``of_lanes`` is the compiled function for lanes.
    """
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


sin, cos, exp, sqrt, sinh, cosh, tanh = (
    _overload(*pair)
    for pair in (
        ("sin", _sin),
        ("cos", _cos),
        ("exp", _exp),
        ("sqrt", _sqrt),
        ("sinh", _sinh),
        ("cosh", _cosh),
        ("tanh", _tanh),
    )
)
