"""The talk's printed tables, entry by entry, and the column that does not reproduce."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.experiments.printed import printed, riddle
from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.problems import problem


@pytest.mark.parametrize("column", printed.PRINTED, ids=lambda c: f"{c[0]}{'' if c[1] is None else f'({c[1]})'}")
def bench_printed(column, results):
    """Every entry agrees to 0.6 of the last printed digit; Scheme IV is second order, as its theorem says."""
    rows = list(printed.measured(*column))
    results.add("printed", rows)
    if column == printed.RIDDLE:
        slope = metrics.power([r["h"] for r in rows], [r["refinement_difference"] for r in rows]).value
        assert abs(slope - 2) < 0.15, f"Scheme IV on the root nearest 1/2 has order {slope:.3f}"
        return
    off = [r for r in rows if r["units"] > printed.AGREEMENT]
    assert not off, "\n".join(
        f"h = {r['h']}: printed {r['printed']}, measured {r['refinement_difference']:.5E}" for r in off
    )


def bench_riddle(results, quick):
    """No branch of roots gives the printed Scheme IV column: every root of every step, by exhaustive scan."""
    found = problem("henon-heiles:chaotic")
    scans = [
        riddle.along(found, "scheme-iv", h, 1.0, spacing=0.1 if quick else 0.02)
        for h in printed.STEPS[: 2 if quick else 5]
    ]
    results.add("riddle", riddle.summary(scans))
    results.add(
        "riddle_roots",
        [{"h": s.h, "t": i * s.h, "lambda": lam} for s in scans for i, r in enumerate(s.roots) for lam in r[1:]],
    )
    results.add("riddle_columns", riddle.columns())
    for s in scans:
        assert all(len(r) and abs(r[0] - 0.5) < 0.1 for r in s.roots), "a step lost its root near 1/2"
