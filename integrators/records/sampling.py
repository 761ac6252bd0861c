"""Records of splittings for sampling and molecular dynamics, used as printed."""

from __future__ import annotations

from phasebench.integrators.coefficients import GROUPS, Table, steps
from phasebench.integrators.coefficients.fractions import substeps
from phasebench.integrators.record import BOUNDED, ROUND_OFF, Method


def _record(table: Table) -> Method:
    return Method(
        id=table.name,
        name=f"{table.source}: splitting for sampling",
        family="parametric",
        order=table.classical_order,
        symmetric=table.symmetric,
        symplectic=True,
        energy=BOUNDED,
        quadratic=ROUND_OFF,
        source=table.source,
        cite=table.cite,
        data=(1, substeps(steps(table.name))),
    )


METHODS: tuple[Method, ...] = tuple(map(_record, GROUPS["sampling"]))
