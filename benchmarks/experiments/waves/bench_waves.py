"""Checks of the wave equations: methods preserve the invariants that they are declared to preserve."""

from __future__ import annotations

from phasebench.benchmarks.experiments.waves import spacetime, waves
from phasebench.benchmarks.experiments.waves.laws import TWO_FORM
from phasebench.benchmarks.experiments.waves.spacetime_page import UNITS
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.integrators.record import ROUND_OFF


def cells(quick: bool = False) -> list:
    """List the measurements (`Cell`) of the semi-discretized equations, and of the box schemes."""
    return waves.cells(quick) + spacetime.cells(quick)


def off(rows) -> list[str]:
    """Messages about failed runs, and about runs whose method does not preserve an invariant as declared."""
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


def bench_invariants(measured_rows):
    """Methods preserve energy and charge (a form q.D p) to round-off as declared."""
    wrong = off(measured_rows("pde"))
    assert not wrong, "\n".join(wrong)


def failures(rows) -> list[str]:
    """Messages about failed runs, and box schemes that differ from their declaration of the multisymplectic law."""
    out = []
    for r in rows:
        where = f"{r['scheme']} on {r['equation']}, N = {r['N']}, h = {r['h']}"
        if r["status"] != OK:
            out.append(f"{where}: {r['reason']}")
        elif (r[TWO_FORM] <= UNITS * r[f"{TWO_FORM}, round-off"]) != r["multisymplectic"]:
            out.append(f"{where}: residual {r[TWO_FORM]:.2e}")
    return out


def bench_multisymplectic(measured_rows):
    """The multisymplectic law holds for the schemes declared multisymplectic, and fails for the others."""
    wrong = failures(measured_rows(spacetime.TABLE))
    assert not wrong, "\n".join(wrong)
