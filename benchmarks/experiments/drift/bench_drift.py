"""The 95 % interval of a drift covers the true drift about as often as it should, where the oscillation is resolved."""

from __future__ import annotations

from phasebench.benchmarks.experiments.drift.coverage import cells  # noqa: F401
from phasebench.benchmarks.experiments.drift.page import LEAST, is_resolved


def off(rows) -> list[str]:
    """A line for each kind of series whose oscillation is resolved but whose intervals cover too seldom."""
    return [
        f"{r['kind']}, {r['periods']:g} periods in {r['points']} points: covered in {r['covered']:.3f}"
        for r in rows
        if is_resolved(r["periods"]) and not r["covered"] >= LEAST
    ]


def bench_coverage(measured_rows):
    """The intervals of every resolved kind of series cover the true drift often enough."""
    wrong = off(measured_rows("drift_coverage"))
    assert not wrong, "\n".join(wrong)
