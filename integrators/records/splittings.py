"""Records of splitting methods of kicks and drifts, from the tables of `coefficients`.

Methods for any separable H are of the family `parametric`: compositions of symplectic Euler methods, which run on every
system.  Methods that need a quadratic kinetic energy are of the family `splitting`, with weights (a, b) as data, or
`force_gradient`, with modified kicks.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from phasebench.integrators import coefficients
from phasebench.integrators.coefficients import GROUPS, Table
from phasebench.integrators.coefficients.fractions import substeps
from phasebench.integrators.compile.lazy import mpmath
from phasebench.integrators.record import BOUNDED, SYMPLECTIC, Method

if TYPE_CHECKING:
    from phasebench.integrators.coefficients.force_gradient import ForceGradientTable, Substep

QUADRATIC = ("separable", "quadratic kinetic energy")
NAMES = {
    "splitting": "splitting",
    "nystrom": "Nystrom splitting",
    "near-integrable": "splitting for A + eps B",
}


def weights(table: Table) -> tuple[tuple, tuple]:
    """The weights (a, b) of a table's drifts and kicks: kick b_k before drift a_k, b_0 = 0 if a drift is the first."""
    stages = {"A": [], "B": [] if table.first == "B" else [mpmath.mpf(0)]}
    for letter, weight in coefficients.steps(table.name):
        stages[letter].append(weight)
    return tuple(stages["A"]), tuple(stages["B"])


def rows(substeps: Iterable[Substep]) -> tuple[tuple, ...]:
    """Group the substeps of a step into rows (a, b, c): a drift a, then a modified kick with the coefficients b, c.

    ``substeps`` are ("A", a, 0) for drifts and ("B", b, c) for kicks exp(b h B + c h^3 [B, [A, B]]) in turn.  The
    first row has a = 0: it is the first kick if the step begins with one, else zeros, and the drift begins row two.
    """
    zero = mpmath.mpf(0)
    out = [[zero, zero, zero]]
    for letter, weight, c in substeps:
        if letter == "A":
            out.append([weight, zero, zero])
        else:
            out[-1][1:] = weight, c
    return tuple(map(tuple, out))


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
        source=table.source,
        cite=table.cite,
        requires=QUADRATIC if nystrom else (),
        data=lambda: weights(table) if nystrom else (1, substeps(coefficients.steps(table.name))),
        **(SYMPLECTIC | {"symmetric": table.symmetric}),
    )


def force_gradient(table: ForceGradientTable) -> Method:
    """Make the record of the splitting with modified kicks (force gradients) of a table."""
    free = table.hessian_free
    return Method(
        id=table.name,
        name=f"{table.source}: {'Hessian-free force gradient' if free else 'force gradient'}",
        family="force_gradient",
        order=table.classical_order,
        source=table.source,
        cite=table.cite,
        requires=QUADRATIC,
        data=lambda: (rows(coefficients.steps(table.name)), free),
        **(SYMPLECTIC | {"symplectic": not free} | ({"quadratic": BOUNDED} if free else {})),
    )


METHODS: tuple[Method, ...] = (
    *(record(t) for t in coefficients.TABLES if t.kind in NAMES),
    *map(force_gradient, GROUPS["force_gradient"]),
    *map(record, GROUPS["sampling"]),
)
