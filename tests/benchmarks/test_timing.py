"""Intervals of medians hold the true median as often as they say, and of two costs the cheaper one is named."""

from __future__ import annotations

from math import inf, isnan

import numpy as np
import pytest

from phasebench.benchmarks.measure import timing
from phasebench.benchmarks.measure.timing import NONE, NOWHERE, OURS, PEERS, TIED, Median


@pytest.mark.parametrize("n", [6, 9, 11, 15, 21])
def test_interval_covers_the_median_of_skewed_times(n):
    """Times are bounded below and have a long tail; a narrower interval would not cover."""
    draws = 1 + np.random.default_rng(n).exponential(size=(20_000, n))
    found = [timing.median(row) for row in draws]
    true = 1 + np.log(2)
    covered = np.mean([m.low <= true <= m.high for m in found])
    assert covered + 0.005 >= 0.95
    assert covered <= 0.995
    k = timing.rank(n)
    inner = np.sort(draws, axis=1)[:, [k, -k - 1]]
    assert np.mean((inner[:, 0] <= true) & (true <= inner[:, 1])) < 0.95


def test_ranks_agree_with_published_tables():
    """David & Nagaraja; the sign test's critical values at 5 %, two-sided."""
    assert [timing.rank(n) for n in (3, 5, 6, 8, 9, 11, 12, 15, 20, 21, 25)] == [1, 1, 1, 1, 2, 2, 3, 4, 6, 6, 8]
    assert timing.rank(40_001) == 19_805  # n/2 - 0.98 sqrt(n), computed exactly and fast


def test_median_is_neither_the_minimum_nor_the_mean():
    assert timing.median([5.0, 1.0, 2.0]) == (2.0, 1.0, 5.0)
    assert timing.median(range(1, 12)) == (6.0, 2.0, 10.0)
    assert all(isnan(x) for x in timing.median([]))


ONE, TWO, WIDE = Median(1.0, 0.9, 1.1), Median(2.0, 1.9, 2.1), Median(2.0, 1.05, 3.0)


@pytest.mark.parametrize(
    ("ours", "peers", "said"),
    [
        (ONE, TWO, OURS),
        (TWO, ONE, PEERS),
        (ONE, ONE, TIED),
        (ONE, WIDE, TIED),
        (WIDE, ONE, TIED),
        (ONE, NOWHERE, OURS),
        (NOWHERE, ONE, PEERS),
        (NOWHERE, NOWHERE, NONE),
        # The accuracy is reached only perhaps.
        (Median(1.0, 0.9, inf), TWO, TIED),
        (Median(1.0, 0.9, inf), NOWHERE, TIED),
        (Median(3.0, 2.9, inf), TWO, PEERS),
        (NOWHERE, Median(1.0, 0.9, inf), TIED),
    ],
)
def test_cheaper_of_two_costs(ours, peers, said):
    assert timing.cheaper(ours, peers) == said


def test_factor_makes_ties():
    assert timing.cheaper(ONE, TWO, 1.7) == OURS
    assert timing.cheaper(ONE, TWO, 1.75) == TIED
    assert timing.cheaper(TWO, ONE, 1.7) == PEERS
    assert timing.cheaper(TWO, ONE, 1.75) == TIED
