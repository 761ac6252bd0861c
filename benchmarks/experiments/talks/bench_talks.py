"""The curves of the talks' figures, measured: the figures are drawn from these rows."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.experiments.talks.gallery import FIGURES
from phasebench.benchmarks.experiments.talks.record import TABLE


@pytest.mark.parametrize("figure", [f for f in FIGURES if f.measure], ids=lambda f: f.id)
def bench_talk(figure, results, quick):
    """Measure the curves of a figure."""
    rows = figure.rows(quick)
    assert rows
    results.add(TABLE, rows)
