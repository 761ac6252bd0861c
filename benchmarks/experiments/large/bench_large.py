"""Checks of cost over degrees of freedom d: our steps end where those in C end, and implicit steps are solved."""

from __future__ import annotations

from phasebench.benchmarks.experiments.large import large, solvers
from phasebench.benchmarks.experiments.large.solvers_page import SAME


def cells(quick: bool = False) -> list:
    """List the measurements: the cost of explicit steps, and the solvers of implicit ones."""
    return large.cells(quick) + solvers.cells(quick)


def bench_costs(measured_rows):
    """Our steps end where those in C end, and both took time."""
    wrong = [
        f"{r['system']} of d = {r['d']}"
        for r in measured_rows(large.COSTS)
        if not (r["difference from C"] < large.APART and r["ns, ours"] > 0 and r["ns, C"] > 0)
    ]
    assert not wrong, "\n".join(wrong)


def bench_made(measured_rows):
    """Hand-written loops are compiled for every system at its largest size (more than 9000 degrees of freedom)."""
    rows = measured_rows(large.MADE)
    for system in {r["system"] for r in rows}:
        assert max(r["d"] for r in rows if (r["system"], r["route"]) == (system, "loops")) > 9000, system


def bench_solvers(measured_rows):
    """Newton's method with banded matrices solves every implicit step, and ends where the usual solver does."""
    wrong = [
        f"{r['system']} of d = {r['d']}, h = {r['h']}"
        for r in measured_rows(solvers.TABLE)
        if not r["solved, banded"] or (r.get("apart") is not None and r["apart"] > SAME)
    ]
    assert not wrong, "\n".join(wrong)
