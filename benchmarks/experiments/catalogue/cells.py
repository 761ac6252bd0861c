"""The tables of coefficients, computed from their numbers alone, what is installed, and the score of mutants, as cells."""

from __future__ import annotations

import hashlib

from phasebench.benchmarks.rows import sources
from phasebench.benchmarks.rows.cells import Cell, Rows, content

from . import coefficients, dependencies, mutation

TABLES = ("coefficients", "repairs", "loose_digits")

INSTALLED = "dependencies"
MUTANTS = "mutation"


def cells(quick: bool = False) -> list[Cell]:
    """Three cells, two where the suite's own tests are not there; none of the quick tier."""
    if quick:
        return []
    numbers = sorted((sources.ROOT / "integrators" / "coefficients").glob("*.json"))
    digests = [hashlib.sha256(p.read_bytes()).hexdigest() for p in numbers]
    wanted = (sources.ROOT / "pyproject.toml").read_text()
    made = [
        Cell("catalogue", TABLES, {}, measured, (), content(*digests, code=[coefficients.__name__])),
        Cell("catalogue", (INSTALLED,), {}, installed, (), content(wanted, code=[dependencies.__name__]), own=True),
    ]
    if mutation.SCORE.is_file():
        about = content(*mutation.digests(), code=[mutation.__name__])
        made.append(Cell("catalogue", (MUTANTS,), {}, tried, (), about))
    return made


def measured() -> Rows:
    """The rows of the three tables."""
    frames = (coefficients.frame(), coefficients.repairs(), coefficients.loose())
    return {name: frame.to_dict("records") for name, frame in zip(TABLES, frames, strict=True)}


def installed() -> Rows:
    """The rows of what is installed."""
    return {INSTALLED: dependencies.frame()}


def tried() -> Rows:
    """The rows of the files that were changed."""
    return {MUTANTS: mutation.frame()}
