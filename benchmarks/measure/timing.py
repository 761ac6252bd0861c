"""Times that can be compared: warm, interleaved, medians with intervals, ratios round by round; and who is the cheaper.

The interval of a median is that of order statistics: of n independent rounds the k-th smallest and the k-th largest
enclose the median with the probability 1 - 2 P(B < k), B binomial of n throws of a coin, whatever the distribution
(H. A. David, H. N. Nagaraja, Order Statistics (2003), 7.1).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Iterable, Mapping
from fractions import Fraction
from functools import cache
from math import inf, isinf, nan
from typing import Any, NamedTuple

import numpy as np

#: How often a median is in its interval, at least, where the rounds are enough (six).
CONFIDENCE = 0.95
#: What a comparison of two costs can say.
OURS, PEERS, TIED, OPEN, NONE = "ours", "peer", "tie", "not decided", "none"


class Median(NamedTuple):
    """The median of rounds and its interval, in which it is `CONFIDENCE` of the time; of a few rounds their range."""

    value: float
    low: float
    high: float


#: What nothing reaches.
NOWHERE = Median(inf, inf, inf)


@cache
def rank(n: int, confidence: float = CONFIDENCE) -> int:
    """The largest k for which the k-th smallest and largest of n enclose the median that often; 1 where none does."""
    below, ways, k = 0, 1, 0
    most = int(Fraction(1 - confidence) / 2 * 2**n)
    while k < n and below + ways <= most:
        below += ways
        ways = ways * (n - k) // (k + 1)
        k += 1
    return max(k, 1)


def median(samples: Iterable[float]) -> Median:
    """The median of samples with its interval; NaN for none."""
    ordered = sorted(map(float, samples))
    if not ordered:
        return Median(nan, nan, nan)
    k = rank(len(ordered))
    return Median(float(np.median(ordered)), ordered[k - 1], ordered[-k])


def in_turns(work: Mapping[Hashable, Callable[[], float]], rounds: int = 15) -> dict[Any, np.ndarray]:
    """The seconds that each callable tells in every round; the first round is not counted, the order alternates."""
    seconds: dict[Hashable, list[float]] = {n: [] for n in work}
    for k in range(rounds + 1):
        for name in work if k % 2 else reversed(work):
            elapsed = work[name]()
            if k:
                seconds[name].append(elapsed)
    return {n: np.array(s) for n, s in seconds.items()}


def interleaved(work: Mapping[Hashable, Callable[[], object]], rounds: int = 15) -> dict[Any, np.ndarray]:
    """Seconds of each callable in every round, as `in_turns`."""

    def clocked(run):
        def seconds() -> float:
            started = time.perf_counter()
            run()
            return time.perf_counter() - started

        return seconds

    return in_turns({n: clocked(run) for n, run in work.items()}, rounds)


def ratio(a: np.ndarray, b: np.ndarray) -> Median:
    """How many times as long a took as b, round by round."""
    return median(np.asarray(a) / np.asarray(b))


def cheaper(ours: Median, peers: Median, tie: float = 1.0) -> str:
    """Whose cost is less: of the side whose whole interval, widened by a factor ``tie``, is below the other's.

    An infinite ``low`` is a side that does not get there, an infinite ``high`` one of which that is not certain.
    """
    if isinf(ours.low) and isinf(peers.low):
        return NONE
    if ours.high * tie < peers.low:
        return OURS
    return PEERS if peers.high * tie < ours.low else TIED
