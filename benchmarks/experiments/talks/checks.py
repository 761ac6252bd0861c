"""CHECKS: small measurements that test statements of the two talks and that no other experiment makes.

Each is a `Probe`: a number and a control, the same number for a case in which the statement must fail.  Both are
written into one row, from which `judging.check` judges the statement.
"""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.registry import method

from . import checks_flows, checks_schemes
from .checks_base import TABLE, Probe

CHECKS: tuple[Probe, ...] = (*checks_flows.CHECKS, *checks_schemes.CHECKS)
BY_ID: dict[str, Probe] = {c.id: c for c in CHECKS}


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each check of a talk's statement; none if ``quick``."""
    return [] if quick else [_cell(check) for check in CHECKS]


def _cell(check: Probe) -> Cell:
    uses = [*map(method, check.methods), *map(ProblemKey, check.problems)]
    about = content("talk check", check.id, *uses, code=[_module(check.measure)])
    return Cell("talks", (TABLE,), {"check": check.id}, measure_rows, (check.id,), about, frozenset({check.id}))


def _module(measure: Callable) -> str:
    return getattr(measure, "func", measure).__module__


def measure_rows(id: str) -> Rows:
    """Measure the number that tests a talk's statement, and its control (a case that must fail).

    ``id`` is the check's.  Returns {`TABLE`: [row]} with both numbers and their descriptions.
    """
    check = BY_ID[id]
    value, control = check.measure()
    row = {"check": id, "value": float(value), "control": float(control), "what": check.what, "against": check.against}
    return {TABLE: [row]}
