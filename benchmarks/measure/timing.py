"""Comparable times: warm, interleaved, as medians with intervals and ratios per round; and which side is cheaper.

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
    """A median with its interval of probability `CONFIDENCE`; for few rounds the interval is their range."""

    value: float
    low: float
    high: float


#: The cost of an error that is never met.
NOWHERE = Median(inf, inf, inf)


@cache
def rank(n: int, confidence: float = CONFIDENCE) -> int:
    """The largest k with which the k-th smallest and largest of n enclose the median with probability ``confidence``.

    At least 1.
    """
    below, ways, k = 0, 1, 0
    most = int(Fraction(1 - confidence) / 2 * 2**n)
    while k < n and below + ways <= most:
        below += ways
        ways = ways * (n - k) // (k + 1)
        k += 1
    return max(k, 1)


def median(samples: Iterable[float]) -> Median:
    """The median of samples with its interval; NaN if there are none."""
    ordered = sorted(map(float, samples))
    if not ordered:
        return Median(nan, nan, nan)
    k = rank(len(ordered))
    return Median(float(np.median(ordered)), ordered[k - 1], ordered[-k])


def in_turns(work: Mapping[Hashable, Callable[[], float]], rounds: int = 15) -> dict[Any, np.ndarray]:
    """Call each callable once a round; the seconds that it returns in each round, without a first one, by name.

    The order of the calls alternates from round to round.
    """
    seconds: dict[Hashable, list[float]] = {n: [] for n in work}
    for k in range(rounds + 1):
        for name in work if k % 2 else reversed(work):
            elapsed = work[name]()
            if k:
                seconds[name].append(elapsed)
    return {n: np.array(s) for n, s in seconds.items()}


def time_in_turns(work: Mapping[Hashable, Callable[[], object]], rounds: int = 15) -> dict[Any, np.ndarray]:
    """Measure the seconds that each callable takes in each of several rounds, in which they run alternately."""

    def clock(run):
        def seconds() -> float:
            started = time.perf_counter()
            run()
            return time.perf_counter() - started

        return seconds

    return in_turns({n: clock(run) for n, run in work.items()}, rounds)


def ratio(a: np.ndarray, b: np.ndarray) -> Median:
    """The median, with interval, of the ratios a / b of times measured in the same round."""
    return median(np.asarray(a) / np.asarray(b))


def cheaper(ours: Median, peers: Median, tie: float = 1.0) -> str:
    """The cheaper side: the one whose whole interval, widened by the factor ``tie``, is below the other's; else a tie.

    ``low`` is infinite for a side that never meets the error, ``high`` for one that may not meet it.
    """
    if isinf(ours.low) and isinf(peers.low):
        return NONE
    if ours.high * tie < peers.low:
        return OURS
    return PEERS if peers.high * tie < ours.low else TIED
