"""Checks of results from other machines: methods here with the same coefficients have the same energy errors."""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.elsewhere.measure import OURS, THEIRS, cells  # noqa: F401
from phasebench.benchmarks.experiments.elsewhere.page import SAME


def energies_off(rows: list[dict]) -> list[str]:
    """Return a message for each result whose energy error differs from that of the method here of equal coefficients.

    ``rows`` are those of the table `THEIRS`, one for each result from another machine.
    """
    return [
        f"{r['method']}, h = {r['h']}: {r['energy_error']:.3e}, here {r['twin_energy_error']:.3e}"
        for r in rows
        if r["twin_energy_error"] is not None and not abs(r["energy_error"] - r["twin_energy_error"]) <= SAME
    ]


def bench_methods_of_the_same_coefficients(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that this suite's methods reach the energy errors that other packages state for the same coefficients.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    off = energies_off(measured_rows(THEIRS))
    assert not off, "\n".join(off)


def bench_runs_beside_them(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that, of this suite's runs for comparison with other machines' results, at least one reaches its end.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    rows = measured_rows(OURS)
    assert not rows or any(r["status"] == "ok" for r in rows)
