r"""Gauss's methods with their stages in lanes: the kernel; `gauss_lanes` says what it serves, and prepares it.

The equations are those of `collocation`, with the same coefficients.  Unknown are the increments, here the lanes of one
row for each component.  In general these are the increments :math:`x_j` of q and p,

.. math::
    Z_i = y + \sum_j A_{ij}\,x_j,\qquad x_i = h\,b_i\,f(Z_i),\qquad y_1 = y + \sum_j x_j,

with :math:`A_{ij} + A_{ji} = 1` of the doubles.  For :math:`H = \sum p_i^2 / 2 m_i + V(q)` they are the kicks alone
(Nystrom form),

.. math::
    Q_i = q + c_i\,hv + hM^{-1}\sum_j \bar A_{ij}\,x_j,\qquad x_i = -h\,b_i\,\nabla V(Q_i),

    q_1 = q + hv + hM^{-1}\sum_j (1 - c_j)\,x_j,\qquad p_1 = p + \sum_j x_j ,

with :math:`\bar A_{ij} - \bar A_{ji} = c_i - c_j` of the doubles.  So the map is symplectic but for what the evaluation
rounds.  All stages are evaluated at once, by a function of lanes; the stage sums are products of a matrix with lanes.
Lanes that pad s to a power of two repeat the first stage with the weight b = 0, so that their increments are zero.

The increments start from the polynomial through those of the last two steps, and are iterated to round-off by the one
solver of stage equations, with Newton's method where the fixed point does not contract: its unknowns are the rows here
too.

Source: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), II.2 and VIII.6; M. Antonana, J.
Makazaga, A. Murua, arXiv 2511.03655 (2026) (stages in SIMD lanes); rounding: E. Hairer, R. McLachlan, A. Razakarivony,
BIT 48 (2008) 231-243.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from phasebench.integrators.engine.lanes import combine, put, take, total
from phasebench.integrators.engine.solve import SOLVED, difference, row_solver
from phasebench.integrators.engine.vector import (
    advanced,
    chosen,
    close,
    inlined,
    keep,
    load,
    opened,
    size,
    store,
)


class Lanes(NamedTuple):
    """The tableau with its stages in lanes, in the Nystrom form where ``inverse_mass`` is not None.

    ``f(memory)`` reads the places from the first rows of the memory and writes to as many that follow: the field, of q
    and p; in the Nystrom form -grad V.  ``like`` has a zero for each lane.  ``inverse_mass`` has one row, d
    numbers.  ``nodes`` has the rows c, b and 1 - c; ``A`` the rows of A transposed; ``extrapolation`` those for one
    step, then for two; rows for the lanes that pad the ``stages`` are zero, so that a kernel serves all s of as many
    lanes.
    """

    f: Callable
    like: tuple
    stages: int
    inverse_mass: np.ndarray | None
    nodes: np.ndarray
    A: np.ndarray
    extrapolation: np.ndarray
    steps: int
    h: float = 0.0
    eps: float = 0.0


class Equations(NamedTuple):
    """Of the increments, in ``stages`` rows of the memory, a component each.

    Rows from ``base`` on are q and p, in the Nystrom form q, h M^-1 p and p; then, of four, the increments of a step.
    """

    step: Lanes
    memory: np.ndarray
    base: int
    stages: int
    like: tuple
    h: float


# -- the two forms ----------------------------------------------------------------------------------------------------


def _places_of_both(inverse_mass, e, at):
    step, memory, d = e.step, e.memory, e.stages // 2
    for k in range(d):
        x, y = take(memory, at + k, e.like), take(memory, at + d + k, e.like)
        put(memory, k, combine(memory[e.base, k], x, 1.0, step.A, 0, e.like), e.like)
        put(memory, d + k, combine(memory[e.base + 1, k], y, 1.0, step.A, 0, e.like), e.like)


def _places_of_kicks(inverse_mass, e, at):
    step, memory = e.step, e.memory
    c = take(step.nodes, 0, e.like)
    for k in range(e.stages):
        start = memory[e.base, k] + memory[e.base + 1, k] * c
        x = take(memory, at + k, e.like)
        put(memory, k, combine(start, x, e.h * inverse_mass[0, k], step.A, 0, e.like), e.like)


def _lengths_of_both(inverse_mass, e, at):
    d = e.stages // 2
    return extent(e, 0, d) + length(e, at, 0, d), extent(e, 1, d) + length(e, at, d, e.stages)


def _lengths_of_kicks(inverse_mass, e, at):
    momenta = extent(e, 2, e.stages) + length(e, at, 0, e.stages)
    return momenta, momenta


def _begin_both(inverse_mass, e, y):
    store(e.memory, e.base, y.q)
    store(e.memory, e.base + 1, y.p)


def _begin_kicks(inverse_mass, e, y):
    memory = e.memory
    store(memory, e.base, y.q)
    store(memory, e.base + 2, y.p)
    for k in range(e.stages):
        memory[e.base + 1, k] = e.h * inverse_mass[0, k] * memory[e.base + 2, k]


def _end_both(inverse_mass, e, at):
    memory, d = e.memory, e.stages // 2
    for k in range(d):
        memory[e.base + 2, k] = total(take(memory, at + k, e.like))
        memory[e.base + 3, k] = total(take(memory, at + d + k, e.like))


def _end_kicks(inverse_mass, e, at):
    memory = e.memory
    late = take(e.step.nodes, 2, e.like)
    for k in range(e.stages):
        x = take(memory, at + k, e.like)
        drift = e.h * inverse_mass[0, k] * total(late * x)
        memory[e.base + 2, k], memory[e.base + 3, k] = memory[e.base + 1, k] + drift, total(x)


#: Components of an increment, of d degrees of freedom.
components = chosen(lambda inverse_mass, d: 2 * d, lambda inverse_mass, d: d)
#: Write the places that the increments in the rows ``at``, ... make to the first rows.
places = chosen(_places_of_both, _places_of_kicks)
#: How far the place k moves for a unit of its increment, but for A.
reach = chosen(lambda inverse_mass, e, k: 1.0, lambda inverse_mass, e, k: e.h * inverse_mass[0, k])
#: How large the variables are that the first and the second half of the rows ``at``, ... move.
lengths = chosen(_lengths_of_both, _lengths_of_kicks)
#: Write the state of which a step's equations speak.
begin = chosen(_begin_both, _begin_kicks)
#: Write the increments of q and p over the step.
sums = chosen(_end_both, _end_kicks)


# -- what they share --------------------------------------------------------------------------------------------------


@inlined
def extent(e, row, d):
    """The size of the d numbers in a row from ``base`` on."""
    s = 0.0
    for k in range(d):
        s = s + abs(e.memory[e.base + row, k])
    return s


@inlined
def length(e, at, first, last):
    """The size of the unknowns ``first``, ... before ``last`` in the rows ``at``, ... and of what they map to."""
    s = 0.0
    for k in range(first, last):
        s = s + total(abs(take(e.memory, at + k, e.like)) + abs(take(e.memory, at + e.stages + k, e.like)))
    return s


@inlined
def sweep(e, old, new):
    """Write the increments at the places that those in rows ``old`` make to rows ``new``: (their distance, size)."""
    step, memory = e.step, e.memory
    places(step.inverse_mass, e, old)
    step.f(memory)
    weights = e.h * take(step.nodes, 1, e.like)
    moved, sized = 0.0 * weights, 0.0 * weights
    for k in range(e.stages):
        x = weights * take(memory, e.stages + k, e.like)
        moved = moved + abs(x - take(memory, old + k, e.like))
        sized = sized + abs(x)
        put(memory, new + k, x, e.like)
    return total(moved), total(sized)


@inlined
def linearize(e, at, span, work):
    """G of the rows ``at``, and the matrix of 1 - G' by differences of f, in all lanes at once."""
    step, memory, rows, n = e.step, e.memory, e.stages, len(e.like)
    sweep(e, at, at + rows)
    for a in range(rows * n):
        for b in range(rows * n):
            work[a, b] = 1.0 if a == b else 0.0
    first, second = lengths(step.inverse_mass, e, at)
    weights = e.h * take(step.nodes, 1, e.like)
    for k in range(rows):
        change = difference(first if 2 * k < rows else second, span, step.eps)
        places(step.inverse_mass, e, at)
        put(memory, k, take(memory, k, e.like) + change * reach(step.inverse_mass, e, k), e.like)
        step.f(memory)
        for r in range(rows):
            slope = weights * take(memory, rows + r, e.like) - take(memory, at + rows + r, e.like)
            put(memory, rows + r, slope * (1.0 / change), e.like)
            for i in range(n):
                for j in range(n):
                    work[r * n + i, k * n + j] -= memory[rows + r, i] * step.A[j, i]
    return rows + 1


