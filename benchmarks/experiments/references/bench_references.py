"""The certified references computed anew: a cell fails where a stored state moved or solvers disagree."""

from __future__ import annotations

from phasebench.benchmarks.experiments.references.cells import cells  # noqa: F401


def bench_references(measured):
    """Nothing moved beyond its uncertainty, and every solver agrees: `measured` fails where a cell did."""
    wrong = [f"{r['problem']}: {r['changed']}" for r in measured("references") if r["changed"]]
    assert not wrong, "\n".join(wrong)
