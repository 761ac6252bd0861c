"""Order, symplecticity and symmetry of every method without round-off, on nonlinear and non-separable systems."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.measure import multiprecision
from phasebench.benchmarks.measure.battery import by_label, expected_order, high_order_variants, variants

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
            found, declared = multiprecision.observed_order(row), expected_order(methods[label], name)
            rows.append(
                {
                    "method": label,
                    "problem": name,
                    "declared": declared,
                    "order": found.value,
                    "low": found.low,
                    "high": found.high,
                    "points": found.points,
                    "digits": multiprecision.digits(methods[label]),
                }
            )
            if not abs(found.value - declared) < TOLERANCE:
                off.append(f"{label} on {name}: {found.value:.3f}, declared {declared}")
    results.add("multiprecision", rows)
    assert not off, "\n".join(off)


#: The error of a difference Jacobian in 40 digits is below the first; what a property lacks shows above the second.
ROUND_OFF, VISIBLE = 1e-26, 1e-22


def bench_structure_without_round_off(results, quick):
    """Defects of symplecticity ||M^T J M - J|| and of symmetry agree with what every record declares."""
    if quick:
        pytest.skip("the full run measures the defects in 40-digit arithmetic; so does tests/test_symplectic.py")
    methods = by_label(variants() + high_order_variants())
    found = {name: multiprecision.elsewhere(name) for name in ("symplecticity", "symmetry")}
    rows, wrong = [], []
    for label, m in methods.items():
        for name, declared in (("symplecticity", m.symplectic), ("symmetry", m.symmetric)):
            defects = found[name].get(label, {})
            assert all(isinstance(d, float) for d in defects.values()), f"{label}: {defects}"
            worst = max(defects.values())
            rows.append(
                {
                    "method": label,
                    "property": name,
                    "declared": declared,
                    "defect": worst,
                    "systems": ", ".join(defects),
                }
            )
            if (worst <= ROUND_OFF) != declared or ROUND_OFF < worst < VISIBLE:
                wrong.append(f"{label}: {name} declared {declared}, defect {worst:.1e}")
    results.add("structure", rows)
    assert not wrong, "\n".join(wrong)
