"""Checks of the methods in extended phase space (two copies of the state): symplecticity, orders on a test orbit."""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.extended.measure import BOTH, ORDERS, SPECIAL, STRUCTURE, cells  # noqa: F401
from phasebench.benchmarks.experiments.extended.page import GATE
from phasebench.benchmarks.judge.evidence import NO_DEFECT


def maps_off(rows: list[dict]) -> list[str]:
    """Return a message for each step map that should be symplectic and is not.

    These are the maps of both copies of the state, and those of (q, p) by the semiexplicit methods (Jayawardana and
    Ohsawa).  ``rows`` are those of the table `STRUCTURE`.
    """
    return [
        f"{r['method']}, {r['map']}, on {r['problem']}: {r['defect']:.1e}"
        for r in rows
        if (r["map"] == BOTH or r["method"].startswith("jayawardana")) and not r["defect"] <= NO_DEFECT
    ]


def orders_off(rows: list[dict]) -> list[str]:
    """Return a message for each method whose order at its smallest step is not as expected.

    Expected is the declared order, except of `SPECIAL`: this splitting for a Kepler problem with a small perturbation
    has to lose its order at small steps.  ``rows`` are those of the table `ORDERS`, one for each method and step.
    """
    finest = {r["method"]: r for r in sorted(rows, key=lambda r: -r["h"])}
    return [
        f"{name}: {r['order']:.2f}, declared {r['declared']}"
        for name, r in finest.items()
        if (name != SPECIAL) != (abs(r["order"] - r["declared"]) < GATE)
    ]


def bench_maps_of_copies(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that steps of both copies of the state, and semiexplicit steps of (q, p) alone, are symplectic.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    off = maps_off(measured_rows(STRUCTURE))
    assert not off, "\n".join(off)


def bench_orders_on_a_relativistic_orbit(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that methods keep their order on the relativistic orbit at small steps, and that `SPECIAL` loses its own.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    off = orders_off(measured_rows(ORDERS))
    assert not off, "\n".join(off)
