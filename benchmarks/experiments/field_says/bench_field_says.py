"""Checks of the measurements by which statements in packages' guides are judged: references, and a control."""

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
    """Return a message for each reference state whose uncertainty is not below `UNCERTAIN`.

    ``rows`` are those of the table `cost.TABLE`.
    """
    return [f"{r['problem']}: {r['uncertainty']:.1e}" for r in rows if not r["uncertainty"] < UNCERTAIN]


def bench_references(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that the reference states are known far better than the smallest error at which methods are compared.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    off = unsound(measured_rows(cost.TABLE))
    assert not off, "\n".join(off)


def bench_growth(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that the energy error of the control, methods that are not symplectic, grows with time.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    off = [r["method"] for r in measured_rows(growth.TABLE) if not r["symplectic"] and not r["energy power"] > 0.5]
    assert not off, "\n".join(off)
