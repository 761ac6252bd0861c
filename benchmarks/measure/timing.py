"""Times that can be compared: warm, interleaved, medians, and ratios taken round by round in one run."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Ratio:
    """The median of a / b over rounds, and the quartiles of the rounds."""

    value: float
    low: float
    high: float


def interleaved(work: Mapping[str, Callable[[], object]], rounds: int = 15) -> dict[str, np.ndarray]:
    """Seconds of each callable in every round; the first round is not counted, the order alternates."""
    names = list(work)
    seconds: dict[str, list[float]] = {n: [] for n in names}
    for k in range(rounds + 1):
        for name in names if k % 2 else reversed(names):
            started = time.perf_counter()
            work[name]()
            elapsed = time.perf_counter() - started
            if k:
                seconds[name].append(elapsed)
    return {n: np.array(s) for n, s in seconds.items()}


def ratio(a: np.ndarray, b: np.ndarray) -> Ratio:
    """How many times as long a took as b, round by round."""
    r = np.asarray(a) / np.asarray(b)
    return Ratio(float(np.median(r)), float(np.quantile(r, 0.25)), float(np.quantile(r, 0.75)))
