"""Checks of the Hamiltonian Monte Carlo experiment: acceptances are probabilities."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from phasebench.benchmarks.experiments.sampling import acceptance, cost, limits

if TYPE_CHECKING:
    from phasebench.benchmarks.store.cells import Cell


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`): acceptance, cost, stability limits; none if ``quick``."""
    return [*acceptance.cells(quick), *cost.cells(quick), *limits.cells(quick)]


def off(rows: list[dict]) -> list[str]:
    """Return messages about the rows whose acceptance is not in its own interval, or the interval not in [0, 1].

    ``rows`` are those of the table of acceptances, one for each target, method and number of evaluations.
    """
    return [
        f"{r['method']} on {r['target']}, {r['budget']}: {r['acceptance']}"
        for r in rows
        if not 0 <= r["low"] <= r["acceptance"] <= r["high"] <= 1
    ]


def bench_acceptance(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that every expected acceptance is a probability that lies in its own interval.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = off(measured_rows(acceptance.TABLE))
    assert not wrong, "\n".join(wrong)


def bench_cost(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that every proposal takes a positive time, and that no method has the acceptance 0 in all of its rows.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    rows = measured_rows(cost.TABLE)
    wrong = [f"{r['method']} on {r['target']}" for r in rows if not r["ns a proposal"] > 0]
    wrong += [id for id in {r["method"] for r in rows} if not any(r["acceptance"] for r in rows if r["method"] == id)]
    assert not wrong, wrong


def bench_limits(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that every method has a positive stability limit on the harmonic oscillator.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = [r["method"] for r in measured_rows(limits.TABLE) if not r["limit"] > 0]
    assert not wrong, wrong
