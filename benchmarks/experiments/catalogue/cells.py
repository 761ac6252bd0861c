"""The tables of coefficients as a cell: they are computed from their numbers alone."""

from __future__ import annotations

import hashlib

from phasebench.benchmarks.rows import sources
from phasebench.benchmarks.rows.cells import Cell, Rows, content

from . import coefficients

TABLES = ("coefficients", "repairs", "loose_digits")


def cells(quick: bool = False) -> list[Cell]:
    """One cell; none of the quick tier."""
    if quick:
        return []
    numbers = sorted((sources.ROOT / "integrators" / "coefficients").glob("*.json"))
    digests = [hashlib.sha256(p.read_bytes()).hexdigest() for p in numbers]
    return [Cell("catalogue", TABLES, {}, measured, (), content(*digests, code=[coefficients.__name__]))]


def measured() -> Rows:
    """The rows of the three tables."""
    frames = (coefficients.frame(), coefficients.repairs(), coefficients.loose())
    return {name: frame.to_dict("records") for name, frame in zip(TABLES, frames, strict=True)}
