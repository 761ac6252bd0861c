"""The tables of coefficients: the orders and residuals that their numbers have, the digits that had to be repaired."""

from __future__ import annotations

from phasebench.benchmarks.experiments.catalogue import coefficients


def bench_coefficients(results):
    """Every table has the order that it declares."""
    frame = coefficients.frame()
    results.add("coefficients", frame.to_dict("records"))
    results.add("repairs", coefficients.repairs().to_dict("records"))
    results.add("loose_digits", coefficients.loose().to_dict("records"))
    assert (frame["order"] == frame["declared order"]).all()
