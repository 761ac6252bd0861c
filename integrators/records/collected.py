"""Records of splittings and of compositions of Stormer-Verlet, with the coefficients of `coefficients.collected`."""

from __future__ import annotations

from phasebench.integrators.coefficients.collected import FILE
from phasebench.integrators.coefficients.fractions import substeps
from phasebench.integrators.coefficients.table import Table
from phasebench.integrators.record import BOUNDED, ROUND_OFF, Method

from .compositions import BASES, compose
from .processed import weights
from .splittings import NAMES


def _composition(table: Table) -> Method:
    base = BASES["stormer-verlet"]
    return compose(
        base,
        FILE.steps(table.name),
        id=table.name,
        name=f"{base.name}, composed by {table.name}",
        order=table.classical_order,
        source=table.source,
        cite=(*base.cite, *table.cite),
    )


def _splitting(table: Table) -> Method:
    nystrom, steps = table.kind == "nystrom", FILE.steps(table.name)
    generalised = f" of generalised order ({','.join(map(str, table.order))})" if len(table.order) > 1 else ""
    return Method(
        id=table.name,
        name=f"{table.source.split(';')[0]}: {NAMES[table.kind]}{generalised}",
        family="splitting" if nystrom else "parametric",
        order=table.classical_order,
        symmetric=True,
        symplectic=True,
        energy=BOUNDED,
        quadratic=ROUND_OFF,
        source=table.source,
        cite=table.cite,
        requires=("separable", "quadratic kinetic energy") if nystrom else (),
        data=weights(steps) if nystrom else (1, substeps(steps)),
    )


METHODS: tuple[Method, ...] = tuple(_composition(t) if t.gamma else _splitting(t) for t in FILE.tables.values())
