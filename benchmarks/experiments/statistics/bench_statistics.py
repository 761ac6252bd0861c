"""Checks of the statistics: fine runs of the ensembles have the averages that are known exactly."""

from __future__ import annotations

from phasebench.benchmarks.experiments.statistics import claims, measure


def cells(quick: bool = False):
    """List the measurements (`Cell`) of all scenes and methods; none if ``quick``."""
    return measure.cells(quick)


def off(rows) -> list[str]:
    """Messages about ensembles whose fine run has another average than the surface of constant energy."""
    return [
        f"{r['scene']}: {r['mean']:.5g}, exactly {r['exact']:.5g}"
        for r in rows
        if r["known"] and not abs(r["mean"] - r["exact"]) <= claims.SAME * r["standard error"]
    ]


def bench_averages(measured_rows):
    """Liouville's theorem: an ensemble on the surface of constant energy keeps its averages."""
    found = off(measured_rows(measure.EXACT))
    assert not found, "\n".join(found)
