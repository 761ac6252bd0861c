r"""The orders of McLachlan and Atela's methods of orders 4 and 5 for a quadratic kinetic energy T, and for another one.

.. math:: T = p^2/2 \quad\text{or}\quad T = \sqrt{1 + p^2},\qquad V = q^2/2 + q^4/4

The coefficients are those of this suite, composed here for any T: kicks by b_i, then drifts by a_i.

Source: R. I. McLachlan, P. Atela, Nonlinearity 5 (1992) 541-562; OrdinaryDiffEq.jl, documentation.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from phasebench.benchmarks.store.cells import Cell, Rows, content
from phasebench.integrators.registry import BY_ID

TABLE = "field_says_orders"
METHODS = {"mclachlan-atela-4": ("McAte4", 4), "mclachlan-atela-5": ("McAte5", 5)}
QUADRATIC, OTHER = "p²/2", "√(1 + p²)"
START, SPAN, STEPS = (0.7, 0.4), 4.0, (64, 128, 256)


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each method; none if ``quick``."""
    return [] if quick else [_cell(id) for id in METHODS]


def _cell(id: str) -> Cell:
    needs = content(TABLE, BY_ID[id], START, SPAN, STEPS, code=[__name__])
    return Cell("field_says", (TABLE,), {"method": id}, measure_rows, (id,), needs, frozenset({id}))


def end(id: str, steps: int, quadratic: bool) -> np.ndarray:
    """Integrate to the time `SPAN` by ``steps`` steps of a method, and return the end state (q, p), array (2,).

    The kinetic energy is p^2 / 2 if ``quadratic``, else sqrt(1 + p^2).
    """
    a, b = (tuple(map(float, x)) for x in BY_ID[id].data)
    (q, p), h = START, SPAN / steps
    for _ in range(steps):
        for drift, kick in zip(a, b, strict=True):
            p -= h * kick * (q + q**3)
            q += h * drift * (p if quadratic else p / np.sqrt(1 + p * p))
    return np.array([q, p])


def measure_rows(id: str) -> Rows:
    """Measure a method's order from its errors at three steps: a row for each kinetic energy, by table name.

    The order in the column "order" comes from the errors at the two smaller steps, that in "before" from the errors at
    the two larger ones.
    """
    rows = []
    for name in (QUADRATIC, OTHER):
        finest = end(id, 16 * STEPS[-1], name == QUADRATIC)
        errors = [np.abs(end(id, n, name == QUADRATIC) - finest).max() for n in STEPS]
        found = [float(np.log2(x / y)) for x, y in pairwise(errors)]
        called, said = METHODS[id]
        rows.append({"method": id, "called": called, "said": said, "T": name, "order": found[-1], "before": found[0]})
    return {TABLE: rows}
