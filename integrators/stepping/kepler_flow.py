r"""Kepler's problem in universal variables: the increments of position and velocity over any time.

With :math:`r_0 = |q|`, :math:`\eta = q\cdot v`, :math:`\beta = 2\mu/r_0 - |v|^2`, :math:`\zeta = \mu - \beta r_0` and
Stumpff's functions in :math:`G_k(s) = s^k c_k(\beta s^2)`, the universal anomaly s solves

.. math:: F(s) = r_0 G_1 + \eta G_2 + \mu G_3 - h = 0,\qquad F' = r = r_0 + \eta G_1 + \zeta G_2,\quad
          F'' = \eta G_0 + \zeta G_1,

whatever the sign of :math:`\beta` (ellipse, parabola, hyperbola), and :math:`\Delta q = (f - 1) q + g v`,
:math:`\Delta v = \dot f q + (\dot g - 1) v` with

.. math:: f - 1 = -\frac{\mu G_2}{r_0},\quad g = h - \mu G_3,\quad \dot f = -\frac{\mu G_1}{r_0 r},\quad
          \dot g - 1 = -\frac{\mu G_2}{r},

formed without cancellation, so that rounding errors of many steps have no trend.  F is increasing: its root is found by
Laguerre's method inside a bracket, and the last correction enters the functions by their Taylor series.

A table (`constants`) holds pi and the coefficients of the series; only + - * / % and square roots are used.

Sources: K. Stumpff, Himmelsmechanik I (1959); B. A. Conway, Celest. Mech. 39 (1986) 199-211 (Laguerre's method);
S. Mikkola, K. Innanen, Celest. Mech. Dyn. Astron. 74 (1999) 59-67 (quartered arguments); H. Rein, D. Tamayo, Mon. Not.
R. Astron. Soc. 452 (2015) 376-388 (increments, Brouwer's law); J. Wisdom, D. M. Hernandez, ibid. 453 (2015) 3015-3023.
"""

from __future__ import annotations

from math import factorial
from typing import TYPE_CHECKING

import mpmath

from phasebench.integrators.coefficients.fractions import DIGITS
from phasebench.integrators.compile.codegen import MULTIPRECISION
from phasebench.integrators.values.vector import inline, jit

if TYPE_CHECKING:
    import numpy as np

    from phasebench.integrators.values.kinds import Number

#: The rows of `constants`.
NUMBERS, SERIES_2, SERIES_3 = 0, 1, 2
#: Largest argument of the series.
REACH = 0.5
ITERATIONS = 300


