"""Check of the measurements on molecules: this suite's RATTLE keeps a rigid water's invariants to round-off."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from phasebench.benchmarks.experiments.molecules import argon, page, water

if TYPE_CHECKING:
    from phasebench.benchmarks.store.cells import Cell


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`) on the argon atoms and on the water; none if ``quick``."""
    return [*argon.cells(quick), *water.cells(quick)]


def bench_rattle(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that this suite's RATTLE keeps distances, energy and angular momentum of the water to round-off.

    The problem itself is then sound.  ``measured_rows`` is a fixture: table name -> rows.
    """
    own = [r for r in measured_rows(water.TABLE) if r["package"] == page.OURS]
    off = [r for r in own if not max(r["distances"], abs(r["energy drift"]), r["angular momentum"]) < page.ROUND_OFF]
    assert not off, str(off)
