"""Measurements (`Cell`) of the catalogue: tables of coefficients, installed dependencies, scores of mutation tests."""

from __future__ import annotations

import hashlib

from phasebench.benchmarks.store.cells import UNCOMPILED, Cell, Rows, content
from phasebench.integrators.compile import digest as sources

from . import acta, coefficients, dependencies, mutation, transcribed

TABLES = ("coefficients", "repairs", "loose_digits")

INSTALLED = "dependencies"
MUTANTS = "mutation"
ACTA = "acta"
TRANSCRIBED = "transcribed"


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements to make (`Cell`) on coefficients, a survey's methods, dependencies and mutation tests.

    Scores of mutation tests are included only if the tests were run.  The list is empty if ``quick``.
    """
    if quick:
        return []
    numbers = sorted((sources.ROOT / "integrators" / "coefficients").glob("*.json"))
    digests = [hashlib.sha256(p.read_bytes()).hexdigest() for p in numbers]
    wanted = (sources.ROOT / "pyproject.toml").read_text()
    made = [
        Cell("catalogue", TABLES, {}, measure_rows, (), content(*digests, code=[coefficients.__name__])),
        Cell("catalogue", (ACTA,), {}, listed_rows, (), content(*digests, code=[acta.__name__])),
        *map(_transcribed, transcribed.read()),
        Cell(
            "catalogue", (INSTALLED,), {}, dependency_rows, (), content(wanted, code=[dependencies.__name__]), own=True
        ),
    ]
    if mutation.SCORE.is_file():
        about = content(*mutation.digests(), code=[mutation.__name__])
        made.append(Cell("catalogue", (MUTANTS,), {}, mutation_rows, (), about))
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


def dependency_rows() -> Rows:
    """Make a row for each installed package that phasebench needs, with licence and size."""
    return {INSTALLED: dependencies.frame()}


def mutation_rows() -> Rows:
    """Make a row for each source file with its score in the mutation tests (how many faults the tests notice)."""
    return {MUTANTS: mutation.frame()}
