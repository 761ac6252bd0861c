r"""Energy-preserving collocation for Poisson systems :math:`\dot y = B(y)\nabla H(y)`, canonical ones among them.

With the nodes :math:`c_i` and weights :math:`b_i` of the Gauss rule of s nodes, their Lagrange polynomials
:math:`\ell_i`, and the polynomial Y of degree s with :math:`Y(0) = y_0` and

.. math::
    \dot Y(c_i) = h\,B\bigl(Y(c_i)\bigr) \int_0^1 \frac{\ell_i(\tau)}{b_i}\,\nabla H\bigl(Y(\tau)\bigr)\,d\tau,
    \qquad y_1 = Y(1) .

Then :math:`H(y_1) - H(y_0) = \sum_i b_i g_i\cdot B(Y(c_i))\,g_i h = 0` with the integrals :math:`g_i`; a quadratic
Casimir C is kept because the rule is exact for :math:`\dot Y\cdot\nabla C(Y)`.  The order is 2s.  For s = 1 the line
from y_0 to y_1 takes the place of Y and B is taken in the middle: on canonical systems this is the averaged vector
field method, for all s the continuous Petrov-Galerkin method, so that `collocation` serves these.  The map is no
Poisson map.

Unknown are the weighted increments :math:`x_i = b_i\dot Y(c_i)`, so that
:math:`Y(\tau) = y_0 + \sum_i x_i \int_0^\tau \ell_i / b_i` and :math:`y_1 = y_0 + \sum_i x_i`.  They are solved for by
fixed point to round-off, by Newton's method with a difference Jacobian where that does not contract.  The integrals are
Gauss-Legendre sums: exact with ceil(sm/2) nodes for a polynomial H of degree m; otherwise there is a list of rules
of rising size, and a step takes the first that the next one confirms to round-off (as in `averaged`).  A step that the
largest rule leaves unconfirmed is counted as a fallback.

Source: D. Cohen, E. Hairer, "Linear energy-preserving integrators for Poisson systems", BIT 51 (2011) 91-101,
section 2; E. Hairer, J. Numer. Anal. Ind. Appl. Math. 5 (2010) 73-84 (canonical systems).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import mpmath
import numpy as np

from phasebench.integrators.coefficients.quadrature import (
    LARGE,
    RULES,
    gauss_legendre,
    legendre,
    legendre_integrals,
    sizes,
)
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Carry, Prepared, array, freeze
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.solve import (
    LEVELS,
    change,
    changes_by_row,
    confirmer,
    copy,
    lengths_by_row,
    lengths_of_both,
    predict,
    row_solver,
)
from phasebench.integrators.values.vector import (
    State,
    axpy,
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
)

from . import collocation

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.systems.poisson import PoissonSystem
    from phasebench.integrators.values.kinds import Number, Value


class Poisson(NamedTuple):
    """The coefficients of energy-preserving collocation, and functions of the Poisson system.

    c_i, b_i and l_i are the collocation nodes, their weights and Lagrange polynomials.  The rows of ``inner`` and
    ``outer`` belong to the nodes tau of one or more quadrature rules, one rule after the other.

    Attributes
    ----------
    structure : (q, p, g_q, g_p) -> B(y) g, the structure matrix times a vector
    gradient : (q, p, h, lam) -> the gradient of H; h and lam are not used
    stage : array (s, s), int_0^c_i l_j / b_j
    nodes, rows : for each node tau, the numbers of nodes and of rows of the rule that it belongs to; they are equal
        here, where a row of a table is a node
    inner : array (nodes, s), int_0^tau l_j / b_j
    outer : array (nodes, s), the weight of the node times l_j(tau)
    h, eps : the step size and the unit round-off, set by the run
    """

    structure: Callable
    gradient: Callable
    stage: np.ndarray
    nodes: np.ndarray
    rows: np.ndarray
    inner: np.ndarray
    outer: np.ndarray
    h: float = 0.0
    eps: float = 0.0


class Equations(NamedTuple):
    """Arguments of the equations for the increments of a step, which starts at the state (q, p).

    Attributes
    ----------
    step : the coefficients of the method
    q, p : the state before the step
    memory : array with the increments of this step and of earlier ones
    like : a zero of the shape of an increment, 2 d components
    stages : the number of increments
    counts : the counters of evaluations, and the quadrature rule in use
    """

    step: Poisson
    q: Value
    p: Value
    memory: np.ndarray
    like: Value
    stages: int
    counts: np.record


@inline
def combine(weights: np.ndarray, i: int, e: Equations, rows: int) -> Value:
    """The sum over j of ``weights[i, j]`` times the increment in row ``rows + j`` of the memory of the equations e."""
    x = e.like
    for j in range(e.stages):
        x = axpy(weights[i, j], load(e.memory, rows + j, e.like), x)
    return x


@inline
def sweep(e: Equations, old: int, new: int) -> tuple[Number, Number]:
    """Apply the right-hand side of x = G(x) to the increments x in rows ``old``; write the result to rows ``new``.

    ``old`` and ``new`` are the first of these rows in ``e.memory``.  Returns (the distance between the two, the size of
    the result).
    """
    step, memory, like = e.step, e.memory, e.like
    for j in range(e.stages):
        store(memory, new + j, like)
    for i in range(e.counts.rule, e.counts.rule + step.nodes[e.counts.rule]):
        x = combine(step.inner, i, e, old)
        a, b = step.gradient(plus(e.q, head(x)), plus(e.p, tail(x)), step.h, 0.0)
        g = join(a, b)
        for j in range(e.stages):
            store(memory, new + j, axpy(step.outer[i, j], g, load(memory, new + j, like)))
    delta, length = 0.0, 0.0
    for j in range(e.stages):
        x = combine(step.stage, j, e, old)
        g = load(memory, new + j, like)
        a, b = step.structure(plus(e.q, head(x)), plus(e.p, tail(x)), head(g), tail(g))
        z = scale(step.h, join(a, b))
        store(memory, new + j, z)
        delta += distance(z, load(memory, old + j, like))
        length += size(z)
    return delta, length


solve = confirmer(
    row_solver(sweep, lengths_by_row(lengths_of_both)), sweep, changes_by_row(inline(lambda e, x, y: change(x, y)))
)


def step(method: Poisson, y: State, carry: Carry, counts: np.record) -> tuple[State, int]:
    """Take one step from the state y; returns (state, status: `SOLVED` or why the equations could not be solved).

    Their iteration starts from solutions of earlier steps, kept in ``carry``; evaluations are added to ``counts``.
    """
    memory, both = carry.memory, join(carry.zero, carry.zero)
    stages = len(method.stage)
    at = LEVELS * stages
    for j in range(stages):
        store(memory, at + j, predict(memory, j, stages, counts.steps, both))
    if counts.steps % 16 == 0:
        counts.rule = 0
    span = size(y.q) + size(y.p)
    e = Equations(method, y.q, y.p, memory, both, stages, counts)
    _, status = solve(e, at, span, abs(method.h) * span, carry.work, counts)
    if status != SOLVED:
        return y, status
    copy(memory, at, counts.steps % LEVELS * stages, stages, both)
    x = both
    for j in range(stages):
        x = plus(x, load(memory, at + j, both))
    return update(y, head(x), tail(x)), status


run = loop(step)


@cache
def coefficients(s: int, rules: tuple[int, ...], digits: int) -> tuple[list, list]:
    """The coefficients of energy-preserving collocation with s nodes, as mpmath numbers of the given digits.

    ``rules`` are the numbers of nodes of the quadrature rules.  Returns (the rows of ``stage``, a list of (number of
    nodes of its rule, row of ``inner``, row of ``outer``) for each quadrature node), named as the fields of `Poisson`.
    """
    with mpmath.workdps(digits + 10):
        gauss_rule = gauss_legendre(s, digits)
        # ell_l / b_l = sum_j P_j(c_l) P_j: the nodes' own rule is exact for the products of degree 2s - 2
        values = [legendre(s, c) for c, _ in gauss_rule]

        def expand(basis: list[mpmath.mpf]) -> list[mpmath.mpf]:
            return [mpmath.fsum(a * b for a, b in zip(row, basis, strict=True)) for row in values]

        stage = [expand(legendre_integrals(s, c)) for c, _ in gauss_rule]
        table = []
        for k in rules:
            for x, weight in gauss_legendre(k, digits):
                forces = [weight * b * f for f, (_, b) in zip(expand(legendre(s, x)), gauss_rule, strict=True)]
                table.append((k, expand(legendre_integrals(s, x)), forces))
    return stage, table


def prepare(method: Method, system: Hamiltonian | PoissonSystem, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of energy-preserving collocation for a Poisson system.

    ``method.data`` is (s,), the degree of its path.  A polynomial H has one exact quadrature rule, another H rules of
    rising size.  Canonical systems are integrated by `collocation`.
    """
    (s,) = method.data
    if system.canonical:
        return collocation.prepare(replace(method, data=("cpg", s)), system, arithmetic)
    digits, rules = (40, RULES) if arithmetic == DOUBLE else (mpmath.mp.dps, LARGE)
    stage, table = coefficients(s, sizes(s, system.polynomial_degree, rules), digits)
    nodes, inner, outer = zip(*table, strict=True)
    step = Poisson(
        system.structure(arithmetic),
        system.gradient(arithmetic),
        array(stage, arithmetic),
        nodes=freeze(nodes),
        rows=freeze(nodes),
        inner=array(inner, arithmetic),
        outer=array(outer, arithmetic),
    )
    return Prepared(run, step, 2 * system.d, s, linear=2 * s * system.d)
