"""All cells of this experiment."""

from __future__ import annotations

from phasebench.benchmarks.rows.cells import Cell

from . import (
    brouwer,
    brouwer_every,
    brouwer_kepler,
    edge,
    encounters,
    linear,
    meetings,
    push,
    regions,
    resonances,
    springs,
    stiff,
)

PARTS = (
    brouwer,
    brouwer_every,
    brouwer_kepler,
    edge,
    regions,
    resonances,
    springs,
    encounters,
    meetings,
    stiff,
    push,
    linear,
)


def cells(quick: bool = False) -> list[Cell]:
    """The cells of every part."""
    return [cell for part in PARTS for cell in part.cells(quick)]
