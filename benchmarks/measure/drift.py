r"""The secular drift of an error that oscillates, with an interval that covers.

An oscillation is not noise: a straight line through it has an interval that is far too narrow.  Here in three steps

1. **fast oscillation is averaged**: a long series is taken to about `SAMPLES` means under the window
   :math:`w(x) = e^{-1/(x(1-x))}`, under which the mean of a quasi-periodic function falls faster than any power of the
   number of its periods;
2. **slow oscillation is fitted**: line by line, the strongest first, frequencies of all refined together with their
   amplitudes and a straight line; a line counts that stands `ABOVE` times as high as the spectrum about it, whether
   that is flat (white noise) or falls as 1/f^2 (a random walk of round-off); the lines are taken away, the straight
   line is not;
3. **the slope is that of blocks**: `BLOCKS` parts of unequal length give a slope each, again under w.  Increments of
   different blocks are independent for white noise as for a random walk, and with the blocks' lengths an oscillation
   that is left enters each with another phase.  Of symmetric independent numbers the signed ranks have a known
   distribution, whatever the scale of each: it gives the interval, between two means of pairs of slopes, and the value
   is the median of these means.  The number of blocks is the effective size of the sample.

An oscillation of fewer than `SLOWEST` periods in the whole time cannot be told from a drift, and is not.

Sources: S. Das, Y. Saiki, E. Sander, J. A. Yorke, Nonlinearity 30 (2017) 4111-4140 (the window); J. Laskar, Icarus 88
(1990) 266-291 (frequencies one after the other); R. Ibragimov, U. K. Mueller, J. Bus. Econ. Stat. 28 (2010) 453-468
(inference from the estimates of a few blocks); F. Wilcoxon, Biometrics Bull. 1 (1945) 80-83 and J. L. Hodges, E. L.
Lehmann, Ann. Math. Stat. 34 (1963) 598-611 (signed ranks, the median of pairs' means).
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np

from .metrics import CONFIDENCE, Slope

#: Blocks that give a slope each, and how much their lengths differ from the mean one, as a share of it.
BLOCKS, UNEQUAL = 12, 0.4
#: Points of the shortest series.
POINTS = 4 * BLOCKS
#: A series of more than twice as many points is averaged to about so many, each over `OVERLAP` times their distance.
SAMPLES, OVERLAP = 512, 16
#: Lines that are fitted at most, and the periods in the whole time of the slowest.
LINES, SLOWEST = 12, 1.5
#: A line is so many times as high as the spectrum about it.
ABOVE = 100.0
#: Points of the spectrum for each period in the whole time; the distances, in periods, of what is about a line.
FINE, ABOUT = 4, (3, 20)
#: Steps of Newton's method on all frequencies with each line that is new.
REFINED = 3
GOLDEN = (5**0.5 - 1) / 2


def drift(t, error) -> Slope:
    """The secular slope of ``error`` in equidistant t, arrays (n,), with its interval.

    Raises ValueError for fewer points than `POINTS`.
    """
    t, error = np.asarray(t, float), np.asarray(error, float)
    if len(t) < POINTS:
        raise ValueError(f"{len(t)} points are too few for {BLOCKS} blocks; give at least {POINTS}")
    t, error = _averaged(t, error)
    return signed_ranks(_slopes(t, without_lines(t, error)))


def signed_ranks(x) -> Slope:
    """The centre of symmetric independent numbers, array (n,) of n >= 6, by the median of the means of all pairs.

    The interval is the shortest of signed ranks whose probability is at least `CONFIDENCE`.
    """
    i, j = np.triu_indices(len(x))
    means = np.sort((x[i] + x[j]) / 2)
    outside = _outside(len(x))
    return Slope(float(np.median(means)), float(means[outside]), float(means[-1 - outside]))


@cache
def _outside(n: int) -> int:
    """How many of the sorted means of pairs of n numbers lie beyond either end of the interval."""
    ways = np.ones(1)
    for rank in range(1, n + 1):
        ways = np.convolve(ways, np.eye(1, rank + 1, 0)[0] + np.eye(1, rank + 1, rank)[0])
    probability = np.cumsum(ways) / 2.0**n
    return int((probability <= (1 - CONFIDENCE) / 2).sum()) - 1


def window(n: int) -> np.ndarray:
    """The window w at the middles of n equal cells."""
    x = (np.arange(n) + 0.5) / n
    return np.exp(4 - 1 / (x * (1 - x)))


def _averaged(t, error) -> tuple[np.ndarray, np.ndarray]:
    apart = len(t) // SAMPLES
    if apart < 2:
        return t, error
    weight = window(OVERLAP * apart)
    weight /= weight.sum()
    view = np.lib.stride_tricks.sliding_window_view
    means = [view(x, len(weight))[::apart] @ weight for x in (t, error - error[0])]
    return means[0], means[1]


def _slopes(t, error) -> np.ndarray:
    """The slope in each block, array (BLOCKS,); their lengths follow the golden ratio."""
    lengths = 1 + UNEQUAL * (2 * (np.arange(1, BLOCKS + 1) * GOLDEN % 1) - 1)
    edges = np.round(np.append(0, np.cumsum(lengths)) / lengths.sum() * len(t)).astype(int)
    out = []
    for a, b in pairwise(edges):
        weight = window(b - a)
        x = weight * (t[a:b] - np.average(t[a:b], weights=weight))
        out.append(x @ (error[a:b] - error[a]) / (x @ t[a:b] - x.sum() * t[a]))
    return np.array(out)


def without_lines(t, error) -> np.ndarray:
    """``error`` at equidistant t, arrays (n,), less its significant slow oscillation."""
    scale = np.ptp(error)
    if not scale > 0:
        return error
    x, y = np.arange(len(t)) / len(t) - 0.5, (error - error.mean()) / scale
    hann = np.hanning(len(t) + 2)[1:-1]
    frequencies, fit = np.empty(0), _fitted(x, y, hann, np.empty(0))
    while len(frequencies) < LINES:
        rest = y - _columns(x, frequencies) @ fit
        found = _line(rest * hann)
        if found is None:
            break
        more = _refined(x, y, hann, np.append(frequencies, found))
        again = _fitted(x, y, hann, more)
        if not _sound(more, again) or not _size(y - _columns(x, more) @ again, hann) < _size(rest, hann):
            break
        frequencies, fit = more, again
    return scale * _straightened(x, y, hann, frequencies, fit)


def _straightened(x, y, weight, frequencies, fit) -> np.ndarray:
    """The straight line and what no line explains: fitted once more to the rest, whose digits y has not."""
    columns = np.hstack([_columns(x, frequencies), _turned(x, frequencies, fit)])
    rest = y - columns[:, : len(fit)] @ fit
    more = _least_squares(columns, rest, weight)
    return rest - columns @ more + columns[:, :2] @ (fit + more[: len(fit)])[:2]


def _sound(frequencies, fit) -> bool:
    """Whether lines are a period apart from each other and from 0, and none is larger than the error's whole range.

    Lines that cancel each other are what a fit makes of an error that is no oscillation, such as one that decays.
    """
    k = len(frequencies)
    amplitudes = np.hypot(fit[2 : 2 + k], fit[2 + k :])
    return bool(np.diff(np.sort(frequencies), prepend=0).min() >= 1 and amplitudes.max() <= 1)


def _size(rest, weight) -> float:
    return float(np.linalg.norm(rest * weight))


def _line(signal) -> float | None:
    """The frequency, in periods in the whole time, of the highest line of a windowed signal; None if it is no line."""
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


def _columns(x, frequencies) -> np.ndarray:
    """1, x, and the cosines and sines of all frequencies, array (n, 2 + 2 k)."""
    angle = 2 * np.pi * np.outer(x, frequencies)
    return np.hstack([np.ones((len(x), 1)), x[:, None], np.cos(angle), np.sin(angle)])


def _fitted(x, y, weight, frequencies) -> np.ndarray:
    return _least_squares(_columns(x, frequencies), y, weight)


def _least_squares(columns, y, weight) -> np.ndarray:
    return np.linalg.lstsq(columns * weight[:, None], y * weight, rcond=1e-13)[0]


def _refined(x, y, weight, frequencies) -> np.ndarray:
    """The frequencies after a few steps of Newton's method on the squares, each step at most a third of a period."""
    fit = _fitted(x, y, weight, frequencies)
    for _ in range(REFINED):
        columns = np.hstack([_columns(x, frequencies), _turned(x, frequencies, fit)])
        fit = _least_squares(columns, y, weight)
        frequencies = frequencies + np.clip(fit[-len(frequencies) :], -1 / 3, 1 / 3)
    return frequencies


def _turned(x, frequencies, fit) -> np.ndarray:
    """The derivatives of the fit by the frequencies, array (n, k)."""
    k = len(frequencies)
    angle = 2 * np.pi * np.outer(x, frequencies)
    return 2 * np.pi * x[:, None] * (np.cos(angle) * fit[2 + k : 2 + 2 * k] - np.sin(angle) * fit[2 : 2 + k])
