"""Measures a random sample of unchanged cells again and compares it with the stored rows."""

from __future__ import annotations

from phasebench.benchmarks.store import compare


def bench_sample(outcome):
    """Check that re-measured numbers are within their tolerance of the stored ones; a failure names row and numbers."""
    wrong = compare.of_sample(outcome)
    assert not wrong, "\n".join(map(str, wrong))
