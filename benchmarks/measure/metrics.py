r"""Errors of invariants, slopes and orders of convergence: pure functions of arrays.

Observed order: least squares of log error on log h, :math:`\log e = \log C + p \log h`, over the asymptotic window,
with the two-sided Student-t interval of the slope.

Source: N. R. Draper, H. Smith, Applied Regression Analysis (1998), 1.4 (the interval of a slope).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

CONFIDENCE = 0.95
#: Windows whose slope has a narrower half-interval count as equally good; the longest of them is taken.
WELL_KNOWN = 0.01


@dataclass(frozen=True)
class Slope:
    """A slope, ``value``, with its two-sided 95 % interval from ``low`` to ``high``."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Order:
    """An observed order of convergence with its two-sided 95 % interval, and the window of steps h that it is from.

    Attributes
    ----------
    value, low, high : the order and its interval
    first, last, points : the largest and the smallest h of the window, and how many; 0, and all else NaN, below 3
    """

    value: float
    low: float
    high: float
    first: float
    last: float
    points: int


@dataclass(frozen=True)
class InvariantError:
    """The deviation of an invariant from its first value: ``max`` is the largest absolute one, ``end`` the last one."""

    max: float
    end: float


def slope(x: ArrayLike, y: ArrayLike) -> Slope:
    """Return the least-squares slope of y on x, arrays (n,) with n >= 3, with its 95 % interval.

    Raises ValueError for fewer points or if all x are equal.
    """
    from scipy.stats import t as student

    value, error, free = _line(x, y)
    half = student.ppf(0.5 + CONFIDENCE / 2, free) * error
    return Slope(float(value), float(value - half), float(value + half))


def t_value(x: ArrayLike, y: ArrayLike) -> float:
    """Return the least-squares slope of y on x in its standard errors; raises as `slope`."""
    value, error, _ = _line(x, y)
    return float(value / error)


def _line(x: ArrayLike, y: ArrayLike) -> tuple[float, float, int]:
    """Return the least-squares slope of y on x, arrays (n,), its standard error and degrees of freedom."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    n = len(x)
    if n < 3 or not np.ptp(x) > 0:
        raise ValueError(f"a slope with an interval needs at least 3 points at different places, not {n}")
    dx = x - x.mean()
    value = dx @ (y - y.mean()) / (dx @ dx)
    rest = y - y.mean() - value * dx
    return value, np.sqrt(rest @ rest / (n - 2) / (dx @ dx)), n - 2


def power(h: ArrayLike, error: ArrayLike) -> Slope:
    """Fit error = C h^p to arrays (n,) of n >= 3 positive numbers, and return the exponent p with its 95 % interval."""
    return slope(np.log(h), np.log(error))


def order(h: ArrayLike, error: ArrayLike, noise: float = 0.0, ceiling: float = np.inf) -> Order:
    """Return the observed order of convergence of ``error`` as the step h falls, arrays (n,), in the asymptotic window.

    A line is fitted to each run of at least 3 neighbouring points; the window is the run with the narrowest interval of
    the slope.  Coarse steps (not yet asymptotic) and fine ones (round-off) bend the line and widen the interval, as do
    fewer points.  Runs whose interval is narrower than +-0.01 count as equal; of these the longest, then the finest, is
    taken.  Errors that are not finite or not positive, up to ``noise`` (round-off, the uncertainty of the reference) or
    from ``ceiling`` on (as large as the solution) are left out.  Raises ValueError for arrays of different lengths.
    """
    h, error = np.asarray(h, float), np.asarray(error, float)
    if h.shape != error.shape or h.ndim != 1:
        raise ValueError(f"h and error must be arrays of one length, not of shapes {h.shape} and {error.shape}")
    with np.errstate(invalid="ignore"):
        use = np.isfinite(error) & (error > max(noise, 0.0)) & (error < ceiling) & (h > 0)
    # A point that is left out splits the ladder: a window does not extend across it.
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


def invariant_error(values: ArrayLike) -> InvariantError:
    """Return the error of an invariant along a trajectory, values (n,), against its first value; NaN if one is NaN."""
    error = np.asarray(values) - np.asarray(values)[0]
    return InvariantError(np.max(np.abs(error)), error[-1])


def refinement_difference(coarse: ArrayLike, fine: ArrayLike) -> float:
    """Return the max norm of the difference of two states (q, p), reached with steps h (``coarse``) and h/2."""
    return np.max(np.abs(np.asarray(coarse) - np.asarray(fine)))
