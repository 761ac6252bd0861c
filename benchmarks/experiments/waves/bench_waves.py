"""Checks on discretized wave equations: methods preserve the invariants and laws that they are declared to preserve."""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.waves import spacetime, waves
from phasebench.benchmarks.experiments.waves.laws import TWO_FORM
from phasebench.benchmarks.experiments.waves.spacetime_page import UNITS
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.integrators.record import ROUND_OFF


def cells(quick: bool = False) -> list:
    """List the measurements (`Cell`): methods on the semi-discretized wave equations, and box schemes in space-time."""
    return waves.cells(quick) + spacetime.cells(quick)


def off(rows: list[dict]) -> list[str]:
    """Return a message for each failed run, and for each run whose method does not preserve an invariant as declared.

    The invariants are the energy, and the charge, a form q.D p.  ``rows`` are those of the table "pde", one
    for each method on each wave equation with each step size.
    """
    out = []
    for r in (r for r in rows if r["status"] != SKIPPED):
        where = f"{r['method']} on {r['problem']}, h = {r['h']}"
        if r["status"] != OK:
            out.append(f"{where}: {r['status']}: {r['reason']}")
        elif r["energy class"] == ROUND_OFF and not r["energy is kept"]:
            out.append(f"{where}: energy error {r['energy error']:.2e}")
        elif r["invariant"] == "charge" and r["quadratic class"] == ROUND_OFF and not r["invariant is kept"]:
            out.append(f"{where}: {r['invariant']} error {r['invariant error']:.2e}")
    return out


def bench_invariants(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that methods preserve energy and charge (a form q.D p) to round-off where they are declared to.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = off(measured_rows("pde"))
    assert not wrong, "\n".join(wrong)


def failures(rows: list[dict]) -> list[str]:
    """Return a message for each failed run, and for each run of a box scheme that contradicts its declaration.

    A scheme declared multisymplectic must keep the multisymplectic law, and any other must not.  ``rows`` are runs of
    box schemes, each with the residual of the multisymplectic law and the size of one unit of round-off of the
    residual.
    """
    out = []
    for r in rows:
        where = f"{r['scheme']} on {r['equation']}, N = {r['N']}, h = {r['h']}"
        if r["status"] != OK:
            out.append(f"{where}: {r['reason']}")
        elif (r[TWO_FORM] <= UNITS * r[f"{TWO_FORM}, round-off"]) != r["multisymplectic"]:
            out.append(f"{where}: residual {r[TWO_FORM]:.2e}")
    return out


def bench_multisymplectic(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that the multisymplectic law holds for the box schemes declared multisymplectic, and fails for others.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = failures(measured_rows(spacetime.TABLE))
    assert not wrong, "\n".join(wrong)
