"""Check a random sample of unchanged cells (single measurements), measured again, against their stored rows."""

from __future__ import annotations

from typing import Any

from phasebench.benchmarks.store import compare


def bench_sample(outcome: Any) -> None:
    """A random sample of numbers, measured again, agrees with the stored ones within their tolerances."""
    wrong = compare.of_sample(outcome)
    assert not wrong, "\n".join(map(str, wrong))
