"""Measure the rows from which the talks' figures are drawn and their statements are judged."""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.talks.cells import cells  # noqa: F401
from phasebench.benchmarks.experiments.talks.checks import CHECKS
from phasebench.benchmarks.experiments.talks.checks_base import TABLE as CHECKED
from phasebench.benchmarks.experiments.talks.record import TABLE


def bench_talks(measured_rows: Callable[[str], list[dict]], complete: Callable[[str], bool]) -> None:
    """Check that the curves of the talks' figures were measured.

    ``measured_rows`` (table -> rows) fails if a measurement failed; ``complete`` tells whether a table is complete.
    """
    assert measured_rows(TABLE) or not complete(TABLE)


def bench_checks(measured_rows: Callable[[str], list[dict]], complete: Callable[[str], bool]) -> None:
    """Check that every small measurement that tests a statement of the talks has a row in its table.

    ``measured_rows`` maps a table's name to its rows; ``complete`` tells whether a table is complete.
    """
    assert {r["check"] for r in measured_rows(CHECKED)} == {c.id for c in CHECKS} or not complete(CHECKED)
