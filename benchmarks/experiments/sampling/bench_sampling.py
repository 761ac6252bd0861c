"""Checks of the sampling experiment: acceptances are probabilities, and no run without the Hessian fails."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from phasebench.benchmarks.experiments.sampling import acceptance, cost, hessian_free, limits

if TYPE_CHECKING:
    from phasebench.benchmarks.store.cells import Cell


def cells(quick: bool = False) -> list[Cell]:
    """The cells of the acceptance and its time, of the stability limits, and of the energy without the Hessian."""
    return [*acceptance.cells(quick), *cost.cells(quick), *limits.cells(quick), *hessian_free.cells(quick)]


def off(rows: list[dict]) -> list[str]:
    """A line for each acceptance that is no probability within its interval."""
    return [
        f"{r['method']} on {r['target']}, {r['budget']}: {r['acceptance']}"
        for r in rows
        if not 0 <= r["low"] <= r["acceptance"] <= r["high"] <= 1
    ]


def bench_acceptance(measured_rows: Callable[[str], list[dict]]) -> None:
    """Every acceptance is a probability within its interval."""
    wrong = off(measured_rows(acceptance.TABLE))
    assert not wrong, "\n".join(wrong)


def bench_cost(measured_rows: Callable[[str], list[dict]]) -> None:
    """Every proposal takes time, and every method accepts some."""
    rows = measured_rows(cost.TABLE)
    wrong = [f"{r['method']} on {r['target']}" for r in rows if not r["ns a proposal"] > 0]
    wrong += [id for id in {r["method"] for r in rows} if not any(r["acceptance"] for r in rows if r["method"] == id)]
    assert not wrong, wrong


def bench_limits(measured_rows: Callable[[str], list[dict]]) -> None:
    """Every method is stable up to some step."""
    wrong = [r["method"] for r in measured_rows(limits.TABLE) if not r["limit"] > 0]
    assert not wrong, wrong


def bench_hessian_free(measured_rows: Callable[[str], list[dict]]) -> None:
    """Every orbit reaches the end."""
    wrong = [r["method"] for r in measured_rows(hessian_free.CHAOTIC) if r["failed"]]
    wrong += [f"{r['method']} on {r['problem']}" for r in measured_rows(hessian_free.REGULAR) if r["status"] != "ok"]
    assert not wrong, wrong
