"""Checks of the methods in extended phase space: those declared symplectic are, and the orders on a test orbit hold."""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.extended.measure import BOTH, ORDERS, SPECIAL, STRUCTURE, cells  # noqa: F401
from phasebench.benchmarks.experiments.extended.page import GATE
from phasebench.benchmarks.judge.evidence import NO_DEFECT


def maps_off(rows: list[dict]) -> list[str]:
    """List messages about step maps that should be symplectic and are not."""
    return [
        f"{r['method']}, {r['map']}, on {r['problem']}: {r['defect']:.1e}"
        for r in rows
        if (r["map"] == BOTH or r["method"].startswith("jayawardana")) and not r["defect"] <= NO_DEFECT
    ]


def orders_off(rows: list[dict]) -> list[str]:
    """List messages about methods whose order at their smallest step is not as expected.

    Expected is the declared order, except of `SPECIAL`, a splitting that has to lose its order.
    """
    finest = {r["method"]: r for r in sorted(rows, key=lambda r: -r["h"])}
    return [
        f"{name}: {r['order']:.2f}, declared {r['declared']}"
        for name, r in finest.items()
        if (name != SPECIAL) != (abs(r["order"] - r["declared"]) < GATE)
    ]


def bench_maps_of_copies(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that steps of both copies, and semiexplicit steps in the original phase space, are symplectic."""
    off = maps_off(measured_rows(STRUCTURE))
    assert not off, "\n".join(off)


def bench_orders_on_a_relativistic_orbit(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that methods for every H and the triple jump keep their order at small steps, and `SPECIAL` does not."""
    off = orders_off(measured_rows(ORDERS))
    assert not off, "\n".join(off)
