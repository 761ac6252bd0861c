"""All cells of this experiment."""

from __future__ import annotations

from phasebench.benchmarks.store.cells import Cell

from . import arithmetic, ladders, lambdas, nodes, solvers

PARTS = (lambdas, ladders, nodes, arithmetic, solvers)


def cells(quick: bool = False) -> list[Cell]:
    """The cells of every part; no cell if ``quick``."""
    return [cell for part in PARTS for cell in part.cells(quick)]
