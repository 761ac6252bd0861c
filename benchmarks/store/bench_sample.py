"""Measures a random sample of unchanged cells again and compares it with the stored rows."""

from __future__ import annotations

from phasebench.benchmarks.store import compare


def bench_sample(outcome):
    """No sampled number leaves its band; a failure names the row, both numbers and their ratio."""
    wrong = compare.of_sample(outcome)
    assert not wrong, "\n".join(map(str, wrong))
