"""Order, symplecticity and symmetry of every method without round-off, on nonlinear and non-separable systems."""

from __future__ import annotations

from phasebench.benchmarks.experiments.orders.orders import cells  # noqa: F401
from phasebench.benchmarks.experiments.orders.page import GATE

#: The error of a difference Jacobian in 40 digits is below the first; what a property lacks shows above the second.
ROUND_OFF, VISIBLE = 1e-26, 1e-22


def orders_off(rows) -> list[str]:
    """|order - declared| < `GATE`, two-sided: the rows that are not."""
    return [
        f"{r['method']} on {r['problem']}: {r['order']:.3f}, declared {r['declared']}"
        for r in rows
        if not abs(r["order"] - r["declared"]) < GATE
    ]


def structure_off(rows) -> list[str]:
    """Defects that do not agree with what the record declares, or are neither round-off nor visible."""
    return [
        f"{r['method']}: {r['property']} declared {r['declared']}, defect {r['defect']:.1e}"
        for r in rows
        if (r["defect"] <= ROUND_OFF) != r["declared"] or ROUND_OFF < r["defect"] < VISIBLE
    ]


def bench_orders_without_round_off(measured):
    """Every method at every tested parameter has its declared order on every system where it runs."""
    off = orders_off(measured("multiprecision"))
    assert not off, "\n".join(off)


def bench_structure_without_round_off(measured):
    """Defects of symplecticity ||M^T J M - J|| and of symmetry agree with what every record declares."""
    off = structure_off(measured("structure"))
    assert not off, "\n".join(off)
