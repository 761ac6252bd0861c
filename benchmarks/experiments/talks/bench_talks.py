"""Measure the rows from which the talks' figures are drawn and their statements are judged."""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.talks.cells import cells  # noqa: F401
from phasebench.benchmarks.experiments.talks.checks import CHECKS
from phasebench.benchmarks.experiments.talks.checks_base import TABLE as CHECKED
from phasebench.benchmarks.experiments.talks.record import TABLE


def bench_talks(measured_rows: Callable[[str], list[dict]], complete: Callable[[str], bool]) -> None:
    """Check that the curves of the talks' figures were measured.

    ``measured_rows`` and ``complete`` are fixtures: table name -> its rows, and table name -> whether this run measured
    all of them.  If it did not, the check passes whatever the rows are.
    """
    assert measured_rows(TABLE) or not complete(TABLE)


def bench_checks(measured_rows: Callable[[str], list[dict]], complete: Callable[[str], bool]) -> None:
    """Check that every small measurement that tests a statement of the talks has a row in its table.

    ``measured_rows`` and ``complete`` are fixtures: table name -> its rows, and table name -> whether this run measured
    all of them.  If it did not, the check passes whatever the rows are.
    """
    assert {r["check"] for r in measured_rows(CHECKED)} == {c.id for c in CHECKS} or not complete(CHECKED)