def constants(arithmetic: str) -> list[list]:
    """Rows of constants for Stumpff's functions: (pi, N), then the coefficients of 2 c_2 and of 6 c_3.

    N is the highest power in the series, whose coefficients have the lowest power first.  They are multiplied by
    (2 N + 2)!/2 and (2 N + 3)!/6, which makes them integers that a double holds exactly: rounded coefficients would
    have a bias, and the energy would drift.
    """
    eps = mpmath.mp.eps if arithmetic == MULTIPRECISION else mpmath.mpf(2) ** -52
    terms = 1
    while 2 * mpmath.mpf(REACH) ** terms > eps / 16 * factorial(2 * terms + 2):
        terms += 1
    series = [[factorial(2 * terms + k) // factorial(2 * n + k) for n in range(terms + 1)] for k in (2, 3)]
    with mpmath.workdps(max(mpmath.mp.dps, DIGITS)):
        return [[+mpmath.pi, terms], *series]


@inline
def add(x: Number, c: Number, dx: Number) -> tuple[Number, Number]:
    """Add dx to x by compensated summation, where c is what earlier roundings of x lost: (new x, new c)."""
    t = (x + c) + dx
    return t, (dx + c) - (t - x)


@jit
def stumpff(x: Number, table: np.ndarray) -> tuple[Number, Number, Number, Number]:
    """Stumpff's functions (c_0, c_1, c_2, c_3)(x): by their series if |x| is small, else from a quarter of x.

    ``table`` is an array of the `constants`.
    """
    y = -x
    quarters = 0
    while abs(y) > REACH and abs(y) < 1e300:
        y = y / 4
        quarters += 1
    a = b = y * 0
    for n in range(int(table[NUMBERS, 1]), -1, -1):
        a = table[SERIES_2, n] + y * a
        b = table[SERIES_3, n] + y * b
    c2 = a / (2 * table[SERIES_2, 0])
    c3 = b / (6 * table[SERIES_3, 0])
    c1 = 1 + y * c3
    c0 = 1 + y * c2
    for _ in range(quarters):
        y = y * 4
        c3 = (c2 + c0 * c3) / 4
        c2 = c1 * c1 / 2
        c1 = 1 + y * c3
        c0 = 1 + y * c2
    return c0, c1, c2, c3


@jit
def _guess(r0: Number, eta: Number, beta: Number, zeta: Number, mu: Number, h: Number) -> Number:
    """Starting value of the universal anomaly s after the time h: Taylor series, or mean motion for a long step.

    r0 = |q|, eta = q.v, beta = 2 mu/r0 - |v|^2, zeta = mu - beta r0.
    """
    s = h / r0
    w = eta * s / r0
    z = zeta * s * s / r0
    if abs(w) < 0.5 and abs(z) < 1.5:
        return s * (1 - w / 2 + w * w / 2 - z / 6)
    if beta > 0:
        return beta * h / mu
    return s


@jit
def anomaly(
    r0: Number, eta: Number, beta: Number, mu: Number, h: Number, eps: Number, table: np.ndarray
) -> tuple[Number, Number, Number, Number, int]:
    """Solve Kepler's equation for the universal anomaly s, for 0 < h at most a period: (G_1, G_2, G_3, r, evaluations).

    G_k(s) are Stumpff's functions times s^k, r is the distance at the end, and ``evaluations`` counts evaluations of
    Stumpff's functions.  r0 = |q|, eta = q.v, beta = 2 mu/r0 - |v|^2; ``eps`` is the machine epsilon, ``table`` an
    array of the `constants`.
    """
    zeta = mu - beta * r0
    s = _guess(r0, eta, beta, zeta, mu, h)
    low = high = h * 0
    evaluations = 0
    for _ in range(ITERATIONS):
        evaluations += 1
        c0, c1, c2, c3 = stumpff(beta * s * s, table)
        G1, G2, G3 = s * c1, s * s * c2, s * s * s * c3
        F = r0 * G1 + eta * G2 + mu * G3 - h
        r = r0 + eta * G1 + zeta * G2
        slope = eta * c0 + zeta * G1
        ds = -5 * F / (r + abs(16 * r * r - 20 * F * slope) ** 0.5)
        # Of a correction ds, errors of ds^3 times this remain in s and in the functions.
        bend = slope * slope / (r * r) + abs(beta) + mu / r
        if abs(ds * ds * ds) * bend <= eps * s / 64:
            break
        if F <= 0:
            low = s
        else:  # also where the functions overflow
            high = s
        new = s + ds
        if high == 0 and beta * new * new > 40:  # beyond a period, (2 pi)^2
            high = 2 * table[NUMBERS, 0] / beta**0.5
            new = (low + high) / 2
        elif not (low < new and h >= F) or (high > 0 and not new < high):
            new = (low + high) / 2 if high > 0 else 2 * s
        s = new
    G3 = G3 + ds * (G2 + ds / 2 * (G1 + ds / 3 * c0))
    G2 = G2 + ds * (G1 + ds / 2 * c0)
    G1 = G1 + ds * (c0 - ds / 2 * beta * G1)
    return G1, G2, G3, r0 + eta * G1 + zeta * G2, evaluations


@jit
def coefficients(
    r0: Number, eta: Number, beta: Number, mu: Number, h: Number, eps: Number, table: np.ndarray
) -> tuple[Number, Number, Number, Number, int]:
    """The coefficients of Kepler's flow over the time h, of either sign: (f - 1, g, f', g' - 1, number of evaluations).

    The position becomes f q + g v, the velocity f' q + g' v; r0 = |q|, eta = q.v, beta = 2 mu/r0 - |v|^2.  ``eps`` is
    the machine epsilon, ``table`` an array of the `constants`; evaluations of Stumpff's functions are counted.
    """
    if beta > 0 and h * h * beta * beta * beta > 9 * mu * mu:  # about half a period
        period = 2 * table[NUMBERS, 0] * mu / (beta * beta**0.5)
        h = h % period
        if h > period / 2:
            h = h - period
    if h == 0:
        return h, h, h, h, 0
    sign = 1 if h > 0 else -1
    G1, G2, G3, r, evaluations = anomaly(r0, sign * eta, beta, mu, sign * h, eps, table)
    return -mu * G2 / r0, h - sign * mu * G3, -sign * mu * G1 / (r0 * r), -mu * G2 / r, evaluations


@jit
def advance(
    X: np.ndarray, first: int, dimension: int, mass: Number, mu: Number, h: Number, eps: Number, table: np.ndarray
) -> int:
    """Move one body along its Kepler orbit over the time h, in place; returns the evaluations of Stumpff's functions.

    The array X has the rows q, p and what rounding lost of q and of p.  The body's components are the columns first,
    ..., first + dimension - 1; p is ``mass`` times the velocity.  With mu = 0 the motion is free.
    """
    if mu == 0:
        for k in range(first, first + dimension):
            X[0, k], X[2, k] = add(X[0, k], X[2, k], h * X[1, k] / mass)
        return 0
    rr = vv = eta = h * 0
    for k in range(first, first + dimension):
        q, v = X[0, k], X[1, k] / mass
        rr, vv, eta = rr + q * q, vv + v * v, eta + q * v
    r0 = rr**0.5
    f, g, df, dg, evaluations = coefficients(r0, eta, 2 * mu / r0 - vv, mu, h, eps, table)
    for k in range(first, first + dimension):
        q, p = X[0, k], X[1, k]
        X[0, k], X[2, k] = add(q, X[2, k], f * q + g * (p / mass))
        X[1, k], X[3, k] = add(p, X[3, k], mass * (df * q) + dg * p)
    return evaluations
