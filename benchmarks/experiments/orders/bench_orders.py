"""Checks of order, symplecticity, symmetry and volume of every method without round-off.

They are made on non-separable systems, too.
"""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.orders.orders import cells  # noqa: F401
from phasebench.benchmarks.experiments.orders.page import GATE
from phasebench.benchmarks.measure.visible import least_visible

#: The defect of a method that has a property is below this.
ROUND_OFF = 1e-26


def orders_off(rows: list[dict]) -> list[str]:
    """Return messages about the rows whose measured order is at least `GATE` above or below the declared one."""
    return [
        f"{r['method']} on {r['problem']}: {r['order']:.3f}, declared {r['declared']}"
        for r in rows
        if not abs(r["order"] - r["declared"]) < GATE
    ]


def structure_off(rows: list[dict]) -> list[str]:
    """Return messages about the defects that contradict the method's declaration.

    A method that declares a property must have a defect of round-off; one that does not must have a defect large enough
    to be seen.  ``rows`` are those of the table "structure".
    """

    def right(r: dict) -> bool:
        least = least_visible(r["method"], r["property"])
        return r["defect"] <= min(ROUND_OFF, least) if r["declared"] else r["defect"] >= least

    return [
        f"{r['method']}: {r['property']} declared {r['declared']}, defect {r['defect']:.1e}"
        for r in rows
        if not right(r)
    ]


def bench_orders_without_round_off(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that every method has its declared order in multiprecision, on every system where it runs.

    This includes every tested parameter of a method.  ``measured_rows`` is a fixture: table name -> rows.
    """
    off = orders_off(measured_rows("multiprecision"))
    assert not off, "\n".join(off)


def bench_structure_without_round_off(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that defects of symplecticity, symmetry and volume agree with every method's declarations.

    The defect of symplecticity is ||M^T J M - J||, with M the Jacobian of a step; above a certain order it is the
    change of the two-form of one pair of vectors.  ``measured_rows`` is a fixture: table name -> rows.
    """
    off = structure_off(measured_rows("structure"))
    assert not off, "\n".join(off)
