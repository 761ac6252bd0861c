"""Measurements (`Cell`) that check the stated errors and horizons of the certified reference states by other means."""

from __future__ import annotations

from phasebench.benchmarks.problems import labels, problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content, states
from phasebench.reference.certificates import check

from . import odd
from .rows import row

CODE = (
    "phasebench.benchmarks.experiments.references.rows",
    "phasebench.reference.certificates.check",
)


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`): two for each certified orbit, of its stored states and at times between (`odd`).

    The list is empty if ``quick``.
    """
    return [] if quick else [*(_cell(label) for label in labels()), *odd.cells()]


def _cell(label: str) -> Cell:
    id = label.partition(":")[0]
    return Cell(
        "references",
        ("references",),
        {"problem": label},
        measure_rows,
        (label,),
        content("reference", ProblemKey(label), states(id), code=CODE),
        frozenset({id}),
    )


def measure_rows(label: str) -> Rows:
    """Measure the stored reference states of an orbit again: one row, by table name.

    ``label`` names the problem with its orbit.  Raises AssertionError if a stated number is not confirmed.
    """
    outcome = check.recheck(problem(label))
    shows = f"phasebench certify {label} shows it"
    assert not outcome.wrong, f"{label}: {'; '.join(outcome.wrong)}; {shows}"
    assert outcome.holds, f"{label}: no other solver agrees on every state; {shows}"
    known = outcome.certificate
    assert known.digits_horizon == known.t_end, "the stored digits do not hold to the end: end sooner"
    return {"references": [row(outcome)]}
