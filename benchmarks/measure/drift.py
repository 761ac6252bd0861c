r"""The secular drift of an oscillating error, with a confidence interval of correct coverage.

An oscillation is not noise: the interval of a straight line fitted through it is far too narrow.  Three steps avoid it:

1. **Fast oscillation is averaged**: a long series is reduced to about `SAMPLES` weighted means under the window
   :math:`w(x) = e^{-1/(x(1-x))}`, for which the mean of a quasi-periodic function converges faster than any power of
   the number of its periods.
2. **Slow oscillation is fitted** and subtracted: one spectral line after another, the strongest first; all frequencies
   are refined together with their amplitudes and a straight line, which is not subtracted.  A line counts if it is
   `ABOVE` times as high as the spectrum around it, be that flat (white noise) or falling as 1/f^2 (a random walk of
   round-off).
3. **The slope is estimated from blocks**: `BLOCKS` parts of unequal length give one slope each, again under w.
   Increments in different blocks are independent for white noise and for a random walk, and since lengths differ, a
   remaining oscillation enters each with another phase.  The signed ranks of symmetric independent numbers have a known
   distribution, whatever the scale of each.  It gives the interval, between two means of pairs of slopes; the value is
   the median of these means.  The effective sample size is the number of blocks.

An oscillation of fewer than `SLOWEST` periods in the whole series cannot be distinguished from a drift.

Sources: S. Das, Y. Saiki, E. Sander, J. A. Yorke, Nonlinearity 30 (2017) 4111-4140 (the window); J. Laskar, Icarus 88
(1990) 266-291 (frequencies one after the other); R. Ibragimov, U. K. Mueller, J. Bus. Econ. Stat. 28 (2010) 453-468
(inference from the estimates of a few blocks); F. Wilcoxon, Biometrics Bull. 1 (1945) 80-83 and J. L. Hodges, E. L.
Lehmann, Ann. Math. Stat. 34 (1963) 598-611 (signed ranks, the median of pairs' means).
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from .metrics import CONFIDENCE, Slope

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

#: Number of blocks, and largest deviation of their lengths from the mean, as a share of it.
BLOCKS, UNEQUAL = 12, 0.4
#: Least number of points of a series.
POINTS = 4 * BLOCKS
#: A longer series is reduced to about `SAMPLES` means, each over `OVERLAP` times their spacing.
SAMPLES, OVERLAP = 512, 16
#: Largest number of fitted lines, and the least number of periods of a line in the whole series.
LINES, SLOWEST = 12, 1.5
#: Least ratio of a line's height to the spectrum around it.
ABOVE = 100.0
#: Points of the spectrum per unit of frequency, and the range of distances that counts as "around" a line.
FINE, ABOUT = 4, (3, 20)
#: Newton steps on all frequencies after each new line.
REFINED = 3
GOLDEN = (5**0.5 - 1) / 2


def drift(t: ArrayLike, error: ArrayLike) -> Slope:
    """Return the secular slope of ``error`` over equidistant times ``t``, arrays (n,), with its 95 % interval.

    Raises ValueError for fewer than `POINTS` points.
    """
    t, error = np.asarray(t, float), np.asarray(error, float)
    if len(t) < POINTS:
        raise ValueError(f"{len(t)} points are too few for {BLOCKS} blocks; give at least {POINTS}")
    t, error = _average(t, error)
    return signed_ranks(_slopes(t, without_lines(t, error)))


def signed_ranks(x: np.ndarray) -> Slope:
    """Return the Hodges-Lehmann centre of independent numbers x, array (n,), n >= 6, as a `Slope` with its interval.

    The centre is the median of the means of all pairs, each number also paired with itself; the numbers are assumed
    symmetric about it.  The interval is the shortest one from signed ranks with a probability of at least `CONFIDENCE`.
    """
    i, j = np.triu_indices(len(x))
    means = np.sort((x[i] + x[j]) / 2)
    outside = _outside(len(x))
    return Slope(float(np.median(means)), float(means[outside]), float(means[-1 - outside]))


@cache
def _outside(n: int) -> int:
    """Return how many of the sorted pairwise means of n numbers lie below (and above) the signed-rank interval."""
    ways = np.ones(1)
    for rank in range(1, n + 1):
        ways = np.convolve(ways, np.eye(1, rank + 1, 0)[0] + np.eye(1, rank + 1, rank)[0])
    probability = np.cumsum(ways) / 2.0**n
    return int((probability <= (1 - CONFIDENCE) / 2).sum()) - 1


def window(n: int) -> np.ndarray:
    """Return the averaging window w(x) = exp(4 - 1 / (x (1 - x))) at the midpoints of n equal parts of (0, 1)."""
    x = (np.arange(n) + 0.5) / n
    return np.exp(4 - 1 / (x * (1 - x)))


def _average(t: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    apart = len(t) // SAMPLES
    if apart < 2:
        return t, error
    weight = window(OVERLAP * apart)
    weight /= weight.sum()
    view = np.lib.stride_tricks.sliding_window_view
    means = [view(x, len(weight))[::apart] @ weight for x in (t, error - error[0])]
    return means[0], means[1]


def _slopes(t: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return the slope of ``error`` over ``t``, arrays (n,), in each of `BLOCKS` blocks of time: array (BLOCKS,).

    It is a least-squares slope with the weights of `window`, which suppress oscillations.  The lengths of the blocks
    differ, by multiples of the golden ratio modulo 1, so that no oscillation has the same phase in all of them.
    """
    lengths = 1 + UNEQUAL * (2 * (np.arange(1, BLOCKS + 1) * GOLDEN % 1) - 1)
    edges = np.round(np.append(0, np.cumsum(lengths)) / lengths.sum() * len(t)).astype(int)
    out = []
    for a, b in pairwise(edges):
        weight = window(b - a)
        x = weight * (t[a:b] - np.average(t[a:b], weights=weight))
        out.append(x @ (error[a:b] - error[a]) / (x @ t[a:b] - x.sum() * t[a]))
    return np.array(out)


