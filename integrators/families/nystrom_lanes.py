r"""Symplectic Nystrom methods with their stages in lanes: Gauss of 2 stages and more, for H = sum p_i^2 / 2 m_i + V(q).

The equations are those of `collocation` in the Nystrom form, with the same coefficients: unknown are the kicks
:math:`x_1, \dots, x_s`, here the lanes of one row for each degree of freedom,

.. math::
    Q_i = q + c_i\,hv + hM^{-1}\sum_j \bar A_{ij}\,x_j,\qquad x_i = -h\,b_i\,\nabla V(Q_i),

    q_1 = q + hv + hM^{-1}\sum_j (1 - c_j)\,x_j,\qquad p_1 = p + \sum_j x_j .

:math:`\bar A_{ij} - \bar A_{ji} = c_i - c_j` holds of the doubles, so that the map is symplectic but for what the
evaluation rounds.  All forces are evaluated at once, by a function of lanes; the stage sums are products of a matrix
with lanes.  Lanes that pad s to a power of two repeat the first stage with the weight b = 0, so that their kicks
are zero.

The kicks start from the polynomial through those of the last two steps, and are iterated to round-off by the one solver
of stage equations, with Newton's method where the fixed point does not contract: its unknowns are the rows here too.

Source: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), II.2 and VIII.6; M. Antonana, J.
Makazaga, A. Murua, arXiv 2511.03655 (2026) (stages in SIMD lanes); rounding: E. Hairer, R. McLachlan, A. Razakarivony,
BIT 48 (2008) 231-243.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import mpmath
import numpy as np
from numba import types

from phasebench.integrators.coefficients.tableaus import LEVELS, tableau
from phasebench.integrators.engine import codegen, elementary
from phasebench.integrators.engine import lanes as lane_operations
from phasebench.integrators.engine.codegen import DOUBLE
from phasebench.integrators.engine.kernel import Prepared, array
from phasebench.integrators.engine.lanes import combine, put, take, total
from phasebench.integrators.engine.lazy import sympy as sp
from phasebench.integrators.engine.solve import SOLVED, difference, row_solver
from phasebench.integrators.engine.vector import (
    advanced,
    close,
    inlined,
    keep,
    load,
    opened,
    size,
    store,
)

#: Fewer stages than these gain nothing.
FEWEST = 2
#: SymPy's names of functions that lanes have; any other needs `collocation`.
KNOWN = ("Add", "Mul", "Pow", "sin", "cos", "exp")


class Lanes(NamedTuple):
    """The tableau with its stages in lanes.

    ``forces(memory)`` reads the places from the first d rows of the memory and writes -grad V to the d rows that
    follow.  ``like`` and ``stages`` are zeros, one a lane and one a stage.  ``inverse_mass`` has one row, d numbers.
    ``nodes`` has the rows c, b and 1 - c; ``A`` the stages' rows of A transposed; ``extrapolation`` those for one
    step, then for two.
    """

    forces: Callable
    like: tuple
    stages: tuple
    inverse_mass: np.ndarray
    nodes: np.ndarray
    A: np.ndarray
    extrapolation: np.ndarray
    steps: int
    h: float = 0.0
    eps: float = 0.0


class Equations(NamedTuple):
    """Of the kicks, in rows of the memory; its rows from ``base`` on are q, h M^-1 p and p, then increments."""

    step: Lanes
    memory: np.ndarray
    base: int
    stages: int
    like: tuple
    h: float


@inlined
def places(e, at):
    """Write Q of the kicks in the rows ``at``, ... to the first rows."""
    step, memory = e.step, e.memory
    c = take(step.nodes, 0, e.like)
    for k in range(e.stages):
        start = memory[e.base, k] + memory[e.base + 1, k] * c
        x = take(memory, at + k, e.like)
        put(memory, k, combine(start, x, e.h * step.inverse_mass[0, k], step.A, 0, step.stages), e.like)


@inlined
def sweep(e, old, new):
    """Write the kicks at the places that those in rows ``old`` make to rows ``new``: (their distance, their size)."""
    step, memory = e.step, e.memory
    places(e, old)
    step.forces(memory)
    weights = e.h * take(step.nodes, 1, e.like)
    moved, length = 0.0 * weights, 0.0 * weights
    for k in range(e.stages):
        x = weights * take(memory, e.stages + k, e.like)
        moved = moved + abs(x - take(memory, old + k, e.like))
        length = length + abs(x)
        put(memory, new + k, x, e.like)
    return total(moved), total(length)


@inlined
def linearize(e, at, span, work):
    """G of the rows ``at``, and the matrix of 1 - G' by differences of the forces, in all lanes at once."""
    step, memory, d, n = e.step, e.memory, e.stages, len(e.like)
    sweep(e, at, at + d)
    for a in range(d * n):
        for b in range(d * n):
            work[a, b] = 1.0 if a == b else 0.0
    length = 0.0
    for k in range(d):
        x = abs(take(memory, at + k, e.like)) + abs(take(memory, at + d + k, e.like))
        length = length + abs(memory[e.base + 2, k]) + total(x)
    change = difference(length, span, step.eps)
    weights = e.h * take(step.nodes, 1, e.like)
    for k in range(d):
        places(e, at)
        put(memory, k, take(memory, k, e.like) + change * (e.h * step.inverse_mass[0, k]), e.like)
        step.forces(memory)
        for r in range(d):
            slope = weights * take(memory, d + r, e.like) - take(memory, at + d + r, e.like)
            put(memory, d + r, slope * (1.0 / change), e.like)
            for i in range(n):
                for j in range(len(step.stages)):
                    work[r * n + i, k * n + j] -= memory[d + r, i] * step.A[j, i]
    return d + 1


