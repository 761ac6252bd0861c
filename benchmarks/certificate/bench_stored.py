"""Rewrite `fronts.csv` and `times.csv`, the stored costs of known integrators with which certificates compare.

They are computed from the measurements of a run, if these are complete.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

from phasebench.benchmarks.certificate import fronts, times

if TYPE_CHECKING:
    from phasebench.benchmarks.store.run import Outcome

#: Names of tables of the trade (`studies.trade`): all runs, and the cheapest of each side.
RUNS, CHOICES = "front_rungs", "front"


def bench_fronts(outcome: Outcome, complete: Callable[[str], bool], update: bool) -> None:
    """Write `fronts.csv` and `times.csv`, the fewest evaluations and the least time known for a scene and error."""
    if not update or not complete(RUNS):
        pytest.skip("fronts and times are made with --update-tables where all of the trade is measured")
    fronts.TABLE.save(outcome.rows(RUNS))
    times.TABLE.save(outcome.rows(CHOICES), outcome.rows(RUNS))
