"""The order of every method without round-off, on nonlinear and non-separable systems."""

from __future__ import annotations

import pytest

from benchmarks import multiprecision
from benchmarks.cases import by_label, high_order_variants, variants

TOLERANCE = 0.1


def bench_orders_without_round_off(results, quick):
    """|order - declared| < 0.1, two-sided, for every method and parameter on every system where it runs."""
    if quick:
        pytest.skip("the full run measures the orders in 40-digit arithmetic; so does tests/test_orders.py")
    methods = by_label(variants() + high_order_variants())
    rows, off = [], []
    for label, systems in multiprecision.elsewhere("orders").items():
        for name, row in systems.items():
            assert not isinstance(row, str), f"{label} on {name}: {row}"
            found = multiprecision.observed_order(row)
            rows.append(
                {
                    "method": label,
                    "problem": name,
                    "declared": methods[label].order,
                    "order": found.value,
                    "low": found.low,
                    "high": found.high,
                    "points": found.points,
                    "digits": multiprecision.DIGITS,
                }
            )
            if not abs(found.value - methods[label].order) < TOLERANCE:
                off.append(f"{label} on {name}: {found.value:.3f}, declared {methods[label].order}")
    results.add("multiprecision", rows)
    assert not off, "\n".join(off)
