"""A seeded sample of what has not changed, measured again, is what is stored."""

from __future__ import annotations

from phasebench.benchmarks.rows import compare


def bench_sample(outcome):
    """Nothing left its band; a number that did is named with the row, both numbers and their ratio."""
    wrong = compare.sampled(outcome)
    assert not wrong, "\n".join(map(str, wrong))
