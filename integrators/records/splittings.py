"""Records of splitting methods of kicks and drifts, from the tables of `coefficients`.

Methods for any separable H are of the family `parametric`: compositions of symplectic Euler methods, which run on every
system.  Methods that need a quadratic kinetic energy are of the family `splitting`, with weights (a, b) as data.
"""

from __future__ import annotations

import mpmath

from phasebench.integrators import coefficients
from phasebench.integrators.coefficients import GROUPS, Table
from phasebench.integrators.coefficients.fractions import substeps
from phasebench.integrators.record import BOUNDED, ROUND_OFF, Method

NAMES = {
    "splitting": "splitting",
    "nystrom": "Nystrom splitting",
    "near-integrable": "splitting for A + eps B",
}


def weights(table: Table) -> tuple[tuple, tuple]:
    """The weights (a, b) of the drifts and of the kicks of a table, in alternating order.

    Kick b_k comes before drift a_k; b_0 is 0 if the step begins with a drift.
    """
    stages = {"A": [], "B": [] if table.first == "B" else [mpmath.mpf(0)]}
    for letter, weight in coefficients.steps(table.name):
        stages[letter].append(weight)
    return tuple(stages["A"]), tuple(stages["B"])


def generalised(table: Table) -> str:
    """What a method's name says of a generalised order; "" for a table with a single order."""
    return f" of generalised order ({','.join(map(str, table.order))})" if len(table.order) > 1 else ""


def record(table: Table) -> Method:
    """Make the record of the splitting of a table."""
    nystrom = table.kind == "nystrom"
    what = "splitting for sampling" if table.printed else NAMES[table.kind]
    return Method(
        id=table.name,
        name=f"{table.source.split(';')[0]}: {what}{generalised(table)}",
        family="splitting" if nystrom else "parametric",
        order=table.classical_order,
        symmetric=table.symmetric,
        symplectic=True,
        energy=BOUNDED,
        quadratic=ROUND_OFF,
        source=table.source,
        cite=table.cite,
        requires=("separable", "quadratic kinetic energy") if nystrom else (),
        data=weights(table) if nystrom else (1, substeps(coefficients.steps(table.name))),
    )


METHODS: tuple[Method, ...] = tuple(record(t) for t in coefficients.TABLES if t.kind in NAMES)
#: Splittings for sampling and molecular dynamics, used as printed.
SAMPLING: tuple[Method, ...] = tuple(map(record, GROUPS["sampling"]))
