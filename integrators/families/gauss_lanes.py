"""Gauss's methods with their stages in lanes: where that serves, and what the kernel `stage_lanes` is handed."""

from __future__ import annotations

import mpmath

from phasebench.integrators.coefficients.tableaus import LEVELS, tableau
from phasebench.integrators.engine import codegen, lane_formulae
from phasebench.integrators.engine.codegen import DOUBLE
from phasebench.integrators.engine.kernel import Prepared, array
from phasebench.integrators.engine.lazy import sympy as sp

from .lane_rows import components
from .stage_lanes import Lanes, run

#: Fewer stages than these gain nothing.
FEWEST = 2


def diagonal(system) -> bool:
    """Whether H = sum p_i^2 / 2 m_i + V(q)."""
    return system.quadratic_kinetic and all(e.free_symbols <= {p} for e, p in zip(system.dq, system.p, strict=True))


def serves(s: int, system) -> bool:
    """Whether the stages are worth lanes, and the functions are made of what lanes have.

    Of a quadratic T that is no diagonal form the Nystrom form, stage by stage, is the cheaper.
    """
    if s < FEWEST or codegen.value_kind(system.d) != "tuple" or diagonal(system) != system.quadratic_kinetic:
        return False
    return lane_formulae.known([*system.dq, *system.dp])


def padded(row, lanes: int, filler) -> list:
    """The row with the filler in the lanes that are left over."""
    return [*row, *[filler] * (lanes - len(row))]


def squared(rows, lanes: int) -> list[list]:
    """The rows with zeros in the lanes and in the rows that are left over."""
    rows = [padded(row, lanes, 0) for row in rows]
    return rows + [[0] * lanes] * (lanes - len(rows))


def _of_kicks(system, lanes, arithmetic, digits):
    """(-grad V in lanes, the inverse masses)."""
    forces = lane_formulae.function(
        "forces",
        [("q", system.q)],
        lambda: [-sp.diff(system.potential, x) for x in system.q],
        lanes,
        system,
        arithmetic,
    )
    masses = [mpmath.mpf(sp.diff(v, p).evalf(digits)) for v, p in zip(system.dq, system.p, strict=True)]
    return forces, array([masses], arithmetic)


def _of_both(system, lanes, arithmetic):
    """(The field in lanes, None)."""
    arguments = [("q", system.q), ("p", system.p)]
    return lane_formulae.function("field", arguments, lambda: [*system.dq, *system.dp], lanes, system, arithmetic), None


def functions(system, lanes, arithmetic, digits):
    """(f in lanes of `stage_lanes.Lanes`, the inverse masses or None)."""
    if diagonal(system):
        return _of_kicks(system, lanes, arithmetic, digits)
    return _of_both(system, lanes, arithmetic)


def starts(extrapolation, s, lanes):
    """Rows of the weights of each earlier step, for a start from one step, then for one from two."""
    for first in range(0, len(extrapolation), s):
        weights = list(zip(*extrapolation[first : first + s], strict=True))
        for step in range(0, len(weights), s):
            yield from squared(weights[step : step + s], lanes)


def laned(s: int, system, arithmetic) -> Lanes:
    """The tableau of Gauss of s stages, with the functions of the system."""
    lanes = 1 << (s - 1).bit_length()
    digits = 40 if arithmetic == DOUBLE else mpmath.mp.dps + 10
    unit = mpmath.mpf(2) ** (-52 if arithmetic == DOUBLE else 1 - mpmath.mp.prec)
    kicks = diagonal(system)
    t = tableau("gauss", s, s, kicks, digits, unit)
    b = [t.B[i][i] for i in range(s)]
    f, inverse_mass = functions(system, lanes, arithmetic, digits)
    late = t.weights[0] if kicks else [0] * s
    before, middle = [2 * (2 * i < s - 2) for i in range(s)], [int(abs(2 * i - s + 1) <= 1) for i in range(s)]
    nodes = [padded(t.c, lanes, t.c[0]), *(padded(row, lanes, 0) for row in (b, late, before, middle))]
    return Lanes(
        f,
        like=(0.0,) * lanes,
        stages=s,
        inverse_mass=inverse_mass,
        nodes=array(nodes, arithmetic),
        A=array(squared((padded(column, lanes, column[0]) for column in zip(*t.A_q, strict=True)), lanes), arithmetic),
        extrapolation=array(starts(t.extrapolation, s, lanes), arithmetic),
        steps=len(t.extrapolation) // s,
    )


def prepare(s: int, system, arithmetic) -> Prepared:
    """Gauss of s stages."""
    step = laned(s, system, arithmetic)
    return Prepared(run, step, *room(step, system.d), linear=len(step.like) * components(step.inverse_mass, system.d))


def room(step: Lanes, d: int) -> tuple[int, int]:
    """Columns of the memory, and the number of stages that gives it rows enough."""
    rows = 4 + (6 + step.steps) * components(step.inverse_mass, d)
    return max(len(step.like), components(step.inverse_mass, d)), -(-rows // (3 * LEVELS + 1))
