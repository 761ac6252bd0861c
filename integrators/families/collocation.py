r"""Implicit Runge-Kutta methods, partitioned ones and their low-rank relatives: one kernel for every tableau.

The unknowns are the increments :math:`x_1, \dots, x_s` of q and p; with nodes i = 1, ..., k

.. math::
    Z_i = y + \sum_m A_{im}\,x_m,\qquad x_j = h\sum_i B_{ji}\,f(Z_i),\qquad y_1 = y + \sum_m w_m\,x_m,

where A and w may differ for q and p.

- Runge-Kutta with :math:`(a_{ij}, b_j)`: k = s, :math:`A_{ij} = a_{ij}/b_j`, :math:`B = \mathrm{diag}(b)`, w = 1. Then
  symplectic means :math:`A^q_{ij} + A^p_{ji} = 1`.  A is rounded so that its doubles fulfil this exactly, whatever b:
  else the map would be symplectic only to round-off, with a bias, and quadratic invariants would drift.
- HBVM(k, s): :math:`A_{im} = \int_0^{c_i} P_m`, :math:`B_{ji} = b_i P_j(c_i)`, w = e_1, with the orthonormal Legendre
  polynomials and the Gauss rule of k nodes.  It keeps a polynomial H of degree up to 2k/s; HBVM(s, s) is Gauss.
- cPG(s), the continuous Petrov-Galerkin method, is HBVM with exact integrals: k follows from the degree of a polynomial
  H; else k rises until the next rule confirms the increments to round-off (as in `averaged`).  A step that the largest
  rule leaves unconfirmed is counted as a fallback.

For a separable H with quadratic T only the kicks :math:`x_m`, increments of p, are unknown (Nystrom form):

.. math::
    Q_i = q + c_i\,hv + hM^{-1}\sum_m \bar A_{im}\,x_m,\qquad q_1 = q + hv + hM^{-1}\sum_m \bar w_m\,x_m,\qquad
    \bar A = A^q B A^p,\quad \bar w = w^q B A^p ,

symplectic where :math:`\bar A_{ij} - \bar A_{ji} = c_i - c_j` and :math:`\bar w = 1 - c`, again exactly in doubles.

The equations are solved by fixed point to round-off, by Newton's method with difference Jacobians of f at the nodes
where that does not contract.  They start from the polynomial in time through the increments of the last steps.

Sources: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), II.1-2, VI.4, VIII.6; L. Brugnano,
F. Iavernaro, D. Trigiante, J. Numer. Anal. Ind. Appl. Math. 5 (2010) 17-37 (HBVM); P. Betsch, P. Steinmann, Int. J.
Numer. Methods Eng. 49 (2000) 599-638 (cPG); E. Hairer, R. McLachlan, A. Razakarivony, BIT 48 (2008) 231-243 (rounding).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import mpmath
import numpy as np

from phasebench.integrators.coefficients.quadrature import LARGE, RULES, sizes
from phasebench.integrators.coefficients.tableaus import tableau
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Carry, Prepared, array, freeze
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.solve import (
    LEVELS,
    Change,
    change,
    changes_by_row,
    confirmer,
    copy,
    lengths_by_row,
    lengths_of_both,
    row_solver,
)
from phasebench.integrators.values.vector import (
    State,
    axpy,
    dispatch_on_none,
    distance,
    head,
    inline,
    join,
    load,
    plus,
    scale,
    size,
    store,
    tail,
    update,
    velocity,
)

from . import gauss_lanes, path_lanes
from .parametric import lengths_of_kick, quadratic, unknown

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Number


class Collocation(NamedTuple):
    """Coefficients of an implicit Runge-Kutta method or relative: stages y + A x, increments x = h B f, end y + w x.

    A and w may differ for q and p.  The tables of nodes hold one or more quadrature rules, one after the other.

    Attributes
    ----------
    field : the vector field (q', p'); None in the Nystrom form, where x are the increments of p alone
    dT, dV : the gradients of T and V in the Nystrom form, else None
    diagonal : True if the matrix B is diagonal
    weights : array (2, s), the rows w of q and of p
    nodes, rows : for each node in the tables, the numbers of nodes and of rows of the rule that it belongs to; they are
        equal here, where a row of a table is a node
    c : array (nodes, 1), the times of the nodes as fractions of h
    A_q, A_p : arrays (nodes, s), the matrix A for q and for p
    B : array (nodes, s), the transpose of the matrix B in x = h B f
    extrapolation : weights that predict the s increments of a step from those of earlier steps: s rows for one earlier
        step, then s rows for two, ...
    h, eps : the step size and the unit round-off, set by the run
    """

    field: Callable | None
    dT: Callable | None
    dV: Callable | None
    diagonal: bool
    weights: np.ndarray
    nodes: np.ndarray
    rows: np.ndarray
    c: np.ndarray
    A_q: np.ndarray
    A_p: np.ndarray
    B: np.ndarray
    extrapolation: np.ndarray
    h: float = 0.0
    eps: float = 0.0


class Equations(NamedTuple):
    """Arguments of the equations for the increments of a step from (q, p); the increments are in rows of ``memory``.

    Attributes
    ----------
    step : the coefficients of the method
    q, p : the state before the step
    v : h M^-1 p in the Nystrom form, else p
    memory : array with the increments of this step and of earlier ones
    zero, like : zeros of the shape of q, and of the shape of an increment
    stages : the number of increments
    counts : the counters of evaluations, and the quadrature rule in use
    """

    step: Collocation
    q: Any
    p: Any
    v: Any
    memory: np.ndarray
    zero: Any
    like: Any
    stages: int
    counts: np.record


# -- one node: Nystrom form where ``field`` is None, else q and p ------------------------------------------------------


def _sum_kicks(field, e, i, at):
    x = e.zero
    for m in range(e.stages):
        x = axpy(e.step.A_q[i, m], load(e.memory, at + m, e.zero), x)
    return x


def _sum_both(field, e, i, at):
    x, y = e.zero, e.zero
    for m in range(e.stages):
        z = load(e.memory, at + m, e.like)
        x = axpy(e.step.A_q[i, m], head(z), x)
        y = axpy(e.step.A_p[i, m], tail(z), y)
    return join(x, y)


def _kick(field, e, i, x):
    moved = axpy(e.step.c[i, 0], e.v, scale(e.step.h, velocity(e.step.dT, x)))
    return scale(-1.0, e.step.dV(plus(e.q, moved)))


def _both(field, e, i, x):
    dq, dp = field(plus(e.q, head(x)), plus(e.p, tail(x)), e.step.h, 0.0)
    return join(dq, dp)


def _moves_kicks(field, e, at):
    x, y = e.zero, e.zero
    for m in range(e.stages):
        z = load(e.memory, at + m, e.zero)
        x, y = axpy(e.step.weights[0, m], z, x), axpy(e.step.weights[1, m], z, y)
    return plus(e.v, scale(e.step.h, velocity(e.step.dT, x))), y


def _moves_both(field, e, at):
    x, y = e.zero, e.zero
    for m in range(e.stages):
        z = load(e.memory, at + m, e.like)
        x, y = axpy(e.step.weights[0, m], head(z), x), axpy(e.step.weights[1, m], tail(z), y)
    return x, y


#: sum_m A_im x_m of the increments in the rows ``at``, ... of the memory.
inner = dispatch_on_none(_sum_kicks, _sum_both)
#: f(Z_i) with that sum as ``x``.
force = dispatch_on_none(_kick, _both)
#: Sizes of the variables that the two halves of an increment x = G(x) belong to.
lengths_of_increment = dispatch_on_none(
    lambda field, x, g, e: lengths_of_kick(x, g, e), lambda field, x, g, e: lengths_of_both(x, g, e)
)
#: The increments of q and p over the step.
moves = dispatch_on_none(_moves_kicks, _moves_both)
#: h M^-1 p in the Nystrom form.
drift = dispatch_on_none(lambda field, dT, p, h: scale(h, velocity(dT, p)), lambda field, dT, p, h: p)
#: The `Change` from a row x to a row y; kicks are momenta.
add_increments = dispatch_on_none(
    lambda field, x, y: Change(0.0, distance(x, y), 0.0, size(y)),
    lambda field, x, y: change(x, y),
)


# -- the equations -----------------------------------------------------------------------------------------------------


@inline
def sweep(e: Equations, old: int, new: int) -> tuple[Number, Number]:
    """Apply the right-hand side of x = h B f to the increments x in rows ``old``; write the result to rows ``new``.

    ``old`` and ``new`` are the first of these rows in ``e.memory``.  Returns (the distance between the two, the size of
    the result).  The iteration is of Jacobi's kind: all nodes use the old increments.  Gauss-Seidel, with the new ones
    at once, would need somewhat fewer evaluations, but each would wait for the one before, which takes longer.
    """
    step, memory, like = e.step, e.memory, e.like
    first = e.counts.rule
    delta, length = 0.0, 0.0
    if not step.diagonal:
        for j in range(e.stages):
            store(memory, new + j, like)
    for i in range(step.nodes[first]):
        x = inner(step.field, e, first + i, old)
        f = force(step.field, e, first + i, x)
        if step.diagonal:
            z = scale(step.h, scale(step.B[first + i, i], f))
            delta += distance(z, load(memory, old + i, like))
            length += size(z)
            store(memory, new + i, z)
        else:
            for j in range(e.stages):
                z = load(memory, new + j, like)
                store(memory, new + j, axpy(step.B[first + i, j], f, z))
    if not step.diagonal:
        for j in range(e.stages):
            z = scale(step.h, load(memory, new + j, like))
            store(memory, new + j, z)
            delta += distance(z, load(memory, old + j, like))
            length += size(z)
    return delta, length


lengths = lengths_by_row(inline(lambda x, g, e: lengths_of_increment(e.step.field, x, g, e)))
solve = row_solver(sweep, lengths)
solve_confirmed = confirmer(solve, sweep, changes_by_row(inline(lambda e, x, y: add_increments(e.step.field, x, y))))


@inline
def extrapolate(e: Equations, at: int) -> None:
    """Write a start of the iteration to the rows ``at``, ...: the last steps' increments, extrapolated to this step."""
    weights, known = e.step.extrapolation, e.counts.steps
    steps = min(known, len(weights) // e.stages)
    row = e.stages * (steps - 1)
    for j in range(e.stages):
        x = e.like
        for back in range(steps, 0, -1):
            ring = (known - back) % LEVELS * e.stages
            for m in range(e.stages):
                x = axpy(weights[row + j, (back - 1) * e.stages + m], load(e.memory, ring + m, e.like), x)
        store(e.memory, at + j, x)


def step(method: Collocation, y: State, carry: Carry, counts: np.record) -> tuple[State, int]:
    """Take one step from the state y; returns (state, status: `SOLVED` or why the stage equations could not be solved).

    Stage equations start from solutions of earlier steps, kept in ``carry``; evaluations are added to ``counts``.
    """
    memory, zero, like = carry.memory, carry.zero, unknown(method.field, carry.zero)
    stages = method.weights.shape[1]
    at = LEVELS * stages
    if counts.steps % 16 == 0:
        counts.rule = 0
    v = drift(method.field, method.dT, y.p, method.h)
    e = Equations(method, y.q, y.p, v, memory, zero, like, stages, counts)
    extrapolate(e, at)
    span = size(y.q) + size(y.p)
    _, status = solve_confirmed(e, at, span, abs(method.h) * span, carry.work, counts)
    if status != SOLVED:
        return y, status
    copy(memory, at, counts.steps % LEVELS * stages, stages, like)
    dq, dp = moves(method.field, e, at)
    return update(y, dq, dp), status


run = loop(step)


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of an implicit Runge-Kutta method or relative for a system.

    ``method.data`` is (kind, s) with s stages, or ("hbvm", s, k) with k nodes; kind is the name of the coefficients,
    such as "gauss", "radau-iia" or "cpg".  Stages or nodes are evaluated side by side in SIMD lanes if the system
    allows it.
    """
    kind, s, *_ = method.data
    if kind == "gauss" and gauss_lanes.serves(s, system):
        return gauss_lanes.prepare(s, system, arithmetic)
    if kind in ("hbvm", "cpg"):
        rules = rules_of(method, system, arithmetic)
        if path_lanes.serves(s, rules, system):
            return path_lanes.prepare(s, rules, system, arithmetic)
    return prepare_stage_by_stage(method, system, arithmetic)


def rules_of(method: Method, system: Hamiltonian, arithmetic: str) -> Sequence[int]:
    """The numbers of nodes of the quadrature rules that a method uses on a system, in rising order."""
    kind, s, *k = method.data
    if kind == "cpg":
        return sizes(s, system.polynomial_degree, RULES if arithmetic == DOUBLE else LARGE)
    return k or [s]


def prepare_stage_by_stage(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel that evaluates stage after stage; if T is quadratic, only increments of p are unknown."""
    kind, s, *_ = method.data
    rules = rules_of(method, system, arithmetic)
    kind = "hbvm" if kind == "cpg" else kind
    functions, width = quadratic(system, arithmetic)
    digits = 40 if arithmetic == DOUBLE else mpmath.mp.dps + 10
    unit = mpmath.mpf(2) ** (-52 if arithmetic == DOUBLE else 1 - mpmath.mp.prec)
    tableaus = [tableau(kind, s, k, functions[0] is None, digits, unit) for k in rules]
    nodes = freeze([k for k in rules for _ in range(k)])
    step = Collocation(
        *functions,
        diagonal=kind != "hbvm",
        weights=array(tableaus[0].weights, arithmetic),
        nodes=nodes,
        rows=nodes,
        c=array(([c] for t in tableaus for c in t.c), arithmetic),
        A_q=array((row for t in tableaus for row in t.A_q), arithmetic),
        A_p=array((row for t in tableaus for row in t.A_p), arithmetic),
        B=array((row for t in tableaus for row in t.B), arithmetic),
        extrapolation=array(tableaus[0].extrapolation, arithmetic),
    )
    return Prepared(run, step, width, s, linear=s * width)