solve = row_solver(sweep, linearize)


@inlined
def extrapolate(e, ring, known, at):
    """Continue the increments of the last steps, in rows from ``ring`` on, into the rows ``at``, ..."""
    step, memory, rows = e.step, e.memory, e.stages
    steps = min(known, step.steps)
    row = steps * (steps - 1) // 2 * len(e.like)
    for k in range(rows):
        x = 0.0 * take(step.extrapolation, 0, e.like)
        for back in range(steps, 0, -1):
            y = take(memory, ring + (known - back) % step.steps * rows + k, e.like)
            x = combine(x, y, 1.0, step.extrapolation, row + (back - 1) * len(e.like), e.like)
        put(memory, at + k, x, e.like)


@inlined
def enter(e, ring, known, at):
    """Enter the increments in the rows ``at``, ... of the step after ``known`` others into `extrapolate`'s ring."""
    newest = ring + known % e.step.steps * e.stages
    for k in range(e.stages):
        put(e.memory, newest + k, take(e.memory, at + k, e.like), e.like)


@inlined
def equations(step, orbit, h):
    """The equations of a step of length h."""
    rows = components(step.inverse_mass, len(orbit.zero))
    return Equations(step, orbit.memory, 2 * rows, rows, step.like, h)


@inlined
def end(e, at, y, zero):
    """The state after the step whose increments are in the rows ``at``, ..."""
    sums(e.step.inverse_mass, e, at)
    return advanced(y, load(e.memory, e.base + 2, zero), load(e.memory, e.base + 3, zero))


def run(step, orbit, samples, counts):
    """The kernel."""
    y = opened(orbit)
    e = equations(step, orbit, step.h)
    ring = e.base + 4
    at = ring + step.steps * e.stages
    for row in range(len(samples.q)):
        for _ in range(samples.every):
            begin(step.inverse_mass, e, y)
            extrapolate(e, ring, counts.steps, at)
            sweeps, newton, status = solve(e, at, size(y.q) + size(y.p), step.eps, orbit.work)
            counts.gradient += (sweeps + newton) * step.stages
            counts.newton += min(newton, 1)
            if status != SOLVED:
                close(orbit, y)
                return row, status
            enter(e, ring, counts.steps, at)
            y = end(e, at, y, orbit.zero)
            counts.steps += 1
        keep(samples, row, y)
    close(orbit, y)
    return len(samples.q), 0
