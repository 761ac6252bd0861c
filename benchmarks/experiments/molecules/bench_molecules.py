"""Checks of the molecules: this suite's RATTLE keeps a rigid water's distances and momenta to round-off."""

from __future__ import annotations

from phasebench.benchmarks.experiments.molecules import argon, page, water


def cells(quick: bool = False):
    """List the measurements (`Cell`) of the atoms and of the water; none if ``quick``."""
    return [*argon.cells(quick), *water.cells(quick)]


def bench_rattle(measured_rows):
    """This suite's RATTLE keeps distances and momenta to round-off: the scene itself is sound."""
    own = [r for r in measured_rows(water.TABLE) if r["package"] == page.OURS]
    off = [r for r in own if not max(r["distances"], abs(r["energy drift"]), r["angular momentum"]) < page.ROUND_OFF]
    assert not off, str(off)
