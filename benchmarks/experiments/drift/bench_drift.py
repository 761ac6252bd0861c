"""The 95 % interval of a drift covers it in 90 to 99 of 100 series whose oscillation it resolves."""

from __future__ import annotations

from phasebench.benchmarks.experiments.drift.coverage import cells  # noqa: F401
from phasebench.benchmarks.experiments.drift.page import LEAST, resolved


def off(rows) -> list[str]:
    """The rows whose oscillation is resolved, and whose interval covers too seldom."""
    return [
        f"{r['kind']}, {r['periods']:g} periods in {r['points']} points: covered in {r['covered']:.3f}"
        for r in rows
        if resolved(r["periods"]) and not r["covered"] >= LEAST
    ]


def bench_coverage(measured):
    """No kind of series is covered too seldom."""
    wrong = off(measured("drift_coverage"))
    assert not wrong, "\n".join(wrong)
