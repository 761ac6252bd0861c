r"""Errors, orders and defects: pure functions of arrays (drifts: `drift`).

Observed order: least squares of log error on log h, :math:`\log e = \log C + p \log h`, over the asymptotic window,
with the two-sided Student-t interval of the slope.  Symplecticity defect: :math:`\max_{ij}|M^T J M - J|_{ij}`.

Sources: N. R. Draper, H. Smith, Applied Regression Analysis (1998), 1.4 (the interval of a slope); Hairer, Lubich,
Wanner, Geometric Numerical Integration (2006), V.1 and VI.2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

CONFIDENCE = 0.95
#: A window whose slope is known this well needs no shortening: among such windows the longest is taken.
WELL_KNOWN = 0.01


@dataclass(frozen=True)
class Slope:
    """A slope with its two-sided 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Order:
    """An observed order with its two-sided 95 % interval and its window.

    ``first`` and ``last`` are the largest and the smallest h of the window, ``points`` its number of points; all are
    NaN and ``points`` is 0 where fewer than 3 points are left.
    """

    value: float
    low: float
    high: float
    first: float
    last: float
    points: int


@dataclass(frozen=True)
class InvariantError:
    """The deviation of an invariant from its first value: the greatest size and the signed one at the end."""

    max: float
    end: float


def slope(x, y) -> Slope:
    """The least-squares slope of y on x, arrays (n,) of n >= 3 points, with its interval.

    Raises ValueError for fewer points or where all x are equal.
    """
    from scipy.stats import t as student

    x, y = np.asarray(x, float), np.asarray(y, float)
    n = len(x)
    if n < 3 or not np.ptp(x) > 0:
        raise ValueError(f"a slope with an interval needs at least 3 points at different places, not {n}")
    dx = x - x.mean()
    value = dx @ (y - y.mean()) / (dx @ dx)
    rest = y - y.mean() - value * dx
    half = student.ppf(0.5 + CONFIDENCE / 2, n - 2) * np.sqrt(rest @ rest / (n - 2) / (dx @ dx))
    return Slope(float(value), float(value - half), float(value + half))


def power(h, error) -> Slope:
    """The exponent p of error = C h^p, arrays (n,) of n >= 3 positive numbers, with its interval."""
    return slope(np.log(h), np.log(error))


def order(h, error, noise: float = 0.0, ceiling: float = np.inf) -> Order:
    """The observed order of ``error`` as h falls, in the asymptotic window.

    Every run of at least 3 neighbouring points is fitted.  Coarse steps (not yet asymptotic) and fine ones (round-off)
    bend the line and widen the interval, a shorter run widens it too: the run of the narrowest interval is the window.
    Runs whose interval is narrower than +-0.01 count as equal; of these the longest, then the finest, is taken.

    Parameters
    ----------
    h, error : arrays (n,), in any order; errors that are not finite or not positive are left out
    noise : errors at or below it (round-off, the uncertainty of the reference) are left out
    ceiling : errors at or above it (saturated: as large as the solution) are left out
    """
    h, error = np.asarray(h, float), np.asarray(error, float)
    if h.shape != error.shape or h.ndim != 1:
        raise ValueError(f"h and error must be arrays of one length, not of shapes {h.shape} and {error.shape}")
    with np.errstate(invalid="ignore"):
        use = np.isfinite(error) & (error > max(noise, 0.0)) & (error < ceiling) & (h > 0)
    # A rejected point splits the ladder: a window does not reach across it.
    place = np.argsort(-h, kind="stable")
    h, error, use = h[place], error[place], use[place]
    best, best_key = None, None
    for i in range(len(h)):
        for j in range(i + 3, len(h) + 1):
            if not use[i:j].all():
                break
            s = power(h[i:j], error[i:j])
            key = (max(s.high - s.value, WELL_KNOWN), -(j - i), -i)
            if best_key is None or key < best_key:
                best, best_key = Order(s.value, s.low, s.high, float(h[i]), float(h[j - 1]), j - i), key
    nan = float("nan")
    return best or Order(nan, nan, nan, nan, nan, 0)


def invariant_error(values) -> InvariantError:
    """The error of H or another invariant along a trajectory, array (n,), against its first value; NaN where any is."""
    error = np.asarray(values) - np.asarray(values)[0]
    return InvariantError(np.max(np.abs(error)), error[-1])


def jacobian(step: Callable, y, delta=None):
    """The Jacobian, shape (m, m), of a map on arrays (m,), by fourth-order central differences.

    ``delta`` is the displacement, at first the fifth root of the round-off of doubles: the error is about 1e-12 times
    the fifth derivative.  In multiprecision (object arrays) give the fifth root of the round-off at hand.
    """
    y = np.asarray(y)
    delta = np.finfo(float).eps ** 0.2 if delta is None else delta
    columns = []
    for i in range(len(y)):
        e = np.zeros(len(y), dtype=y.dtype)
        e[i] = delta
        near = step(y + e) - step(y - e)
        far = step(y + 2 * e) - step(y - 2 * e)
        columns.append((8 * near - far) / (12 * delta))
    return np.array(columns).T


def symplecticity_defect(M):
    """The largest entry in size of M^T J M - J, for M of shape (2 d, 2 d) in the order (q, p)."""
    M = np.asarray(M)
    d, odd = divmod(len(M), 2)
    if M.ndim != 2 or M.shape[0] != M.shape[1] or odd:
        raise ValueError(f"a symplectic matrix has shape (2 d, 2 d), not {M.shape}")
    J = np.kron(np.array([[0, 1], [-1, 0]]), np.eye(d, dtype=int))
    return np.max(np.abs(M.T @ (J @ M) - J))


def pair_defect(step: Callable, y):
    """|omega(M u, M v) - omega(u, v)| for one pair of tangent vectors in general position, M the Jacobian of ``step``.

    The vectors' components are of the size of those of y, and the defect is relative to the terms of omega(u, v).

    Central differences over the cube root of the round-off of mpmath's working precision: four steps whatever the
    dimension, where `symplecticity_defect` of a `jacobian` takes eight for each component of y.
    """
    import mpmath

    from phasebench.integrators.engine.codegen import MULTIPRECISION, epsilon, vector

    d, delta = len(y) // 2, epsilon(MULTIPRECISION) ** (1 / 3)
    u, v = (vector([mpmath.cos(k * (i + 1)) * (abs(x) or 1) for i, x in enumerate(y)]) for k in (1, 2))
    Mu, Mv = ((step(y + delta * w) - step(y - delta * w)) / (2 * delta) for w in (u, v))
    terms = abs(u[:d]) @ abs(v[d:]) + abs(u[d:]) @ abs(v[:d])
    return abs(Mu[:d] @ Mv[d:] - Mu[d:] @ Mv[:d] - (u[:d] @ v[d:] - u[d:] @ v[:d])) / terms


def reversibility_defect(step: Callable, y, rho=None):
    """The distance of rho(step(rho(step(y)))) from y in the maximum norm; rho, array (m,), at first reverses p."""
    y = np.asarray(y)
    if rho is None:
        rho = np.repeat([1, -1], len(y) // 2)
    return np.max(np.abs(rho * step(rho * step(y)) - y))


def refinement_difference(coarse, fine):
    """The difference of the states (q, p) that steps h and h/2 reach, in the maximum norm."""
    return np.max(np.abs(np.asarray(coarse) - np.asarray(fine)))
