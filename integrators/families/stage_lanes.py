r"""The kernel of Gauss's methods with their stages side by side in SIMD lanes; `gauss_lanes` prepares it.

The equations are those of `collocation`, with the same coefficients.  The unknowns are increments: a row for each
component, with a lane for each stage.  In general they are the increments :math:`x_j` of q and p,

.. math::
    Z_i = y + \sum_j A_{ij}\,x_j,\qquad x_i = h\,b_i\,f(Z_i),\qquad y_1 = y + \sum_j x_j,

with :math:`A_{ij} + A_{ji} = 1` exactly in doubles.  For :math:`H = \sum p_i^2 / 2 m_i + V(q)` they are the kicks alone
(Nystrom form),

.. math::
    Q_i = q + c_i\,hv + hM^{-1}\sum_j \bar A_{ij}\,x_j,\qquad x_i = -h\,b_i\,\nabla V(Q_i),

    q_1 = q + hv + hM^{-1}\sum_j (1 - c_j)\,x_j,\qquad p_1 = p + \sum_j x_j ,

with :math:`\bar A_{ij} - \bar A_{ji} = c_i - c_j` exactly in doubles.  So the map is symplectic up to the round-off of
the evaluation.  All stages are evaluated at once, by a function of lanes; the stage sums are products of a matrix with
lanes. Lanes that pad s to a power of two repeat the first stage with the weight b = 0, so that their increments are
zero.

The increments start from the polynomial through those of the last two steps, and are iterated to round-off by the
solver `solve.row_solver`, with Newton's method where the fixed point does not contract (`lane_rows`).

Source: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), II.2 and VIII.6; M. Antonana, J.
Makazaga, A. Murua, arXiv 2511.03655 (2026) (stages in SIMD lanes); rounding: E. Hairer, R. McLachlan, A. Razakarivony,
BIT 48 (2008) 231-243.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Carry
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.solve import row_solver
from phasebench.integrators.values.lanes import combine, put, take, total
from phasebench.integrators.values.vector import State, dispatch_on_none, inline, size

from .lane_rows import DP, DQ, DRIFT, FREE, ORIGIN, begin, components, ender, enter, extrapolate, lengths, shape

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Number

#: Rows of the nodes: c, b and 1 - c; for `exact_weights`, 2 before the middle and 0 after it, then 1 in the middle.
C, B, LATE, BEFORE, MIDDLE = range(5)


class Lanes(NamedTuple):
    """The coefficients of Gauss's method for s stages in SIMD lanes; a lane is a stage.

    Rows for lanes beyond the s stages are zero, so that one compiled kernel serves all s with the same number of lanes.

    Attributes
    ----------
    f : evaluates the field, or -grad V in the Nystrom form, at all stages at once (see `lane_rows`)
    like : a tuple of zeros, one for each lane
    stages : the number s of stages
    inverse_mass : 1 / m_i, array (1, d), in the Nystrom form, where increments of p alone are unknown; else None
    nodes : the rows `C` to `MIDDLE`: nodes c, weights b, 1 - c (0 if not in the Nystrom form), and two rows of factors
        for `exact_weights`
    A : array (lanes, lanes), the matrix A, or bar A in the Nystrom form, transposed
    extrapolation : rows that predict the increments from those of one earlier step, then from two
    steps : how many earlier steps the prediction uses at most
    h, eps : the step size and the unit round-off, set by the run
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
    """Arguments of the stage equations of a step; the memory is arranged as in `lane_rows`.

    Attributes
    ----------
    step : the coefficients of the method
    memory, base : the array, and its first row after those of the stages and values of the field
    stages : the number of components of an increment, each in a row with a lane for each stage
    like : a tuple of zeros, one for each lane
    h : the step size
    weights : h b_i in lanes
    """

    step: Lanes
    memory: np.ndarray
    base: int
    stages: int
    like: tuple
    h: float
    weights: Number


# -- the two forms ----------------------------------------------------------------------------------------------------


def _places_of_both(inverse_mass, e, at):
    step, memory = e.step, e.memory
    for k in range(e.stages):
        x = take(memory, at + k, e.like)
        put(memory, k, combine(memory[e.base + ORIGIN, k], x, 1.0, step.A, 0, e.like), e.like)


