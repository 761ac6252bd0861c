"""Checks of the certified reference states: their stated errors and horizons are measured again."""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.references.cells import cells  # noqa: F401
from phasebench.benchmarks.experiments.references.odd import ODD, beyond


def bench_references(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that every stated uncertainty and horizon of the certified reference states is confirmed.

    A horizon is the time up to which a run rounded to long double stays close to the exact orbit.  ``measured_rows`` is
    a fixture: table name -> rows.
    """
    wrong = [f"{r['problem']}: {r['changed']}" for r in measured_rows("references") if r["changed"]]
    assert not wrong, "\n".join(wrong)


def bench_odd_times(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that no reference state at a time between the stored ones has an error above its uncertainty.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = beyond(measured_rows(ODD))
    assert not wrong, "\n".join(wrong)
