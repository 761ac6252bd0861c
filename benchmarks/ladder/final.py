"""The number of rounds of a final, in which the best few integrators are timed in turns."""

from __future__ import annotations

from collections.abc import Iterable

from phasebench.benchmarks.measure.clock import LEAST


def rounds(seconds: Iterable[float], within: float, least: int, most: int) -> int:
    """Number of rounds, a run of each integrator of these ``seconds``, that fit into ``within`` seconds."""
    return int(min(most, max(least, within / sum(max(s, LEAST) for s in seconds))))
