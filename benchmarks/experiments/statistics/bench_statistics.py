"""Checks of the statistics of chaotic orbits: runs of ensembles with small steps have the averages known exactly."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from phasebench.benchmarks.experiments.statistics import claims, measure

if TYPE_CHECKING:
    from phasebench.benchmarks.store.cells import Cell


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`) of all methods on all scenes (a statistic of an ensemble); none if ``quick``."""
    return measure.cells(quick)


def off(rows: list[dict]) -> list[str]:
    """Return a message for each ensemble whose average in a run with small steps differs from the exact one.

    The exact average is that over the surface of constant energy; `claims.SAME` standard errors are allowed.  ``rows``
    are those of the table of references, one for each scene (a statistic of an ensemble).
    """
    return [
        f"{r['scene']}: {r['mean']:.5g}, exactly {r['exact']:.5g}"
        for r in rows
        if r["known"] and not abs(r["mean"] - r["exact"]) <= claims.SAME * r["standard error"]
    ]


def bench_averages(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that ensembles on a surface of constant energy keep their averages in time, by Liouville's theorem.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    found = off(measured_rows(measure.EXACT))
    assert not found, "\n".join(found)
