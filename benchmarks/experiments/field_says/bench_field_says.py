"""Checks of the field's statements: the rows they stand on are sound."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from phasebench.benchmarks.experiments.field_says import cost, encounters, energy, growth, orders

if TYPE_CHECKING:
    from phasebench.benchmarks.store.cells import Cell

#: Largest uncertainty of a reference state.
UNCERTAIN = 1e-11


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`) of all statements; none if ``quick``."""
    return [cell for part in (growth, cost, orders, energy, encounters) for cell in part.cells(quick)]


def unsound(rows: list[dict]) -> list[str]:
    """Messages about references that are not far more exact than what is asked for."""
    return [f"{r['problem']}: {r['uncertainty']:.1e}" for r in rows if not r["uncertainty"] < UNCERTAIN]


def bench_references(measured_rows: Callable[[str], list[dict]]) -> None:
    """The reference states are known far better than the smallest error that is asked for."""
    off = unsound(measured_rows(cost.TABLE))
    assert not off, "\n".join(off)


def bench_growth(measured_rows: Callable[[str], list[dict]]) -> None:
    """The control, a method that is not symplectic, has a growing energy error."""
    off = [r["method"] for r in measured_rows(growth.TABLE) if not r["symplectic"] and not r["energy power"] > 0.5]
    assert not off, "\n".join(off)
