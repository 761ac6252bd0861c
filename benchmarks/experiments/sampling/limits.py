"""Stability limits of h omega, of splittings for sampling and of force-gradient methods, beside the printed ones."""

from __future__ import annotations

from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.oscillator import find
from phasebench.benchmarks.store.cells import Cell, Rows, content
from phasebench.integrators.registry import BY_ID

from .acceptance import EVALUATIONS

TABLE = "sampling_limits"
#: Method -> the limit of h omega as printed by Blanes, Casas and Sanz-Serna 2014.
PRINTED = {"blanes-casas-sanz-serna-3": "4.67", "blanes-casas-sanz-serna-4": "5.35"}


def agrees(limit: float, printed: str) -> bool:
    """Return whether a measured stability limit, rounded to the digits of the printed one (a text), equals it."""
    return f"{limit:.{len(printed.partition('.')[2])}f}" == printed


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each method; none if ``quick``."""
    return [] if quick else [_cell(method) for method in EVALUATIONS]


def _cell(method: str) -> Cell:
    return Cell(
        "sampling",
        (TABLE,),
        {"method": method},
        measure_rows,
        (method,),
        content("limit", BY_ID[method], PRINTED.get(method, ""), code=[__name__]),
        frozenset({method}),
    )


def measure_rows(method: str) -> Rows:
    """Measure the stability limit of a method on the harmonic oscillator: one row, by table name.

    The limit is the end of the first interval of stable h omega.  The row has it, the same divided by the gradient
    evaluations of a step, and the printed limit ("" if there is none).
    """
    limit, each = find(integrator(method)).limit, EVALUATIONS[method]
    row = {"method": method, "evaluations per step": each, "limit": limit, "limit per evaluation": limit / each}
    return {TABLE: [row | {"printed": PRINTED.get(method, "")}]}
