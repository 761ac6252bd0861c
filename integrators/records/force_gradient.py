"""Records of splittings with modified kicks (force gradients), from the tables of `coefficients`."""

from __future__ import annotations

from collections.abc import Iterable

import mpmath

from phasebench.integrators.coefficients import GROUPS, steps
from phasebench.integrators.coefficients.force_gradient import ForceGradientTable, Substep
from phasebench.integrators.record import BOUNDED, ROUND_OFF, Method


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


def _record(table: ForceGradientTable) -> Method:
    free = table.hessian_free
    return Method(
        id=table.name,
        name=f"{table.source}: {'Hessian-free force gradient' if free else 'force gradient'}",
        family="force_gradient",
        order=table.classical_order,
        symmetric=table.symmetric,
        symplectic=not free,
        energy=BOUNDED,
        quadratic=BOUNDED if free else ROUND_OFF,
        source=table.source,
        cite=table.cite,
        requires=("separable", "quadratic kinetic energy"),
        data=(rows(steps(table.name)), free),
    )


METHODS: tuple[Method, ...] = tuple(map(_record, GROUPS["force_gradient"]))
