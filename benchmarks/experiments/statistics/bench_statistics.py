"""Checks of the statistics of chaotic orbits: runs of ensembles with small steps have the averages known exactly."""

from __future__ import annotations

from phasebench.benchmarks.experiments.statistics import claims, measure


def cells(quick: bool = False):
    """List the measurements (`Cell`) of all methods on all scenes (a statistic of an ensemble); none if ``quick``."""
    return measure.cells(quick)


def off(rows) -> list[str]:
    """Return a message for each ensemble whose average in a run with small steps differs from the exact one.

    The exact average is that over the surface of constant energy; `claims.SAME` standard errors are allowed.
    """
    return [
        f"{r['scene']}: {r['mean']:.5g}, exactly {r['exact']:.5g}"
        for r in rows
        if r["known"] and not abs(r["mean"] - r["exact"]) <= claims.SAME * r["standard error"]
    ]


def bench_averages(measured_rows):
    """Check that ensembles on a surface of constant energy keep their averages in time, by Liouville's theorem."""
    found = off(measured_rows(measure.EXACT))
    assert not found, "\n".join(found)