solve = row_solver(sweep, linearize)


@inlined
def extrapolate(e, ring, known, at):
    """Continue the kicks of the last steps, in rows from ``ring`` on, into the rows ``at``, ..."""
    step, memory, d = e.step, e.memory, e.stages
    steps = min(known, step.steps)
    row = steps * (steps - 1) // 2 * len(step.stages)
    for k in range(d):
        x = 0.0 * take(step.nodes, 0, e.like)
        for back in range(steps, 0, -1):
            y = take(memory, ring + (known - back) % step.steps * d + k, e.like)
            x = combine(x, y, 1.0, step.extrapolation, row + (back - 1) * len(step.stages), step.stages)
        put(memory, at + k, x, e.like)


@inlined
def begin(e, y):
    """Write the state of which the step's equations speak."""
    memory = e.memory
    store(memory, e.base, y.q)
    store(memory, e.base + 2, y.p)
    for k in range(e.stages):
        memory[e.base + 1, k] = e.h * e.step.inverse_mass[0, k] * memory[e.base + 2, k]


@inlined
def end(e, at, y, zero):
    """The state after the step whose kicks are in the rows ``at``, ..."""
    memory = e.memory
    late = take(e.step.nodes, 2, e.like)
    for k in range(e.stages):
        x = take(memory, at + k, e.like)
        drift = e.h * e.step.inverse_mass[0, k] * total(late * x)
        memory[e.base + 2, k], memory[e.base + 3, k] = memory[e.base + 1, k] + drift, total(x)
    return advanced(y, load(memory, e.base + 2, zero), load(memory, e.base + 3, zero))


def run(step, orbit, samples, counts):
    """The kernel."""
    y = opened(orbit)
    memory, d = orbit.memory, len(orbit.zero)
    ring = 2 * d + 4
    at = ring + step.steps * d
    e = Equations(step, memory, 2 * d, d, step.like, step.h)
    for row in range(len(samples.q)):
        for _ in range(samples.every):
            begin(e, y)
            extrapolate(e, ring, counts.steps, at)
            sweeps, newton, status = solve(e, at, size(y.q) + size(y.p), step.eps, orbit.work)
            counts.gradient += (sweeps + newton) * len(step.stages)
            counts.newton += min(newton, 1)
            if status != SOLVED:
                close(orbit, y)
                return row, status
            newest = ring + counts.steps % step.steps * d
            for k in range(d):
                put(memory, newest + k, take(memory, at + k, e.like), e.like)
            y = end(e, at, y, orbit.zero)
            counts.steps += 1
        keep(samples, row, y)
    close(orbit, y)
    return len(samples.q), 0


# -- the functions and numbers that it is handed ----------------------------------------------------------------------


