"""The schema of rows: their columns with units, and the version that is written beside them.

A row is one run of an integrator.  Rows are stored in ``reports/data/rows.csv``, in the JSON lines that ``phasebench
run`` writes, and in ``reference/tables/*.csv``, with which later runs are compared.  The version of the schema is the
entry ``schema``: of a table, in the JSON file beside it; of a JSON line, in the line itself.  Without it, it is 1.

Within a version columns may be added.  A column that is renamed, or that means something else, makes a new version.
Tables of single experiments (all others in ``reports/data``) are no part of the schema: they change with their pages.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from phasebench.integrators.errors import InvalidInput

#: The version that is written, and the newest that is read.
VERSION = 1
#: The field that states it.
FIELD = "schema"


class Column(NamedTuple):
    """A column: its unit, and its meaning.  The unit is "text" for words, "1" for a plain number or a count."""

    unit: str
    meaning: str


#: Units that are not of the row's own problem: its "time", its "energy", and its "state" (the largest of q and p).
TEXT, ONE, SECONDS, TIME, ENERGY, STATE = "text", "1", "s", "time", "energy", "state"

IDENTITY = {
    "scene": Column(TEXT, "id of the scene: a problem, a span and its steps"),
    "purpose": Column(TEXT, "order, drift or trade: what the scene is for"),
    "problem": Column(TEXT, "id of the problem, with its orbit after a colon"),
    "quantity": Column(TEXT, "whose error it is; end-state where it is empty"),
    "method": Column(TEXT, "the integrator with its parameters"),
    "id": Column(TEXT, "id of the method or peer"),
    "kind": Column(TEXT, "phasebench, the package of a peer, or own step"),
    "h": Column(TIME, "the step; empty for an adaptive integrator"),
    "tol": Column(ONE, "the tolerance of an adaptive integrator, as its package means it"),
    "rows_every": Column(TIME, "time between two rows of an adaptive integrator"),
    "t_end": Column(TIME, "end of the span, which begins at 0"),
    "declared_order": Column(ONE, "the order that the method declares"),
    "tier": Column(TEXT, "full, or quick: fewer steps"),
    "versions": Column(TEXT, "versions of the packages that the integrator runs on"),
}
OUTCOME = {
    "status": Column(TEXT, "how the run ended"),
    "reason": Column(TEXT, "why, in words"),
    "steps": Column(ONE, "steps taken"),
    "gradient": Column(ONE, "evaluations of the gradient, by q or by p, whichever are more"),
    "hessian": Column(ONE, "evaluations of second derivatives"),
    "iterations": Column(ONE, "iterations of stage equations"),
    "fallbacks": Column(ONE, "steps in which a method took its second choice, because its equation had no solution"),
    "newton": Column(ONE, "stage equations that Newton's method solved"),
    "seconds": Column(SECONDS, "of the integration alone, warm, without output"),
    "shared": Column(TEXT, "a warning if other processes used the processor"),
}
ERRORS = {
    "energy_max": Column(ENERGY, "largest size of H - H0 over all rows"),
    "energy_end": Column(ENERGY, "H - H0 at the end, with its sign"),
    "energy_max_early": Column(ENERGY, "largest size of H - H0 over the first twentieth of the span"),
    "energy_drift": Column("energy / time", "slope of H - H0"),
    "energy_drift_low": Column("energy / time", "lower end of the 95 % interval of that slope"),
    "energy_drift_high": Column("energy / time", "upper end of the 95 % interval of that slope"),
    "global_error": Column(STATE, "max norm over (q, p) of the difference from the reference"),
    "global_error_max": Column(STATE, "the largest of it over all rows"),
    "global_error_time": Column(TIME, "time of that difference: the end, or the last time before the horizon"),
    "error": Column("of the quantity", "error of the quantity against the reference"),
    "uncertainty": Column("of the quantity", "uncertainty of the reference"),
    "reference_horizon": Column(TIME, "time up to which the reference follows the orbit"),
    "reference": Column(TEXT, "computed where the reference is no stored state"),
    "reference_uncertainty": Column(STATE, "uncertainty of the reference"),
    "refinement_difference": Column(STATE, "difference from the run with twice the step"),
}
PROVENANCE = {
    "content": Column(TEXT, "hash of all that the row depends on"),
    "date": Column(TEXT, "day of the measurement"),
    "machine": Column(TEXT, "the machine, described in the JSON file beside the table"),
    "spent": Column(SECONDS, "time that the cell of the row took"),
    "digest": Column(TEXT, "hash of the cell's rows, which shows an edit"),
    "state": Column(TEXT, "current, or stale: the code has changed since"),
    "cell": Column(TEXT, "of a line of JSON: id of its cell, the runs that are measured together"),
    "of": Column(ONE, "of a line of JSON: number of rows of its cell"),
    FIELD: Column(ONE, "of a line of JSON: version of this schema"),
}
COLUMNS: dict[str, Column] = {**IDENTITY, **OUTCOME, **ERRORS, **PROVENANCE}
#: How the column of an invariant of the problem ends, whose name comes before.
INVARIANT = "_max"
OF_INVARIANT = Column("of the invariant", "largest size of the change of the problem's invariant of that name")


def column(name: str) -> Column | None:
    """The unit and meaning of a column by its name; None if the schema does not have it."""
    if name in COLUMNS:
        return COLUMNS[name]
    return OF_INVARIANT if name.endswith(INVARIANT) and len(name) > len(INVARIANT) else None


def undeclared(names: Iterable[str]) -> list[str]:
    """Return those of the given column names that the schema does not have."""
    return [name for name in names if column(name) is None]


def check(about: Mapping[str, Any], where: object) -> None:
    """Raise InvalidInput if rows are of a newer schema than `VERSION`, or state no positive integer as theirs."""
    stated = about.get(FIELD, 1)
    if isinstance(stated, bool) or not isinstance(stated, int) or stated < 1:
        raise InvalidInput(f"{where} states the schema {stated!r}; it must be a positive integer")
    if stated > VERSION:
        newer = f"this version of phasebench reads up to {VERSION}: install a newer one"
        raise InvalidInput(f"{where} has rows of schema {stated}, and {newer}")
