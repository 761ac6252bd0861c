"""Semi-discretized wave equations: what is declared to be kept is kept."""

from __future__ import annotations

from phasebench.benchmarks.experiments.waves.waves import cells  # noqa: F401
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.integrators.record import ROUND_OFF


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
