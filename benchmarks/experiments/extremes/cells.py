"""All measurements (`Cell`) of the experiment on limits: stability, long times, close encounters, stiffness."""

from __future__ import annotations

from phasebench.benchmarks.store.cells import Cell

from . import (
    brouwer,
    brouwer_every,
    brouwer_kepler,
    edge,
    encounters,
    linear,
    push,
    regions,
    resonances,
    stiff,
)

PARTS = (
    brouwer,
    brouwer_every,
    brouwer_kepler,
    edge,
    regions,
    resonances,
    encounters,
    stiff,
    push,
    linear,
)


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`) of all modules of this experiment; none if ``quick``."""
    return [cell for part in PARTS for cell in part.cells(quick)]