def serves(s: int, system) -> bool:
    """Whether the stages are worth lanes, T is a diagonal form and the forces are made of what lanes have."""
    if s < FEWEST or not system.quadratic_kinetic or codegen.value_kind(system.d) != "tuple":
        return False
    if any(set(e.free_symbols) - {p} for e, p in zip(system.dq, system.p, strict=True)):
        return False
    known = tuple(getattr(sp, name) for name in KNOWN)
    return all(isinstance(e, known) and not _root(e) for e in sp.preorder_traversal(system.potential) if e.args)


def _root(e) -> bool:
    """Whether a power is none that products and square roots make."""
    return isinstance(e, sp.Pow) and not (e.exp.is_Rational and e.exp.q <= 2 and abs(e.exp) <= 12)


def forces(system, lanes: int, arithmetic: str):
    """The function of the memory that `Lanes` describes."""
    d = system.d

    def text(arithmetic):
        from phasebench.integrators.engine import printing

        names = [(f"q_{k}", x) for k, x in enumerate(system.q)]
        formula = printing.source("g", names, [[-sp.diff(system.potential, x) for x in system.q]], arithmetic)
        unpacked = "".join(f"g_{k}, " for k in range(d))
        places = ", ".join(f"take(B, {k}, LIKE)" for k in range(d))
        return "\n".join(
            [
                "from phasebench.integrators.engine.elementary import cos, exp, sin, sqrt",
                "from phasebench.integrators.engine.lanes import put, take",
                "from phasebench.integrators.engine.vector import inlined",
                f"LIKE = {(0.0,) * lanes}",
                f"@inlined\n{formula.replace('value((', '((')}",
                f"def f(B):\n    {unpacked}= g({places})",
                *(f"    put(B, {d + k}, g_{k}, LIKE)" for k in range(d)),
                "",
            ]
        )

    signature = types.void(types.Array(types.float64, 2, "C"))
    key = f"forces in {lanes} lanes|{_operations()}|{system.content}"
    return codegen.function(key, text, d, signature, arithmetic)


@cache
def _operations() -> str:
    """The hash of the modules whose operations become a part of a generated function."""
    return hashlib.sha256(b"".join(Path(m.__file__).read_bytes() for m in (lane_operations, elementary))).hexdigest()


def padded(row, lanes: int, filler) -> list:
    """The row with the filler in the lanes that are left over."""
    return [*row, *[filler] * (lanes - len(row))]


def laned(s: int, system, arithmetic) -> Lanes:
    """The tableau of Gauss of s stages, with the forces of the system."""
    lanes = 1 << (s - 1).bit_length()
    digits = 40 if arithmetic == DOUBLE else mpmath.mp.dps + 10
    unit = mpmath.mpf(2) ** (-52 if arithmetic == DOUBLE else 1 - mpmath.mp.prec)
    t = tableau("gauss", s, s, True, digits, unit)
    b = [t.B[i][i] for i in range(s)]
    masses = [mpmath.mpf(sp.diff(v, p).evalf(digits)) for v, p in zip(system.dq, system.p, strict=True)]
    steps = len(t.extrapolation) // s
    starts = [zip(*t.extrapolation[s * m : s * (m + 1)], strict=True) for m in range(steps)]
    return Lanes(
        forces(system, lanes, arithmetic),
        like=(0.0,) * lanes,
        stages=(0.0,) * s,
        inverse_mass=array([masses], arithmetic),
        nodes=array([padded(t.c, lanes, t.c[0]), padded(b, lanes, 0), padded(t.weights[0], lanes, 0)], arithmetic),
        A=array([padded(column, lanes, column[0]) for column in zip(*t.A_q, strict=True)], arithmetic),
        extrapolation=array((padded(column, lanes, 0) for start in starts for column in start), arithmetic),
        steps=steps,
    )


def prepare(s: int, system, arithmetic) -> Prepared:
    """Gauss of s stages."""
    step = laned(s, system, arithmetic)
    return Prepared(run, step, *room(step, system.d), linear=len(step.like) * system.d)


def room(step: Lanes, d: int) -> tuple[int, int]:
    """Columns of the memory, and the number of stages that gives it rows enough."""
    rows = 4 + (6 + step.steps) * d
    return max(len(step.like), d), -(-rows // (3 * LEVELS + 1))