def _places_of_kicks(inverse_mass, e, at):
    step, memory = e.step, e.memory
    c = take(step.nodes, C, e.like)
    for k in range(e.stages):
        start = memory[e.base + ORIGIN, k] + memory[e.base + DRIFT, k] * c
        x = take(memory, at + k, e.like)
        put(memory, k, combine(start, x, e.h * inverse_mass[0, k], step.A, 0, e.like), e.like)


def _end_both(inverse_mass, e, at):
    memory, d = e.memory, e.stages // 2
    for k in range(d):
        memory[e.base + DQ, k] = total(take(memory, at + k, e.like))
        memory[e.base + DP, k] = total(take(memory, at + d + k, e.like))


def _end_kicks(inverse_mass, e, at):
    memory = e.memory
    late = take(e.step.nodes, LATE, e.like)
    for k in range(e.stages):
        x = take(memory, at + k, e.like)
        drift = e.h * inverse_mass[0, k] * total(late * x)
        memory[e.base + DQ, k], memory[e.base + DP, k] = memory[e.base + DRIFT, k] + drift, total(x)


#: Write the places that the increments in the rows ``at``, ... lead to, to the first rows.
places = dispatch_on_none(_places_of_both, _places_of_kicks)
#: Write the increments of q and p over the step.
sums = dispatch_on_none(_end_both, _end_kicks)


# -- what they share --------------------------------------------------------------------------------------------------


@inline
def exact_weights(step: Lanes, h: Number) -> Number:
    """The weights h b_i in SIMD lanes, rounded so that their sum is h exactly.

    With another sum every step would advance time by the same small amount too much or too little.  The weights are
    multiples of half the last place of h, except in the middle, which takes the rest; so no partial sum is rounded.
    """
    b = take(step.nodes, B, step.like)
    x = (h * b + 0.5 * h) - 0.5 * h
    rest = (h - total(take(step.nodes, BEFORE, step.like) * x)) * (1.0 if step.stages % 2 else 0.5)
    return x + take(step.nodes, MIDDLE, step.like) * (rest - x)


@inline
def sweep(e: Equations, old: int, new: int) -> tuple[Number, Number]:
    """Apply the right-hand side of the stage equations e to the increments in the rows from ``old`` on of the memory.

    The result is written to the rows from ``new`` on.  Returns (the distance between the two, the size of the result),
    both sums of magnitudes.
    """
    step, memory = e.step, e.memory
    places(step.inverse_mass, e, old)
    step.f(memory)
    moved, sized = 0.0 * e.weights, 0.0 * e.weights
    for k in range(e.stages):
        x = e.weights * take(memory, e.stages + k, e.like)
        moved = moved + abs(x - take(memory, old + k, e.like))
        sized = sized + abs(x)
        put(memory, new + k, x, e.like)
    return total(moved), total(sized)


solve = row_solver(sweep, lengths, inline(lambda e: shape(e, e.step.stages)))
end = ender(sums)


@inline
def equations(step: Lanes, carry: Carry, h: Number) -> Equations:
    """Make the arguments of the stage equations of a step of length h from coefficients and the memory of ``carry``."""
    rows = components(step.inverse_mass, len(carry.zero))
    return Equations(step, carry.memory, 2 * rows, rows, step.like, h, exact_weights(step, h))


@inline
def rows_of(e: Equations) -> tuple[int, int]:
    """Rows of the memory: (first row of the ring buffer of earlier steps' increments, first row of the unknowns)."""
    ring = e.base + FREE
    return ring, ring + e.step.steps * e.stages


def step(method: Lanes, y: State, carry: Carry, counts: np.record) -> tuple[State, int]:
    """Take one step from the state y; returns (state, status: `SOLVED` or why the equations could not be solved).

    They start from solutions of earlier steps, kept in ``carry``; evaluations are added to ``counts``.
    """
    e = equations(method, carry, method.h)
    ring, at = rows_of(e)
    begin(method.inverse_mass, e, y)
    extrapolate(e, ring, counts.steps, at)
    sweeps, newton, status = solve(e, at, size(y.q) + size(y.p), method.eps, carry.work)
    counts.gradient += (sweeps + newton) * method.stages
    counts.newton += min(newton, 1)
    if status != SOLVED:
        return y, status
    enter(e, ring, counts.steps, at)
    return end(e, at, y, carry.zero), status


run = loop(step)
