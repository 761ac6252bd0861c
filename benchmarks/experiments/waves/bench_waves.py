"""Semi-discretized wave equations: what is declared to be kept is kept."""

from __future__ import annotations

from phasebench.benchmarks.experiments.waves import spacetime, waves
from phasebench.benchmarks.experiments.waves.laws import TWO_FORM
from phasebench.benchmarks.experiments.waves.spacetime_page import UNITS
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.integrators.record import ROUND_OFF


def cells(quick: bool = False) -> list:
    """The systems divided in space, and the box schemes."""
    return waves.cells(quick) + spacetime.cells(quick)


def off(rows) -> list[str]:
    """Runs that do not get through, and declared invariants that are not kept."""
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


def bench_invariants(measured):
    """What is declared to be kept is kept; Scheme V's relatives keep q.D p at every lambda."""
    wrong = off(measured("pde"))
    assert not wrong, "\n".join(wrong)


def lost(rows) -> list[str]:
    """Box schemes that do not keep the multisymplectic law as declared, or do not come to an end."""
    out = []
    for r in rows:
        where = f"{r['scheme']} on {r['equation']}, N = {r['N']}, h = {r['h']}"
        if r["status"] != OK:
            out.append(f"{where}: {r['reason']}")
        elif (r[TWO_FORM] <= UNITS * r[f"{TWO_FORM}, round-off"]) != r["multisymplectic"]:
            out.append(f"{where}: residual {r[TWO_FORM]:.2e}")
    return out


def bench_multisymplectic(measured):
    """The law holds where it is declared, and the controls do not keep it."""
    wrong = lost(measured(spacetime.TABLE))
    assert not wrong, "\n".join(wrong)
