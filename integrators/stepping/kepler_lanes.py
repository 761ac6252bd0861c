r"""Kepler's problem for several bodies at once, one in each SIMD lane: `kepler_flow` without branches.

With the derivatives :math:`F' = r, F'', F''' = \zeta G_0 - \beta\eta G_1, F^{(4)} = -\beta F'', F^{(5)} = -\beta F'''`
the equation :math:`F(s + \delta) = 0` is solved by the reversion of its Taylor series to the fifth order: at s = 0 this
gives the starting value, and after one evaluation of Stumpff's functions, or two, a solution exact to round-off.  The
last correction enters the functions by their addition theorems.  All lanes are evaluated as often as the slowest needs.

Lanes that the few evaluations do not solve (a long step, or one past a close pericentre) are left to `kepler_flow`, one
by one.

The series have `kepler_flow.constants`' coefficients, integers that are exact as doubles, and are divided by their
common factor in two parts, lest the error of a rounded coefficient make the energy drift.

Source: J. M. A. Danby, Fundamentals of Celestial Mechanics (1988), section 6.9 (corrections of high order).
"""

from __future__ import annotations

from fractions import Fraction
from math import factorial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasebench.integrators.values.fma import exact_fma
from phasebench.integrators.values.lanes import polynomial, put, take
from phasebench.integrators.values.masks import select
from phasebench.integrators.values.vector import forbid_inlining, inline, jit

from . import kepler_flow

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Condition, Number, Value

#: The highest power in the series; with it their coefficients are integers below 2^53 times powers of two.
TERMS = 9
#: Arguments of the series are at most this: the terms left out are below 2^-9 of the round-off.
REACH = 1.7
#: Arguments beyond half a period's are left to `kepler_flow`, and so is what so many evaluations do not solve.
LARGEST, EVALUATIONS = 9.8, 4
#: The error that remains in s, which has a trend, is below so much of its round-off.
SMALL = 2.0**-14
#: The rows of the memory that `motion` needs.
ROWS = 5


