"""Checks of the cost of a step over the number d of degrees of freedom, for explicit and for implicit steps."""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.large import large, solvers
from phasebench.benchmarks.experiments.large.solvers_page import SAME


def cells(quick: bool = False) -> list:
    """List the measurements (`Cell`) of explicit steps (`large`) and implicit steps (`solvers`); none if ``quick``."""
    return large.cells(quick) + solvers.cells(quick)


def bench_costs(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that our explicit steps end where the same steps in C end, and that both took time.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = [
        f"{r['system']} of d = {r['d']}"
        for r in measured_rows(large.COSTS)
        if not (r["difference from C"] < large.APART and r["ns, ours"] > 0 and r["ns, C"] > 0)
    ]
    assert not wrong, "\n".join(wrong)


def bench_made(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that the hand-written loops of every system are compiled for more than 9000 degrees of freedom.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    rows = measured_rows(large.MADE)
    for system in {r["system"] for r in rows}:
        assert max(r["d"] for r in rows if (r["system"], r["route"]) == (system, "loops")) > 9000, system


def bench_solvers(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that Newton's method with banded matrices solves every implicit step, to the end state of the usual solver.

    The usual solver is the fixed-point iteration with Newton's method in full matrices where that fails.
    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = [
        f"{r['system']} of d = {r['d']}, h = {r['h']}"
        for r in measured_rows(solvers.TABLE)
        if not r["solved, banded"] or (r.get("apart") is not None and r["apart"] > SAME)
    ]
    assert not wrong, "\n".join(wrong)
