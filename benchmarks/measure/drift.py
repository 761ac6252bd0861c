r"""The secular drift of an oscillating error, with a confidence interval of correct coverage.

An oscillation is not noise: the interval of a straight line fitted through it is far too narrow.  Three steps avoid it:

1. **Fast oscillation is averaged**: a long series is reduced to about `SAMPLES` weighted means under the window
   :math:`w(x) = e^{-1/(x(1-x))}`, for which the mean of a quasi-periodic function converges faster than any power of
   the number of its periods.
2. **Slow oscillation is fitted** and subtracted: one spectral line after another, the strongest first; all frequencies
   are refined together with their amplitudes and a straight line, which is not subtracted.  A line counts if it is
   `ABOVE` times as high as the spectrum around it, which is flat (white noise) or falls as 1/f^2 (a random walk of
   round-off).
3. **The slope is estimated by generalized least squares** from the slowest sine components of the increments.  There
   the noise is independent: its variance is constant for a random walk, grows as :math:`k^2` for white noise, and is a
   sum of both for a mixture.  The slow components tell only in part which it is; the interval is that of the one of
   `MODELS` whose restricted likelihood, times its weight of `WEIGHTS`, is largest.

An oscillation of fewer than `SLOWEST` periods in the whole series cannot be distinguished from a drift.

Sources: S. Das, Y. Saiki, E. Sander, J. A. Yorke, Nonlinearity 30 (2017) 4111-4140 (the window); J. Laskar, Icarus 88
(1990) 266-291 (frequencies one after the other); A. C. Harvey, Forecasting, structural time series models and the
Kalman filter (1989), 4.3 (line, random walk and white noise by frequencies); U. K. Mueller, M. W. Watson, Econometrica
76 (2008) 979-1016 (inference from a few slow components).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .metrics import CONFIDENCE, Slope

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

#: Least number of points of a series; number of slowest components used, besides those that fitted lines take up.
POINTS, MODES = 48, 48
#: Models of the noise: up to which component a random walk exceeds white noise.  With their weights the interval covers
#: 97 % of draws of white noise and 95 % of a random walk; of a sum of both at least 80 %, the least for 4 to 8.
MODELS, WEIGHTS = (0.0, 3.0, 16.0, np.inf), (1.0, 1.6, 4.0, 40.0)
#: A longer series is reduced to about `SAMPLES` means, each over `OVERLAP` times their spacing.
SAMPLES, OVERLAP = 512, 16
#: Largest number of fitted lines, and the least number of periods of a line in the whole series.
LINES, SLOWEST = 12, 1.5
#: Least ratio of a line's height to the spectrum around it.
ABOVE = 100.0
#: Points of the spectrum per unit of frequency; the distances from a line that count as around, near and far.
FINE, DISTANCES = 4, ((3, 20), (3, 12), (11, 20))
#: A spectrum that falls as 1/f^2 is told from a flat one if that makes this much difference between near and far.
TOLD = 0.01
#: Newton steps on all frequencies after each new line.
REFINED = 3
#: Squares that fitting leaves by round-off.
EPS = float(np.finfo(float).eps) ** 2


class Mixture(NamedTuple):
    """Estimates of some coefficients by each of `MODELS`.

    Attributes
    ----------
    values, errors, weights : arrays (models, n): of n coefficients, the estimates, standard errors and weights
    free : degrees of freedom of each
    """

    values: np.ndarray
    errors: np.ndarray
    weights: np.ndarray
    free: int

    def below(self, bound: ArrayLike) -> np.ndarray:
        """Return the probabilities that the coefficients are below ``bound``: array (n,)."""
        from scipy.special import stdtr

        return (self.weights * stdtr(self.free, (bound - self.values) / self.errors)).sum(axis=0)

    def slope(self) -> Slope:
        """Return the first coefficient with its interval, by the most likely model."""
        from scipy.special import stdtrit

        best = np.argmax(self.weights[:, 0])
        value, half = self.values[best, 0], stdtrit(self.free, 0.5 + CONFIDENCE / 2) * self.errors[best, 0]
        return Slope(float(value), float(value - half), float(value + half))


def drift(t: ArrayLike, error: ArrayLike) -> Slope:
    """Return the secular slope of ``error`` over equidistant times ``t``, arrays (n,), with its 95 % interval.

    Raises ValueError for fewer than `POINTS` points.
    """
    t, error = np.asarray(t, float), np.asarray(error, float)
    if len(t) < POINTS:
        raise ValueError(f"{len(t)} points are too few for a slope with an interval; give at least {POINTS}")
    if not np.ptp(error) > 0:
        return Slope(0.0, 0.0, 0.0)
    apart = len(t) // SAMPLES
    t, error = average(t, error)
    rest, lines = split(t, error)
    return fitted(rest, lines, t[:, None], apart).slope()


def fitted(series: np.ndarray, base: np.ndarray, tried: np.ndarray, apart: int) -> Mixture:
    """Fit a series (n,) by the columns ``base`` (n, k) and one column of ``tried`` (n, m), in turns.

    Returns the coefficients of the latter.  ``apart`` is the number of points from one row to the next (`average`).
    """
    from scipy.fft import dst

    columns = np.diff(np.column_stack([series, base, tried]), axis=0)
    table = dst(columns, type=1, axis=0, norm="ortho")[: MODES + base.shape[1]]
    y, base, tried = table[:, 0], table[:, 1 : base.shape[1] + 1], table[:, base.shape[1] + 1 :]
    if not y.any():
        zero = np.zeros((len(MODELS), tried.shape[1]))
        return Mixture(zero, zero + np.finfo(float).tiny, zero + 1 / len(MODELS), 1)
    free = len(y) - base.shape[1] - 1
    angle = np.pi / 2 / len(series)
    k = np.arange(1, len(y) + 1)
    white = np.sin(angle * k) ** 2
    kept = np.ones(len(y))
    if apart > 1:  # the means have lost of the noise, not of a line
        place = np.arange(OVERLAP * apart) - (OVERLAP * apart - 1) / 2
        kept = np.cos(np.outer(2 * angle / apart * k, place)) @ window(OVERLAP * apart)
    values, errors, likelihoods = [], [], []
    for model in MODELS:
        walk = np.sin(angle * min(model, len(series))) ** 2
        deviation = (kept * np.sqrt(white + walk if np.isfinite(model) else 1.0))[:, None]
        Q, R = np.linalg.qr(base / deviation)
        rest, columns = (x - Q @ (Q.T @ x) for x in (y / deviation[:, 0], tried / deviation))
        squares = (columns**2).sum(axis=0)
        values.append(columns.T @ rest / squares)
        left = ((rest[:, None] - columns * values[-1]) ** 2).sum(axis=0)
        left = np.maximum(left, EPS * (y / deviation[:, 0]) @ (y / deviation[:, 0]))
        errors.append(np.sqrt(left / free / squares))
        volume = np.log(np.abs(deviation)).sum() + np.log(np.abs(np.diag(R))).sum() + np.log(squares) / 2
        likelihoods.append(-volume - free * np.log(left) / 2)
    weights = np.array(WEIGHTS)[:, None] * np.exp(np.array(likelihoods) - np.max(likelihoods, axis=0))
    return Mixture(np.array(values), np.array(errors), weights / weights.sum(axis=0), free)


def average(t: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the weighted means of times and of a series, arrays (n,), if it is long; else both as they are."""
    apart = len(t) // SAMPLES
    if apart < 2:
        return t, error
    weight = window(OVERLAP * apart)
    view = np.lib.stride_tricks.sliding_window_view
    means = [view(x, len(weight))[::apart] @ weight for x in (t, error - error[0])]
    return means[0], means[1]


