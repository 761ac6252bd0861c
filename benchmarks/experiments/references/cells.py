"""The certified references as cells: each is computed anew and compared with the stored one."""

from __future__ import annotations

from phasebench.benchmarks.problems import labels, problem
from phasebench.benchmarks.rows.cells import Cell, Problem, Rows, content, states
from phasebench.reference.certificates import check

from .rows import row

CODE = (
    "phasebench.benchmarks.experiments.references.rows",
    "phasebench.reference.certificates.check",
)


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each certified orbit; none of the quick tier."""
    return [] if quick else [_cell(label) for label in labels()]


def _cell(label: str) -> Cell:
    id = label.partition(":")[0]
    return Cell(
        "references",
        ("references",),
        {"problem": label},
        measured,
        (label,),
        content("reference", Problem(label), states(id), code=CODE),
        frozenset({id}),
    )


def measured(label: str) -> Rows:
    """The row of a reference; raises AssertionError where a stored state moved or solvers disagree."""
    outcome = check.renew(problem(label))
    assert not outcome.changed, f"{label}: {outcome.changed}; phasebench certify {label} shows it"
    assert all(end.agree for end in outcome.fresh.ends), [end.checks for end in outcome.fresh.ends]
    assert outcome.fresh.digits_horizon == outcome.fresh.t_end, "the stored digits do not hold to the end: end sooner"
    return {"references": [row(outcome)]}
