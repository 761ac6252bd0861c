"""The number of rounds of a final, in which the best few integrators are timed in turns."""

from __future__ import annotations

from collections.abc import Iterable

from phasebench.benchmarks.measure.clock import LEAST


def rounds(seconds: Iterable[float], within: float, least: int, most: int) -> int:
    """Number of rounds, each of which runs every integrator once, that fit into ``within`` seconds.

    ``seconds`` are the times of one run of each integrator; the number is kept between ``least`` and ``most``.
    """
    return int(min(most, max(least, within / sum(max(s, LEAST) for s in seconds))))
