"""Cost by d: every step is the step that C takes, and every time is of steps that were taken."""

from __future__ import annotations

from phasebench.benchmarks.experiments.large import large, solvers
from phasebench.benchmarks.experiments.large.solvers_page import SAME


def cells(quick: bool = False) -> list:
    """The costs of explicit steps, and how implicit ones are solved."""
    return large.cells(quick) + solvers.cells(quick)


def bench_costs(measured):
    """Ours ends where C ends, and both took time."""
    wrong = [
        f"{r['system']} of d = {r['d']}"
        for r in measured(large.COSTS)
        if not (r["difference from C"] < large.APART and r["ns, ours"] > 0 and r["ns, C"] > 0)
    ]
    assert not wrong, "\n".join(wrong)


def bench_made(measured):
    """Every system gets its functions from loops at the largest size."""
    rows = measured(large.MADE)
    for system in {r["system"] for r in rows}:
        assert max(r["d"] for r in rows if (r["system"], r["route"]) == (system, "loops")) > 9000, system


def bench_solvers(measured):
    """Steps in the band are solved, and where they are solved otherwise too, they are the same."""
    wrong = [
        f"{r['system']} of d = {r['d']}, h = {r['h']}"
        for r in measured(solvers.TABLE)
        if not r["solved, banded"] or (r.get("apart") is not None and r["apart"] > SAME)
    ]
    assert not wrong, "\n".join(wrong)
