"""CHECKS: the small measurements of what the talks state and no other experiment measures.

A check is a function that gives a number and a control: the number of something for which the statement must fail.
Both are written into one row; what they say of a statement is decided by the page, from the row.
"""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.rows.cells import Cell, Problem, Rows, content
from phasebench.integrators.registry import method

from . import checks_flows, checks_schemes
from .checks_base import TABLE, Check

CHECKS: tuple[Check, ...] = (*checks_flows.CHECKS, *checks_schemes.CHECKS)
BY_ID: dict[str, Check] = {c.id: c for c in CHECKS}


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each check; none of the quick tier."""
    return [] if quick else [_cell(check) for check in CHECKS]


def _cell(check: Check) -> Cell:
    uses = [*map(method, check.methods), *map(Problem, check.problems)]
    about = content("talk check", check.id, *uses, code=[_module(check.measure)])
    return Cell("talks", (TABLE,), {"check": check.id}, measured, (check.id,), about, frozenset({check.id}))


def _module(measure: Callable) -> str:
    return getattr(measure, "func", measure).__module__


def measured(id: str) -> Rows:
    """The row of a check."""
    check = BY_ID[id]
    value, control = check.measure()
    row = {"check": id, "value": float(value), "control": float(control), "what": check.what, "against": check.against}
    return {TABLE: [row]}