def _series(k: int) -> tuple[float, float, tuple[float, ...]]:
    """Coefficients of the power series in y of (2 N + k)! c_k(-y), with c_k a Stumpff function and N = `TERMS`.

    Returns (the first, the second, a tuple of the others).
    """
    first, second, *more = (float(factorial(2 * TERMS + k) // factorial(2 * n + k)) for n in range(TERMS + 1))
    return first, second, tuple(more)


def _reciprocal(n: int) -> tuple[float, float]:
    """1/n as the sum of two doubles."""
    high = 1 / n
    return high, float(Fraction(1, n) - Fraction(high))


FIRST_2, SECOND_2, MORE_2 = _series(2)
FIRST_3, SECOND_3, MORE_3 = _series(3)
OVER_2, OVER_3 = _reciprocal(factorial(2 * TERMS + 2)), _reciprocal(factorial(2 * TERMS + 3))


@inline
def root(square: Number, guess: Number) -> tuple[Number, Number]:
    """Return (square root, 1 / square root) of each lane of ``square``, by one correction of a ``guess`` of the latter.

    The residual 1 - square * guess^2 is computed by a fused multiply-add: doubles lie closer below 1 than above, so
    that a rounded product near 1 would bias the inverse.
    """
    r = square * guess
    inverse = guess + 0.5 * guess * exact_fma(-r, guess, 1.0)
    r = square * inverse
    return r + 0.5 * inverse * exact_fma(-r, r, square), inverse


@inline
def stumpff(x: Number) -> tuple[Number, Number, Number, Number]:
    """Stumpff's functions (c_0, c_1, c_2, c_3)(x) of the numbers in SIMD lanes."""
    y = -x
    quarters = 0
    while abs(y) > REACH:
        y = 0.25 * y
        quarters += 1
    # The largest terms one after the other: what is added last is not so small that it would always be rounded off.
    a = FIRST_2 + y * (SECOND_2 + y * polynomial(MORE_2, y, MORE_2))
    b = FIRST_3 + y * (SECOND_3 + y * polynomial(MORE_3, y, MORE_3))
    c2, c3 = exact_fma(a, OVER_2[0], a * OVER_2[1]), exact_fma(b, OVER_3[0], b * OVER_3[1])
    c1 = 1 + y * c3
    c0 = 1 + y * c2
    for _ in range(quarters):
        y = 4.0 * y
        c3 = 0.25 * (c2 + c0 * c3)
        c2 = 0.5 * (c1 * c1)
        c1 = 1 + y * c3
        c0 = 1 + y * c2
    return c0, c1, c2, c3


@inline
def _reversion(delta: Number, second: Number, third: Number, beta: Number) -> Number:
    """x/delta - 1 to the fifth order in delta, for the root x of -delta + x + second x^2/2 + third x^3/6 - ...

    The function is that of Kepler's equation, divided by its slope at x = 0; its fourth and fifth derivatives are
    -``beta`` times the second and third.
    """
    a = second * delta * 0.5
    square = delta * delta
    t = beta * square
    b = third * square * (1 / 6)
    far = 2 - 21 * b - 0.5 * t + a * (14 * a - 5)
    return a * (a * far + (5 * b + t * (1 / 12) - 1)) + b * (3 * b + (t * 0.05 - 1))


class Motion(NamedTuple):
    """Kepler's flow over a time, for one body in each SIMD lane.

    Attributes
    ----------
    f, g, df, dg : the coefficients f - 1, g, f', g' - 1: q becomes f q + g v, and the velocity v becomes f' q + g' v
    unsolved : mask of the lanes in which `motion_in_lanes` did not solve Kepler's equation
    inverse : 1/r at the end; not valid in lanes that are ``unsolved``
    """

    f: Any
    g: Any
    df: Any
    dg: Any
    unsolved: Any
    inverse: Any


@inline
def _begin(delta: Number, second: Number, third: Number, beta: Number) -> tuple[Number, Condition]:
    """A starting value of the universal anomaly s by its Taylor series: (s, mask of lanes where it is not trusted).

    ``delta`` is h/r0; ``second`` and ``third`` are the second and third derivative F'' and F''' of Kepler's equation
    F(s) = 0 at s = 0, divided by r0.  s is 0 in lanes where it is not trusted.
    """
    beyond = _reversion(delta, second, third, beta)
    s = delta + delta * beyond
    far = ~((abs(beyond) <= 0.5) & (abs(beta * s * s) <= LARGEST))
    if far:
        s = select(far, 0 * delta, s)
    return s, far


@inline
def motion_in_lanes(
    r0: Number, inverse: Number, eta: Number, beta: Number, mu: Number, h: Number, eps: Number
) -> Motion:
    """Solve Kepler's problem over the time h in lanes; returns the `Motion`.

    r0 = |q|, ``inverse`` = 1/r0, eta = q.v and beta = 2 mu/r0 - |v|^2; ``eps`` is the machine epsilon.  Where mu = 0
    the motion is free, and r0, its inverse, eta and beta have to be 1, 1, 0, 0.
    """
    zeta = mu - beta * r0
    s, far = _begin(h * inverse, eta * inverse, zeta * inverse, beta)
    unsolved = far
    for _ in range(EVALUATIONS):
        square = s * s
        c0, c1, c2, c3 = stumpff(beta * square)
        G1, G2, G3 = s * c1, square * c2, square * (s * c3)
        over_r = 1.0 / (r0 + eta * G1 + zeta * G2)
        delta = (h - (r0 * G1 + eta * G2 + mu * G3)) * over_r
        second, third = (eta * c0 + zeta * G1) * over_r, (zeta * c0 - beta * eta * G1) * over_r
        ds = delta + delta * _reversion(delta, second, third, beta)
        # Of a correction ds, errors of ds k^(5/2) remain in s and in the functions.
        k = (second * second + abs(beta) + mu * over_r) * (ds * ds)
        unsolved = far | ~(k * k * (k * k) * k * (ds * ds) <= (eps * SMALL) * (eps * SMALL) * square)
        if not (unsolved & ~far):
            break
        s = s + ds
    y = -beta * (ds * ds)
    g2, g3 = 0.5 + y * (1 / 24), 1 / 6 + y * (1 / 120)
    g0, g1, g2, g3 = y * g2, ds + ds * (y * g3), (ds * ds) * g2, (ds * ds) * (ds * g3)
    G3 = G3 + (G2 * ds + G1 * g2 + c0 * g3)
    G2 = G2 + (G1 * g1 + c0 * g2)
    G1 = G1 + (G1 * g0 + c0 * g1)
    over_r = 1.0 / (r0 + eta * G1 + zeta * G2)
    falling = mu * over_r
    return Motion(-mu * G2 * inverse, h - mu * G3, -G1 * inverse * falling, -G2 * falling, unsolved, over_r)


@jit
def _solve_one_by_one(memory: np.ndarray, row: int, width: int, eps: Number, table: np.ndarray) -> None:
    """Solve Kepler's problem lane by lane, by `kepler_flow.coefficients`; lanes whose h is NaN are left out.

    The five rows of ``memory`` from ``row`` on hold (r0, eta, beta, mu, h), each for ``width`` lanes; the first four
    become the coefficients (f - 1, g, f', g' - 1).
    """
    forbid_inlining()
    for k in range(width):
        r0, eta, beta = memory[row, k], memory[row + 1, k], memory[row + 2, k]
        mu, h = memory[row + 3, k], memory[row + 4, k]
        if h == h:
            f, g, df, dg, _ = kepler_flow.coefficients(r0, eta, beta, mu, h, eps, table)
            memory[row, k], memory[row + 1, k], memory[row + 2, k], memory[row + 3, k] = f, g, df, dg


@inline
def motion(
    r0: Number,
    inverse: Number,
    eta: Number,
    beta: Number,
    mu: Number,
    h: Number,
    eps: Number,
    table: np.ndarray,
    memory: np.ndarray,
    row: int,
    like: Value,
) -> Motion:
    """The `Motion` over the time h; lanes that `motion_in_lanes` leaves unsolved are solved by `kepler_flow`.

    r0 = |q|, ``inverse`` = 1/r0, eta = q.v and beta = 2 mu/r0 - |v|^2; ``table`` is the array `kepler_flow.constants`.
    Overwrites `ROWS` rows of the array ``memory`` from ``row`` on; ``like`` is a tuple as long as there are lanes.
    """
    m = motion_in_lanes(r0, inverse, eta, beta, mu, h, eps)
    if not m.unsolved:
        return m
    put(memory, row, r0, like)
    put(memory, row + 1, eta, like)
    put(memory, row + 2, beta, like)
    put(memory, row + 3, mu, like)
    put(memory, row + 4, select(m.unsolved, 0 * r0 + h, 0 * r0 + np.nan), like)
    _solve_one_by_one(memory, row, len(like), eps, table)
    f = select(m.unsolved, take(memory, row, like), m.f)
    g = select(m.unsolved, take(memory, row + 1, like), m.g)
    df = select(m.unsolved, take(memory, row + 2, like), m.df)
    dg = select(m.unsolved, take(memory, row + 3, like), m.dg)
    return Motion(f, g, df, dg, m.unsolved, m.inverse)
