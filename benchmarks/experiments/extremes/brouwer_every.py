"""Brouwer's law for every method that is symplectic or keeps the energy: the starts of `brouwer`, with fewer steps.

The energy's error is that of |w|^2, the quadratic form that a step's matrix keeps (`brouwer`), if the exact matrix is
known (`exact_maps`), otherwise, for a method that keeps H, the error of H.  A matrix in doubles would not do: |w|^2
would then oscillate by more than the law.  The phase error needs the exact matrix.

A state is itself rounded, to eps, so that the law shows only where eps h n^(1/2) is above eps.  The step is eight times
that of the long runs of `brouwer`, so that fewer steps suffice.
"""

from __future__ import annotations

import mpmath
import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators import batches
from phasebench.integrators.registry import BY_ID, METHODS

from . import brouwer, exact_maps

H, ROWS = 0.0987654321, 64
#: Steps of a run, by the cost of a step: explicit, implicit and composed methods in SIMD lanes, others, the slowest.
EXPLICIT, IMPLICIT, COMPOSED, ALONE, DEAR = 524_288, 131_072, 32_768, 16_384, 4_096
#: lambda is slightly off 1/3, as round-off drifts at 1/3.
BESIDE = {"lam": brouwer.BESIDE}
#: How the energy's error is measured.
EXACT, ENERGY = "exact matrix", "energy"
TABLE = "extremes_growth_every"


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements to make (`Cell`), one for each method that is symplectic or keeps the energy.

    The list is empty if ``quick``.
    """
    return [] if quick else [_cell(m.id) for m in METHODS if m.symplectic or m.energy == "round-off"]


def _cell(id: str) -> Cell:
    values = {name: x for name, x in BESIDE.items() if name in BY_ID[id].parameters}
    needs = content("growth-every", BY_ID[id], values, ProblemKey(brouwer.PROBLEM), code=[__name__])
    key = {"label": brouwer.label(id, values), "h": H, "steps": steps_of(id)}
    return Cell("extremes", (TABLE,), key, measure_rows, (id, values, key["label"]), needs, frozenset({id}))


def steps_of(id: str) -> int:
    """Return the number of steps that a method runs: the cheaper its step, the more."""
    chosen = BY_ID[id]
    if chosen.family == "schemes_iv_v":
        return DEAR
    if chosen.family == "trigonometric":
        return IMPLICIT
    if chosen.family not in ("parametric", "splitting"):
        return ALONE
    if not id.startswith(("scheme", "implicit-midpoint", "generating")):
        return EXPLICIT
    return IMPLICIT if chosen.order <= 2 else COMPOSED


def measure_rows(id: str, values: dict, label: str) -> Rows:
    """Measure the growth of a method's round-off on the oscillator, over an ensemble of starts: one row, by table name.

    ``values`` are the method's parameters, ``label`` its name in the row.  If growth cannot be measured, the row has
    the reason.
    """
    made, steps = problem(brouwer.PROBLEM), steps_of(id)
    row = {"label": label, "method": id, "h": H, "steps": steps, "reason": BY_ID[id].lacks(made.system) or ""}
    told = None if row["reason"] else how(id, values)
    if told is None:
        row["reason"] = row["reason"] or "its exact matrix on the oscillator is not known here"
        return {TABLE: [row]}
    rows = [0, *(ROWS // 2**k for k in range(6, -1, -1))]
    n = np.array(rows) * (steps // ROWS)
    Q, P = brouwer.runs(id, values, H, steps, brouwer.starts_of(brouwer.STARTS), ROWS)
    if not (np.isfinite(Q).all() and np.isfinite(P).all()):
        return {TABLE: [row | {"reason": "runs end before their last step"}]}
    by, M = told
    with mpmath.workdps(brouwer.DIGITS):
        energy, phase = (x[:, 1:] for x in brouwer.errors(M, n, Q[:, rows], P[:, rows]))
    row |= {"by": by, "in lanes": batches.runs_in_lanes(made.system, BY_ID[id])}
    return {TABLE: [row | brouwer.summary(n[1:], H, energy, phase if by == EXACT else None)]}


def how(id: str, values: dict) -> tuple[str, mpmath.matrix] | None:
    """Choose how a method's energy error is measured: (`EXACT` or `ENERGY`, step matrix whose invariant |w|^2 is used).

    None if neither an exact step matrix is known nor H is kept.
    """
    with mpmath.workdps(brouwer.DIGITS):
        if exact_maps.has_exact_map(id):
            return EXACT, exact_maps.exact_matrix(id, values, H)
        # |w|^2 of an exact rotation is H
        return (ENERGY, exact_maps.exact_matrix("deuflhard", {}, H)) if BY_ID[id].energy == "round-off" else None
