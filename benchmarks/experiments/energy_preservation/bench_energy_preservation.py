"""The energy is H0 to round-off on every step with a root; where the finder has none, a scan has none either."""

from __future__ import annotations

from phasebench.benchmarks.experiments.energy_preservation.energies import cells  # noqa: F401


def off(rows) -> list[str]:
    """What is wrong with the rows that got through."""
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


def bench_energy(measured):
    """Energy and angular momentum are kept, and no root is missed."""
    wrong = off(measured("energy_preservation"))
    assert not wrong, "\n".join(wrong)
