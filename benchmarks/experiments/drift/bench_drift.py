"""Check that the 95 % interval of an estimated drift covers the true drift of artificial series often enough.

Only series with enough periods of their oscillation to tell it from a drift are checked.
"""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.drift.coverage import cells  # noqa: F401
from phasebench.benchmarks.experiments.drift.page import LEAST, is_resolved


def off(rows: list[dict]) -> list[str]:
    """List a line for each kind of series whose 95 % intervals miss the true drift too often.

    ``rows`` are those of the table "drift_coverage".  Series count if their oscillation is resolved, that is, has
    enough periods to be told from a drift.
    """
    return [
        f"{r['kind']}, {r['periods']:g} periods in {r['points']} points: covered in {r['covered']:.3f}"
        for r in rows
        if is_resolved(r["periods"]) and not r["covered"] >= LEAST
    ]


def bench_coverage(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that drift intervals cover the true drift often enough for every series with a resolved oscillation.

    An oscillation is resolved if it has enough periods to be told from a drift.  ``measured_rows`` is a fixture: table
    name -> rows.
    """
    wrong = off(measured_rows("drift_coverage"))
    assert not wrong, "\n".join(wrong)
