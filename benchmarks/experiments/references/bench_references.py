"""The certified references measured again: a cell fails where what one states does not hold."""

from __future__ import annotations

from phasebench.benchmarks.experiments.references.cells import cells  # noqa: F401
from phasebench.benchmarks.experiments.references.odd import ODD, beyond


def bench_references(measured):
    """Every uncertainty bounds its error, every horizon is the problem's: `measured` fails where a cell did."""
    wrong = [f"{r['problem']}: {r['changed']}" for r in measured("references") if r["changed"]]
    assert not wrong, "\n".join(wrong)


def bench_odd_times(measured):
    """At no time of which no state is stored is what is told further off than its uncertainty."""
    wrong = beyond(measured(ODD))
    assert not wrong, "\n".join(wrong)
