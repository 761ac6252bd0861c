"""What the talks show and state, measured: figures are drawn and statements judged from these rows."""

from __future__ import annotations

from phasebench.benchmarks.experiments.talks.cells import cells  # noqa: F401
from phasebench.benchmarks.experiments.talks.checks import CHECKS
from phasebench.benchmarks.experiments.talks.checks_base import TABLE as CHECKED
from phasebench.benchmarks.experiments.talks.record import TABLE


def bench_talks(measured, complete):
    """Every figure has its curves: `measured` fails where one could not be measured."""
    assert measured(TABLE) or not complete(TABLE)


def bench_checks(measured, complete):
    """Every check of a statement is measured."""
    assert {r["check"] for r in measured(CHECKED)} == {c.id for c in CHECKS} or not complete(CHECKED)
