r"""Exact solutions, evaluated by mpmath from initial data rounded to double.

Harmonic oscillator: :math:`q = q_0\cos\omega t + (p_0/\omega)\sin\omega t`, :math:`p = \dot q`.

Kepler, any elliptic state: with :math:`1/a = 2/r_0 - |p_0|^2`, :math:`\sigma = q_0\cdot p_0/\sqrt a` and
:math:`n = a^{-3/2}`, the change :math:`x` of the eccentric anomaly solves Kepler's equation

.. math:: n t = x - (1 - r_0/a)\sin x + \sigma(1 - \cos x),

and :math:`q = f q_0 + g p_0`, :math:`p = \dot f q_0 + \dot g p_0` with Lagrange's coefficients.

Source: R. H. Battin, An Introduction to the Mathematics and Methods of Astrodynamics (1999), sections 4.3 and 4.4.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import mpmath

    Flow = Callable[[mpmath.mpf], tuple[list[mpmath.mpf], list[mpmath.mpf]]]

#: Extra working digits.
GUARD = 15


def exact(
    problem: Any,
    times: Iterable[float],
    digits: int = 40,
    q0: Iterable[float] | None = None,
    p0: Iterable[float] | None = None,
) -> tuple[np.ndarray, np.ndarray] | None:
    """The exact solution at ``times``, or None if it is not known.

    Parameters
    ----------
    problem : a problem with ``id``, ``system``, ``q0`` and ``p0``; the solution is chosen by ``id``
    times : array (n,), in any order
    digits : significant digits of the result
    q0, p0 : arrays (d,), the initial state if not the problem's

    Returns
    -------
    q, p : object arrays (n, d) of mpmath numbers; None for an unknown id or a Kepler orbit that is not elliptic
    """
    solution = SOLUTIONS.get(getattr(problem, "id", None))
    if solution is None:
        return None
    import mpmath

    with mpmath.workdps(digits + GUARD):
        q = [mpmath.mpf(float(x)) for x in (problem.q0 if q0 is None else q0)]
        p = [mpmath.mpf(float(x)) for x in (problem.p0 if p0 is None else p0)]
        flow = solution(problem, q, p)
        if flow is None:
            return None
        rows = [flow(mpmath.mpf(float(t))) for t in times]
    shape = (len(rows), len(q))
    Q, P = np.empty(shape, dtype=object), np.empty(shape, dtype=object)
    for i, (x, y) in enumerate(rows):
        Q[i], P[i] = x, y
    return Q, P


def _oscillator(problem: Any, q: list[mpmath.mpf], p: list[mpmath.mpf]) -> Flow:
    """The solution t -> (q, p) of the harmonic oscillator; omega**2 is that of the force, rounded to double."""
    import mpmath
    import sympy as sp

    stiffness = sp.Rational(-problem.system.dp[0].coeff(problem.system.q[0]))
    omega = mpmath.sqrt(mpmath.mpf(int(stiffness.p)) / int(stiffness.q))
    nominal = problem.parameters["omega"]
    if abs(omega - nominal) > 1e-15 * nominal:
        raise ValueError(f"the force's frequency is {mpmath.nstr(omega, 17)}, the parameter omega {nominal!r}")

    def flow(t: mpmath.mpf) -> tuple[list[mpmath.mpf], list[mpmath.mpf]]:
        c, s = mpmath.cos(omega * t), mpmath.sin(omega * t)
        return [q[0] * c + p[0] / omega * s], [p[0] * c - q[0] * omega * s]

    return flow


def _kepler(problem: Any, q: list[mpmath.mpf], p: list[mpmath.mpf]) -> Flow | None:
    """The exact solution of the Kepler problem, a function t -> (q, p); None if the energy is not negative."""
    import mpmath

    r0 = mpmath.sqrt(sum(x * x for x in q))
    inverse = 2 / r0 - sum(x * x for x in p)
    if inverse <= 0:
        return None
    a = 1 / inverse
    root = mpmath.sqrt(a)
    sigma = sum(x * y for x, y in zip(q, p, strict=True)) / root
    ecosine = 1 - r0 / a
    motion = inverse / root

    def flow(t: mpmath.mpf) -> tuple[list[mpmath.mpf], list[mpmath.mpf]]:
        x = anomaly(motion * t, ecosine, sigma)
        c, s = mpmath.cos(x), mpmath.sin(x)
        r = a * (1 - ecosine * c + sigma * s)
        f, g = 1 - a / r0 * (1 - c), t - (x - s) / motion
        df, dg = -root * s / (r * r0), 1 - a / r * (1 - c)
        state = list(zip(q, p, strict=True))
        return [f * u + g * v for u, v in state], [df * u + dg * v for u, v in state]

    return flow


def anomaly(M: mpmath.mpf, ecosine: mpmath.mpf, esine: mpmath.mpf) -> mpmath.mpf:
    """The root x of M = x - ecosine sin x + esine (1 - cos x), by Newton's method safeguarded by bisection."""
    import mpmath

    width = 2 * mpmath.hypot(ecosine, esine) + mpmath.eps
    low, high = M - width, M + width
    x = M
    for _ in range(40 + 4 * mpmath.mp.prec):
        c, s = mpmath.cos(x), mpmath.sin(x)
        value = x - ecosine * s + esine * (1 - c) - M
        if value > 0:
            high = x
        else:
            low = x
        new = x - value / (1 - ecosine * c + esine * s)
        if not low <= new <= high:
            new = (low + high) / 2
        if abs(new - x) <= 8 * mpmath.eps * (1 + abs(x)):
            return new
        x = new
    raise ArithmeticError(f"Kepler's equation is not solved at mean anomaly {mpmath.nstr(M, 17)}")


#: Id of a problem -> a function (problem, q, p) -> (t -> state).
SOLUTIONS = {"harmonic-oscillator": _oscillator, "kepler": _kepler}
