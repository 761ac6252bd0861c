"""Check that the published tables of splitting and composition coefficients have the orders that they declare."""

from __future__ import annotations

from phasebench.benchmarks.experiments.catalogue.cells import cells  # noqa: F401


def bench_coefficients(measured_rows):
    """Every published table of coefficients has the order that it declares."""
    wrong = [r for r in measured_rows("coefficients") if r["order"] != r["declared order"]]
    assert not wrong, wrong
