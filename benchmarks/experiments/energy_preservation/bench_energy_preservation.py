"""Checks of the energy-preserving Schemes IV and V, which have a parameter lambda.

In each step lambda is chosen as a root of H(state after the step) = H0, near 1/2.  Where there is a root, H0 must be
kept to round-off; where the schemes find none, an independent scan must find none either.
"""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.energy_preservation.energies import cells  # noqa: F401


def off(rows: list[dict]) -> list[str]:
    """List messages about completed runs in which energy or angular momentum is not kept, or a root lambda was missed.

    ``rows`` are those of the table "energy_preservation".
    """
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


def bench_energy(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that energy and angular momentum are kept to round-off, and that no lambda that would keep H was missed.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = off(measured_rows("energy_preservation"))
    assert not wrong, "\n".join(wrong)