def window(n: int) -> np.ndarray:
    """Return the weights exp(-1 / (x (1 - x))), of sum 1, at the midpoints x of n equal parts of (0, 1)."""
    x = (np.arange(n) + 0.5) / n
    weight = np.exp(4 - 1 / (x * (1 - x)))
    return weight / weight.sum()


def split(t: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a series minus its significant oscillations, and the slow columns that they were fitted by.

    ``error`` is the series at equidistant times ``t``, arrays (n,); a straight line in it stays.  The oscillations are
    spectral lines that stand out: sines and cosines are fitted one frequency after another, the strongest first.  The
    columns (n, k) are slow enough to matter to `components`.
    """
    scale = np.ptp(error)
    if not scale > 0:
        return error - error, np.empty((len(t), 0))
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
    columns = np.hstack([_columns(x, frequencies)[:, 2:], _fit_derivatives(x, frequencies, fit)])
    slow = np.tile(2 * frequencies < MODES + 3 * len(frequencies), 3)
    return scale * _remove_lines(x, y, hann, frequencies, fit), columns[:, slow]


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
    around it, a flat part and one that falls as 1/f^2.
    """
    n = len(signal)
    power = np.abs(np.fft.rfft(signal, FINE * n)) ** 2
    at = np.arange(len(power)) / FINE
    inside = (at >= SLOWEST) & (at <= n / 2 - 2)
    top = int(np.argmax(np.where(inside, power, 0)))
    distance = np.abs(at - at[top])
    about, near, far = ((distance > a) & (distance <= b) & (at >= SLOWEST) for a, b in DISTANCES)
    white, both = np.median(power[far]), np.median(power[near])
    ratio = (np.mean(at[near] ** -2.0) - np.mean(at[far] ** -2.0)) * at[top] ** 2
    around = max(np.median(power[about]), white + (both - white) / ratio if ratio > TOLD else 0.0)
    if not power[top] > ABOVE * around or not power[top] > max(power[top - 1], power[top + 1]):
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
