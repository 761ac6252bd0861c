"""Comparable times of several programs, measured in alternation after a warm-up; medians with intervals, and ratios.

The interval of a median is that of order statistics: the k-th smallest and the k-th largest of n independent rounds
enclose the median with probability 1 - 2 P(B < k), B binomial for n fair coin tosses, whatever the distribution (H. A.
David, H. N. Nagaraja, Order Statistics (2003), 7.1).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Iterable, Mapping
from fractions import Fraction
from functools import cache
from math import inf, isinf, nan
from typing import Any, NamedTuple

import numpy as np

#: Least probability with which the interval contains the median; it needs at least six rounds.
CONFIDENCE = 0.95
#: Outcomes of a comparison of two costs.
OURS, PEERS, TIED, OPEN, NONE = "ours", "peer", "tie", "not decided", "none"


class Median(NamedTuple):
    """A median with its interval of probability `CONFIDENCE`; for fewer than six samples their range."""

    value: float
    low: float
    high: float


#: The cost of an error that is never met.
NOWHERE = Median(inf, inf, inf)


@cache
def rank(n: int, confidence: float = CONFIDENCE) -> int:
    """Return the largest k for which the k-th smallest and k-th largest of n samples enclose the median, at least 1."""
    below, ways, k = 0, 1, 0
    most = int(Fraction(1 - confidence) / 2 * 2**n)
    while k < n and below + ways <= most:
        below += ways
        ways = ways * (n - k) // (k + 1)
        k += 1
    return max(k, 1)


def median(samples: Iterable[float]) -> Median:
    """Return the median of samples with its interval; all NaN if there are no samples."""
    ordered = sorted(map(float, samples))
    if not ordered:
        return Median(nan, nan, nan)
    k = rank(len(ordered))
    return Median(float(np.median(ordered)), ordered[k - 1], ordered[-k])


def in_turns(work: Mapping[Hashable, Callable[[], float]], rounds: int = 15) -> dict[Any, np.ndarray]:
    """Call several callables once a round; return name -> array (rounds,) of the seconds that each returned.

    The order of the calls alternates from round to round; a first round is not counted.
    """
    seconds: dict[Hashable, list[float]] = {n: [] for n in work}
    for k in range(rounds + 1):
        for name in work if k % 2 else reversed(work):
            elapsed = work[name]()
            if k:
                seconds[name].append(elapsed)
    return {n: np.array(s) for n, s in seconds.items()}


def time_in_turns(work: Mapping[Hashable, Callable[[], object]], rounds: int = 15) -> dict[Any, np.ndarray]:
    """Measure the seconds of callables as `in_turns`: name -> array (rounds,)."""
    return in_turns({n: clock(run) for n, run in work.items()}, rounds)


def clock(run: Callable[[], object]) -> Callable[[], float]:
    """A function that calls ``run`` and returns the seconds that this takes."""

    def seconds() -> float:
        started = time.perf_counter()
        run()
        return time.perf_counter() - started

    return seconds


def ratio(a: np.ndarray, b: np.ndarray) -> Median:
    """Return the median, with its interval, of the ratios a / b of times measured in the same rounds, arrays (n,)."""
    return median(np.asarray(a) / np.asarray(b))


def columns(name: str, found: Median) -> dict[str, float]:
    """A median and its interval as columns of a row."""
    return {name: found.value, f"{name}, low": found.low, f"{name}, high": found.high}


def cheaper(ours: Median, peers: Median, tie: float = 1.0) -> str:
    """Return which is cheaper, "ours" or "peer", from the least cost of each at the same error.

    It is "tie" unless the whole interval of one, widened by the factor ``tie``, is below the other's; "none" if neither
    reaches the error.  A cost has ``low`` infinite if that is never reached, ``high`` infinite if that is not certain.
    """
    if isinf(ours.low) and isinf(peers.low):
        return NONE
    if ours.high * tie < peers.low:
        return OURS
    return PEERS if peers.high * tie < ours.low else TIED
