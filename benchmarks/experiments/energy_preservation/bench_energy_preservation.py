"""Schemes IV and V keep H0 to round-off on steps with a root, and an independent scan finds no root they missed."""

from __future__ import annotations

from phasebench.benchmarks.experiments.energy_preservation.energies import cells  # noqa: F401


def off(rows) -> list[str]:
    """A line for each energy, angular momentum or missed root that is wrong, in the runs that reached the end."""
    out = []
    for r in (r for r in rows if r["status"] == "ok"):
        where = f"{r['scheme']} on {r['problem']}, h = {r['h']}"
        if not r["energy error, steps with a root"] < 1e-14:
            out.append(f"{where}: energy error {r['energy error, steps with a root']:.2e} on steps with a root")
        if not r.get("angular momentum error", 0.0) < 5e-14:
            out.append(f"{where}: angular momentum error {r['angular momentum error']:.2e}")
        if r.get("scan finds a root within the radius", 0):
            out.append(f"{where}: the finder missed a root")
    return out


def bench_energy(measured_rows):
    """Energy and angular momentum are kept to round-off, and the root finder misses no root."""
    wrong = off(measured_rows("energy_preservation"))
    assert not wrong, "\n".join(wrong)