def without_lines(t: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return a series minus its significant oscillations, the spectral lines that stand out of its spectrum.

    ``error`` is the series at equidistant times ``t``, arrays (n,); a straight line in it stays.  Sines and cosines are
    fitted one frequency after another, the strongest first.
    """
    scale = np.ptp(error)
    if not scale > 0:
        return error
    x, y = np.arange(len(t)) / len(t) - 0.5, (error - error.mean()) / scale
    hann = np.hanning(len(t) + 2)[1:-1]
    frequencies, fit = np.empty(0), _fit(x, y, hann, np.empty(0))
    while len(frequencies) < LINES:
        rest = y - _columns(x, frequencies) @ fit
        found = _line(rest * hann)
        if found is None:
            break
        more = _refine(x, y, hann, np.append(frequencies, found))
        again = _fit(x, y, hann, more)
        if not _sound(more, again) or not _size(y - _columns(x, more) @ again, hann) < _size(rest, hann):
            break
        frequencies, fit = more, again
    return scale * _remove_lines(x, y, hann, frequencies, fit)


def _remove_lines(
    x: np.ndarray, y: np.ndarray, weight: np.ndarray, frequencies: np.ndarray, fit: np.ndarray
) -> np.ndarray:
    """Return the series y(x), arrays (n,), minus its fitted sines and cosines.

    ``fit`` has the coefficients of 1, x, the cosines and the sines of ``frequencies``; 1 and x are not subtracted.
    What remains is fitted once more, with weights ``weight`` (n,), so that less round-off is left.
    """
    columns = np.hstack([_columns(x, frequencies), _fit_derivatives(x, frequencies, fit)])
    rest = y - columns[:, : len(fit)] @ fit
    more = _least_squares(columns, rest, weight)
    return rest - columns @ more + columns[:, :2] @ (fit + more[: len(fit)])[:2]


def _sound(frequencies: np.ndarray, fit: np.ndarray) -> bool:
    """True if fitted oscillations are plausible, so that they may be subtracted.

    The frequencies must differ by at least 1 period in the series from each other and from 0, and no amplitude may
    exceed the series' range.  Lines that nearly cancel arise when the error is not an oscillation, for instance if it
    decays.
    """
    k = len(frequencies)
    amplitudes = np.hypot(fit[2 : 2 + k], fit[2 + k :])
    return bool(np.diff(np.sort(frequencies), prepend=0).min() >= 1 and amplitudes.max() <= 1)


def _size(rest: np.ndarray, weight: np.ndarray) -> float:
    return float(np.linalg.norm(rest * weight))


def _line(signal: np.ndarray) -> float | None:
    """Return the frequency (periods in the series) of a signal's highest spectral peak; None if it is too low.

    The signal is a series (n,) at equidistant times.  A peak is too low if it is less than `ABOVE` times the spectrum
    around it.
    """
    n = len(signal)
    power = np.abs(np.fft.rfft(signal, FINE * n)) ** 2
    at = np.arange(len(power)) / FINE
    inside = (at >= SLOWEST) & (at <= n / 2 - 2)
    top = int(np.argmax(np.where(inside, power, 0)))
    distance = np.abs(at - at[top])
    about = (distance > ABOUT[0]) & (distance <= ABOUT[1]) & (at >= SLOWEST)
    flat, falling = np.median(power[about]), np.median(power[about] * at[about] ** 2) / at[top] ** 2
    if not power[top] > ABOVE * max(flat, falling) or not power[top] > max(power[top - 1], power[top + 1]):
        return None
    low, middle, high = np.log(power[top - 1 : top + 2])
    return at[top] + (low - high) / (low - 2 * middle + high) / 2 / FINE


def _columns(x: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """Return the columns 1, x, then cos and sin of 2 pi x f for each of k frequencies f, array (n, 2 + 2 k)."""
    angle = 2 * np.pi * np.outer(x, frequencies)
    return np.hstack([np.ones((len(x), 1)), x[:, None], np.cos(angle), np.sin(angle)])


def _fit(x: np.ndarray, y: np.ndarray, weight: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    return _least_squares(_columns(x, frequencies), y, weight)


def _least_squares(columns: np.ndarray, y: np.ndarray, weight: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(columns * weight[:, None], y * weight, rcond=1e-13)[0]


def _refine(x: np.ndarray, y: np.ndarray, weight: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """Improve the frequencies (periods in the series) of the oscillations fitted to y(x), and return them.

    Takes `REFINED` Gauss-Newton steps, each of at most a third of a period; ``weight`` (n,) weighs the points.
    """
    fit = _fit(x, y, weight, frequencies)
    for _ in range(REFINED):
        columns = np.hstack([_columns(x, frequencies), _fit_derivatives(x, frequencies, fit)])
        fit = _least_squares(columns, y, weight)
        frequencies = frequencies + np.clip(fit[-len(frequencies) :], -1 / 3, 1 / 3)
    return frequencies


def _fit_derivatives(x: np.ndarray, frequencies: np.ndarray, fit: np.ndarray) -> np.ndarray:
    """Return the derivatives of the fitted oscillations at x (n,) by each of k frequencies, array (n, k).

    ``fit`` (2 + 2 k,) has the coefficients of 1, x, the cosines and the sines.
    """
    k = len(frequencies)
    angle = 2 * np.pi * np.outer(x, frequencies)
    return 2 * np.pi * x[:, None] * (np.cos(angle) * fit[2 + k : 2 + 2 * k] - np.sin(angle) * fit[2 : 2 + k])
