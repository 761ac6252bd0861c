"""Checks of rows measured elsewhere: methods of this suite with the same coefficients have the same energy errors."""

from __future__ import annotations

from phasebench.benchmarks.experiments.elsewhere.measure import OURS, THEIRS, cells  # noqa: F401
from phasebench.benchmarks.experiments.elsewhere.page import SAME


def energies_off(rows) -> list[str]:
    """Messages about rows whose energy error is not that of the same method here."""
    return [
        f"{r['method']}, h = {r['h']}: {r['energy_error']:.3e}, here {r['twin_energy_error']:.3e}"
        for r in rows
        if r["twin_energy_error"] is not None and not abs(r["energy_error"] - r["twin_energy_error"]) <= SAME
    ]


def bench_methods_of_the_same_coefficients(measured_rows):
    """The energy errors stated elsewhere are reached here by methods of the same coefficients."""
    off = energies_off(measured_rows(THEIRS))
    assert not off, "\n".join(off)


def bench_runs_beside_them(measured_rows):
    """This suite's methods reach the end of every problem that rows were measured on."""
    rows = measured_rows(OURS)
    assert not rows or any(r["status"] == "ok" for r in rows)
