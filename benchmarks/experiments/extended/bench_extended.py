"""Checks of the methods in extended phase space: what is declared symplectic is, and the orders on the orbit hold."""

from __future__ import annotations

from phasebench.benchmarks.experiments.extended.measure import BOTH, ORDERS, SPECIAL, STRUCTURE, cells  # noqa: F401
from phasebench.benchmarks.experiments.extended.page import GATE
from phasebench.benchmarks.judge.evidence import NO_DEFECT


def maps_off(rows) -> list[str]:
    """Messages about maps that should be symplectic and are not."""
    return [
        f"{r['method']}, {r['map']}, on {r['problem']}: {r['defect']:.1e}"
        for r in rows
        if (r["map"] == BOTH or r["method"].startswith("jayawardana")) and not r["defect"] <= NO_DEFECT
    ]


def orders_off(rows) -> list[str]:
    """Messages about methods whose order at their smallest step is not the declared one; `SPECIAL` loses it."""
    finest = {r["method"]: r for r in sorted(rows, key=lambda r: -r["h"])}
    return [
        f"{name}: {r['order']:.2f}, declared {r['declared']}"
        for name, r in finest.items()
        if (name != SPECIAL) != (abs(r["order"] - r["declared"]) < GATE)
    ]


def bench_maps_of_copies(measured_rows):
    """Steps of both copies, and the semiexplicit ones in the original phase space, are symplectic."""
    off = maps_off(measured_rows(STRUCTURE))
    assert not off, "\n".join(off)


def bench_orders_on_a_relativistic_orbit(measured_rows):
    """Methods for every H keep their order at small steps, as does the triple jump; the special splitting does not."""
    off = orders_off(measured_rows(ORDERS))
    assert not off, "\n".join(off)
