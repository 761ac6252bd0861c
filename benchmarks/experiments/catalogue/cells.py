"""Measurements (`Cell`) of the catalogue: tables of coefficients, this project's and transcribed ones."""

from __future__ import annotations

import hashlib

from phasebench.benchmarks.store.cells import UNCOMPILED, Cell, Rows, content
from phasebench.integrators.compile import digest as sources

from . import acta, coefficients, transcribed

TABLES = ("coefficients", "repairs", "loose_digits")

ACTA = "acta"
TRANSCRIBED = "transcribed"


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements to make (`Cell`) on coefficients and a survey's methods; none if ``quick``."""
    if quick:
        return []
    numbers = sorted((sources.ROOT / "integrators" / "coefficients").glob("*.json"))
    digests = [hashlib.sha256(p.read_bytes()).hexdigest() for p in numbers]
    made = [
        Cell("catalogue", TABLES, {}, measure_rows, (), content(*digests, code=[coefficients.__name__])),
        Cell("catalogue", (ACTA,), {}, listed_rows, (), content(*digests, code=[acta.__name__])),
        *map(_transcribed, transcribed.read()),
    ]
    return made


def _transcribed(table: transcribed.Transcribed) -> Cell:
    about = content(repr(table), code=[transcribed.__name__])
    key = {"package": table.package, "name": table.name}
    return Cell("catalogue", (TRANSCRIBED,), key, transcribed_row, (table.package, table.name), about, where=UNCOMPILED)


def transcribed_row(package: str, name: str) -> Rows:
    """Check a coefficient table of a package's source by order conditions and integrations: one row, by table name."""
    return {TRANSCRIBED: [transcribed.row(transcribed.find(package, name))]}


def measure_rows() -> Rows:
    """Check this project's coefficient tables: rows on orders, on repaired misprints, on wrong printed digits.

    Returns three tables: name -> rows.
    """
    frames = (coefficients.frame(), coefficients.repairs(), coefficients.loose())
    return {name: frame.to_dict("records") for name, frame in zip(TABLES, frames, strict=True)}


def listed_rows() -> Rows:
    """Make a row for each method in the Acta Numerica survey of splittings: its id, order, and right digits."""
    return {ACTA: acta.frame().to_dict("records")}
