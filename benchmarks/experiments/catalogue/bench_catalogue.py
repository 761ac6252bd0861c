"""The tables of coefficients: the orders and residuals that their numbers have, the digits that had to be repaired."""

from __future__ import annotations

from phasebench.benchmarks.experiments.catalogue.cells import cells  # noqa: F401


def bench_coefficients(measured):
    """Every table has the order that it declares."""
    wrong = [r for r in measured("coefficients") if r["order"] != r["declared order"]]
    assert not wrong, wrong
