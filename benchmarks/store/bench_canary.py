"""Say whether the stored times still describe the code, by the kernels that a run has timed."""

from __future__ import annotations

from pathlib import Path

from phasebench.benchmarks.measure import canary
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, content
from phasebench.benchmarks.store.run import Outcome
from phasebench.benchmarks.store.tables import Table
from phasebench.integrators.registry import method

REPORTS = Path(__file__).resolve().parents[2] / "reports"
#: Fewer kernels are no median: a run that measures a sample alone has one or two.
ENOUGH = len(canary.METHODS) // 2


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements, one for each kernel; all are part of a quick run."""
    return [_cell(id) for id in canary.METHODS]


def _cell(id: str) -> Cell:
    problem = ProblemKey(canary.PROBLEM)
    needs = content(canary.TABLE, method(id), problem, canary.H, canary.STEPS, code=[canary.__name__])
    names, key = frozenset({id, "speed"}), {"method": id}
    return Cell("canary", (canary.TABLE,), key, canary.measure_rows, (id,), needs, names, ALONE, True, True)


def bench_canary(outcome: Outcome, notes: list[str]) -> None:
    """Note by how much kernels changed, where that is much."""
    failed = [outcome.failed[c.id] for c in outcome.cells if canary.TABLE in c.tables and c.id in outcome.failed]
    assert not failed, "\n".join(failed)
    stored = {r["method"]: float(r["ratio"]) for r in Table(REPORTS / "data", canary.TABLE).rows}
    measured = outcome.rows(canary.TABLE)
    found = canary.change(measured, stored.get) if len(measured) >= ENOUGH else None
    if found is not None and not 1 / canary.SAME <= found <= canary.SAME:
        notes.append(f"stored times do not describe this code: kernels take {found:.2f} times as long (--times)")
