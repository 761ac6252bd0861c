"""Brouwer's law for every method that is symplectic or keeps the energy: as many starts as `brouwer`, fewer steps.

The energy's error is that of |w|^2 by the exact matrix of a step where it is known (`exact_maps`), else of H itself
where a method keeps H.  A matrix in doubles would not do: |w|^2 then oscillates by more than the law.  The phase is
told by the exact matrix alone.

A state is known to a rounding, so that the law shows where eps h n^(1/2) is above eps: the step is eight times that of
the long runs, and the runs may be short.
"""

from __future__ import annotations

import mpmath
import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.rows.cells import Cell, Problem, Rows, content
from phasebench.integrators import lots
from phasebench.integrators.registry import BY_ID, METHODS

from . import brouwer, exact_maps

H, ROWS = 0.0987654321, 64
#: Steps of a run in lanes, of explicit substeps and of implicit ones; without lanes, and where a step is dearest.
EXPLICIT, IMPLICIT, COMPOSED, ALONE, DEAR = 524_288, 131_072, 32_768, 16_384, 4_096
#: lambda is a little beside 1/3, next to which round-off drifts.
BESIDE = {"lam": brouwer.BESIDE}
#: How the energy's error is told.
EXACT, ENERGY = "exact matrix", "energy"
TABLE = "extremes_growth_every"


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each method."""
    return [] if quick else [_cell(m.id) for m in METHODS if m.symplectic or m.energy == "round-off"]


def _cell(id: str) -> Cell:
    values = {name: x for name, x in BESIDE.items() if name in BY_ID[id].parameters}
    needs = content("growth-every", BY_ID[id], values, Problem(brouwer.PROBLEM), code=[__name__])
    key = {"label": brouwer.label(id, values), "h": H, "steps": steps_of(id)}
    return Cell("extremes", (TABLE,), key, measured, (id, values, key["label"]), needs, frozenset({id}))


def steps_of(id: str) -> int:
    """The steps of a run: more where one costs less."""
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


def measured(id: str, values: dict, label: str) -> Rows:
    """The row of a method; where it has no ensemble, with the reason."""
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
    row |= {"by": by, "in lanes": lots.able(made.system, BY_ID[id])}
    return {TABLE: [row | brouwer.summary(n[1:], H, energy, phase if by == EXACT else None)]}


def how(id: str, values: dict):
    """(how the energy's error is told, the matrix of which |w|^2 is taken), or None."""
    with mpmath.workdps(brouwer.DIGITS):
        if exact_maps.known(id):
            return EXACT, exact_maps.exact_matrix(id, values, H)
        # |w|^2 of a rotation is H
        return (ENERGY, exact_maps.exact_matrix("deuflhard", {}, H)) if BY_ID[id].energy == "round-off" else None
