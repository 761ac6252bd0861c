"""The curves of the talks' figures, measured: the figures are drawn from these rows."""

from __future__ import annotations

from phasebench.benchmarks.experiments.talks.cells import cells  # noqa: F401
from phasebench.benchmarks.experiments.talks.record import TABLE


def bench_talks(measured, complete):
    """Every figure has its curves: `measured` fails where one could not be measured."""
    assert measured(TABLE) or not complete(TABLE)
