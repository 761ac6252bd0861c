"""All measurements (`Cell`) of the experiment on the methods' options."""

from __future__ import annotations

from phasebench.benchmarks.store.cells import Cell

from . import arithmetic, ladders, lambdas, nodes, solvers

PARTS = (lambdas, ladders, nodes, arithmetic, solvers)


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`) of every module of this experiment; none if ``quick``."""
    return [cell for part in PARTS for cell in part.cells(quick)]
