"""Check that the measured properties of every method on every problem agree with the declared ones."""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.matrix import matrix
from phasebench.benchmarks.experiments.matrix.matrix import cells  # noqa: F401


def bench_matrix(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that every measurement exists or has a reason, and that every contradiction with a declaration is explained.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    rows = measured_rows("matrix")
    for r in rows:
        assert r.get("reason") or all(k in r or f"{k}_reason" in r for k in matrix.MEASURED), r
    left = [
        f"{r['method']} on {r['problem']}: {c}"
        for r in rows
        for c in matrix.contradictions(r)
        if not matrix.explanation(r, c)
    ]
    assert not left, "\n".join(left)
