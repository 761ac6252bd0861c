"""Every method on every problem, without round-off: the matrix of the report."""

from __future__ import annotations

from phasebench.benchmarks.experiments.matrix import matrix
from phasebench.benchmarks.experiments.matrix.matrix import cells  # noqa: F401


def bench_matrix(measured):
    """No cell is missing without a reason; none falls short of its declaration without an explanation."""
    rows = measured("matrix")
    for r in rows:
        assert r.get("reason") or all(k in r or f"{k}_reason" in r for k in matrix.MEASURED), r
    left = [
        f"{r['method']} on {r['problem']}: {c}"
        for r in rows
        for c in matrix.contradictions(r)
        if not matrix.explanation(r, c)
    ]
    assert not left, "\n".join(left)
