"""Checks of the certified references: their stated errors and horizons are measured again."""

from __future__ import annotations

from phasebench.benchmarks.experiments.references.cells import cells  # noqa: F401
from phasebench.benchmarks.experiments.references.odd import ODD, beyond


def bench_references(measured_rows):
    """Every stated uncertainty and horizon of the reference states is confirmed (each measurement asserts its own)."""
    wrong = [f"{r['problem']}: {r['changed']}" for r in measured_rows("references") if r["changed"]]
    assert not wrong, "\n".join(wrong)


def bench_odd_times(measured_rows):
    """No reference state between the stored times has an error above its uncertainty."""
    wrong = beyond(measured_rows(ODD))
    assert not wrong, "\n".join(wrong)
