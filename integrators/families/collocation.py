r"""Implicit Runge-Kutta methods, partitioned ones and their low-rank relatives: one kernel for every tableau.

Unknown are the increments :math:`x_1, \dots, x_s` (of q and p); with nodes i = 1, ..., k

.. math::
    Z_i = y + \sum_m A_{im}\,x_m,\qquad x_j = h\sum_i B_{ji}\,f(Z_i),\qquad y_1 = y + \sum_m w_m\,x_m,

where A and w may differ for q and p.

- Runge-Kutta with :math:`(a_{ij}, b_j)`: k = s, :math:`A_{ij} = a_{ij}/b_j`, :math:`B = \mathrm{diag}(b)`, w = 1.
  Then symplectic means :math:`A^q_{ij} + A^p_{ji} = 1`.  A is rounded so that this holds of the doubles, whatever b:
  else the map would be symplectic only to round-off, with a sign, and quadratic invariants would drift.
- HBVM(k, s): :math:`A_{im} = \int_0^{c_i} P_m`, :math:`B_{ji} = b_i P_j(c_i)`, w = e_1, with the orthonormal
  Legendre polynomials and the Gauss rule of k nodes.  It keeps a polynomial H of degree up to 2k/s; HBVM(s, s) is
  Gauss.
- cPG(s), the continuous Petrov-Galerkin method, is HBVM with the integrals in full: k from the degree of a polynomial
  H; else k rises until the next rule of ``table`` confirms the increments to round-off (as in `averaged`).  A step
  that the largest rule leaves unconfirmed is counted as a fallback.

For a separable H with quadratic T only the kicks are unknown (Nystrom form): with :math:`x_m` the increments of p,

.. math::
    Q_i = q + c_i\,hv + hM^{-1}\sum_m \bar A_{im}\,x_m,\qquad q_1 = q + hv + hM^{-1}\sum_m \bar w_m\,x_m,\qquad
    \bar A = A^q B A^p,\quad \bar w = w^q B A^p ,

symplectic where :math:`\bar A_{ij} - \bar A_{ji} = c_i - c_j` and :math:`\bar w = 1 - c`, again of the doubles.

The equations are solved by fixed point to round-off, by Newton's method with difference Jacobians of f at the nodes
where that does not contract.  They start from the polynomial in time through the increments of the last steps.

``plan`` has the rows w^q, w^p, (whether B is diagonal, s, steps to extrapolate from), then the weights of the
extrapolation; ``table`` has a row (k, c_i, A^q_i, A^p_i, B_i) for each node of each rule.

Sources: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), II.1-2, VI.4, VIII.6; L. Brugnano,
F. Iavernaro, D. Trigiante, J. Numer. Anal. Ind. Appl. Math. 5 (2010) 17-37 (HBVM); P. Betsch, P. Steinmann, Int. J.
Numer. Methods Eng. 49 (2000) 599-638 (cPG); E. Hairer, R. McLachlan, A. Razakarivony, BIT 48 (2008) 231-243 (rounding).
"""

from __future__ import annotations

import mpmath
import numpy as np

from phasebench.integrators.coefficients import tableaus
from phasebench.integrators.engine.codegen import DOUBLE
from phasebench.integrators.engine.kernel import Prepared, array
from phasebench.integrators.engine.solve import (
    FIXED_POINT_LIMIT,
    LEVELS,
    NEWTON_LIMIT,
    NOT_FINITE,
    SOLVED,
    STALLED,
    gauss,
    polished,
    settled,
)
from phasebench.integrators.engine.vector import (
    add,
    axpy,
    bump,
    chosen,
    close,
    distance,
    head,
    inlined,
    jit,
    join,
    load,
    minus,
    opened,
    plus,
    scale,
    size,
    store,
    tail,
    velocity,
)

from .parametric import unknown

# -- one node: Nystrom form where ``field`` is None, else q and p ------------------------------------------------------


def _sum_kicks(field, table, i, memory, at, slots, zero):
    x = zero
    for m in range(slots):
        x = axpy(table[i, 2 + m], load(memory, at + m, zero), x)
    return x


def _sum_both(field, table, i, memory, at, slots, zero):
    x, y = zero, zero
    for m in range(slots):
        z = load(memory, at + m, join(zero, zero))
        x = axpy(table[i, 2 + m], head(z), x)
        y = axpy(table[i, 2 + slots + m], tail(z), y)
    return join(x, y)


def _kick(field, dT, dV, x, c, q, p, v, h):
    return scale(-1.0, dV(plus(q, axpy(c, v, scale(h, velocity(dT, x))))))


def _both(field, dT, dV, x, c, q, p, v, h):
    dq, dp = field(plus(q, head(x)), plus(p, tail(x)), h, 0.0)
    return join(dq, dp)


def _moves_kicks(field, dT, plan, memory, at, v, h, zero):
    x, y = zero, zero
    for m in range(int(plan[2, 1])):
        z = load(memory, at + m, zero)
        x, y = axpy(plan[0, m], z, x), axpy(plan[1, m], z, y)
    return plus(v, scale(h, velocity(dT, x))), y


def _moves_both(field, dT, plan, memory, at, v, h, zero):
    x, y = zero, zero
    for m in range(int(plan[2, 1])):
        z = load(memory, at + m, join(zero, zero))
        x, y = axpy(plan[0, m], head(z), x), axpy(plan[1, m], tail(z), y)
    return x, y


#: sum_m A_im x_m of the increments in the rows ``at``, ... of the memory.
inner = chosen(_sum_kicks, _sum_both)
#: f(Z_i) with that sum as ``x``; ``v`` is h M^-1 p.
force = chosen(_kick, _both)
#: The increments of q and p over the step.
moves = chosen(_moves_kicks, _moves_both)
#: h M^-1 p, which the Nystrom form needs.
drift = chosen(lambda field, dT, p, h: scale(h, velocity(dT, p)), lambda field, dT, p, h: p)


# -- the equations -----------------------------------------------------------------------------------------------------


@inlined
def sweep(arguments, table, first, old, new):
    """Write h B f at the increments in rows ``old`` to rows ``new``; returns (their distance, their size).

    All nodes use the old increments: nodes that use the new ones at once (Gauss-Seidel) need a tenth fewer evaluations,
    but each then waits for the one before, and more time.
    """
    field, dT, dV, h, zero, q, p, v, memory, slots, own = arguments
    like = unknown(field, zero)
    delta, length = 0.0, 0.0
    nodes = int(table[first, 0])
    if not own:
        for j in range(slots):
            store(memory, new + j, like)
    for i in range(nodes):
        x = inner(field, table, first + i, memory, old, slots, zero)
        f = force(field, dT, dV, x, table[first + i, 1], q, p, v, h)
        if own:
            z = scale(h * table[first + i, 2 + 2 * slots + i], f)
            delta += distance(z, load(memory, old + i, like))
            length += size(z)
            store(memory, new + i, z)
        else:
            for j in range(slots):
                z = load(memory, new + j, like)
                store(memory, new + j, axpy(h * table[first + i, 2 + 2 * slots + j], f, z))
    if not own:
        for j in range(slots):
            z = load(memory, new + j, like)
            delta += distance(z, load(memory, old + j, like))
            length += size(z)
    return delta, length


@inlined
def copy(memory, old, new, slots, like):
    """Copy increments from rows ``old`` to rows ``new``."""
    for j in range(slots):
        store(memory, new + j, load(memory, old + j, like))


@jit
def newton(arguments, table, first, at, eps, work):
    """Newton's method for the increments in the rows ``at``; returns (evaluations, status)."""
    field, dT, dV, h, zero, q, p, v, memory, slots, _ = arguments
    like = unknown(field, zero)
    n = len(like)
    order = slots * n
    new, spare = at + slots, at + 2 * slots
    span = size(q) + size(p)
    step = eps**0.5 * span
    nodes = int(table[first, 0])
    last = np.inf
    evaluations = 0
    for _ in range(NEWTON_LIMIT):
        for a in range(order):
            for b in range(order):
                work[a, b] = 1.0 if a == b else 0.0
        for i in range(first, first + nodes):
            x = inner(field, table, i, memory, at, slots, zero)
            f = force(field, dT, dV, x, table[i, 1], q, p, v, h)
            for c in range(n):
                moved = force(field, dT, dV, bump(x, c, step), table[i, 1], q, p, v, h)
                store(memory, spare, scale(h / step, minus(moved, f)))
                part = 2 if 2 * c < n else 2 + slots
                for j in range(slots):
                    for m in range(slots):
                        weight = table[i, 2 + 2 * slots + j] * table[i, part + m]
                        for r in range(n):
                            work[j * n + r, m * n + c] -= weight * memory[spare, r]
        sweep(arguments, table, first, at, new)
        evaluations += (n + 2) * nodes
        for j in range(slots):
            for r in range(n):
                work[j * n + r, order] = memory[new + j, r] - memory[at + j, r]
                if not abs(work[j * n + r, order]) < np.inf:
                    return evaluations, NOT_FINITE
        if not gauss(work, order):
            return evaluations, STALLED
        delta, length = 0.0, 0.0
        for j in range(slots):
            for r in range(n):
                memory[spare, r] = work[j * n + r, order]
            z = load(memory, spare, like)
            delta += size(z)
            z = plus(load(memory, at + j, like), z)
            length += size(z)
            store(memory, at + j, z)
        if not delta < np.inf:
            return evaluations, NOT_FINITE
        if polished(delta, last, eps * length, eps * span):
            return evaluations, SOLVED
        last = delta
    return evaluations, STALLED


@jit
def solve(arguments, table, first, at, eps, work):
    """Solve for the increments in rows ``at``, from the start that stands there; (evaluations, Newton used, status).

    The rows from ``at + slots`` to ``at + 4 slots`` are written over.
    """
    field, _, _, _, zero, q, p, _, memory, slots, _ = arguments
    like = unknown(field, zero)
    start = at + 3 * slots
    copy(memory, at, start, slots, like)
    nodes = int(table[first, 0])
    span = size(q) + size(p)
    here, there = at, at + slots
    delta = np.inf
    growth = 0
    k = 0
    solved = False
    while not solved:
        last = delta
        delta, length = sweep(arguments, table, first, here, there)
        here, there = there, here
        k += 1
        if not delta < np.inf:
            break
        solved = settled(delta, last, length, span, eps)
        if delta >= last:
            growth += 1
        if growth == 2 or (k >= FIXED_POINT_LIMIT and delta > 0.5 * last):
            break
    if solved:
        if here != at:
            copy(memory, here, at, slots, like)
        return k * nodes, 0, SOLVED
    copy(memory, start, at, slots, like)
    n, status = newton(arguments, table, first, at, eps, work)
    if status != SOLVED:
        for j in range(slots):
            store(memory, at + j, like)
        more, status = newton(arguments, table, first, at, eps, work)
        n += more
    return k * nodes + n, 1, status


@inlined
def begin(plan, memory, at, slots, known, like):
    """Extrapolate the increments of the last steps into the rows ``at``: `extrapolation` in the plan's further rows."""
    steps = min(known, int(plan[2, 2]))
    row = 3 + slots * (steps - 1)
    for j in range(slots):
        x = like
        for back in range(steps, 0, -1):
            ring = (known - back) % LEVELS * slots
            for m in range(slots):
                x = axpy(plan[row + j, (back - 1) * slots + m], load(memory, ring + m, like), x)
        store(memory, at + j, x)


@inlined
def confirm(arguments, table, first, at, eps, work):
    """Go on to finer rules until one confirms the increments; (rule, evaluations, status, confirmed)."""
    field, _, _, h, zero, q, p, _, memory, slots, _ = arguments
    like = unknown(field, zero)
    span = size(q) + size(p)
    last = np.inf
    evaluations = 0
    while True:
        following = first + int(table[first, 0])
        if following == len(table):
            return first, evaluations, SOLVED, False
        delta, length = sweep(arguments, table, following, at, at + slots)
        copy(memory, at + slots, at, slots, like)
        evaluations += int(table[following, 0])
        if delta <= 4 * eps * length or (delta > 0.5 * last and delta <= 64 * eps * (length + abs(h) * span)):
            return first, evaluations, SOLVED, True
        last = delta
        first = following
        n, _, status = solve(arguments, table, first, at, eps, work)
        evaluations += n
        if status != SOLVED:
            return first, evaluations, status, False


def run(field, dT, dV, plan, table, h, every, eps, zero, state, memory, work, Q, P, aux, counts):
    """Fill the rows of Q and P, each after ``every`` steps; returns (rows filled, status)."""
    q, p, cq, cp = opened(state, zero)
    like = unknown(field, zero)
    slots = int(plan[2, 1])
    own = plan[2, 0] != 0
    single = len(table) == int(table[0, 0])
    at = LEVELS * slots
    first = counts[4]
    for row in range(len(Q)):
        for _ in range(every):
            if counts[0] % 16 == 0:
                first = 0
            arguments = field, dT, dV, h, zero, q, p, drift(field, dT, p, h), memory, slots, own
            begin(plan, memory, at, slots, counts[0], like)
            n, used, status = solve(arguments, table, first, at, eps, work)
            counts[1] += n
            counts[2] += used
            if not single and status == SOLVED:
                first, n, status, confirmed = confirm(arguments, table, first, at, eps, work)
                counts[1] += n
                counts[3] += 0 if confirmed else 1
            if status != SOLVED:
                return row, status
            copy(memory, at, counts[0] % LEVELS * slots, slots, like)
            dq, dp = moves(field, dT, plan, memory, at, arguments[7], h, zero)
            q, cq = add(q, cq, dq)
            p, cp = add(p, cp, dp)
            counts[0] += 1
        store(Q, row, q)
        store(P, row, p)
    close(state, q, p, cq, cp)
    counts[4] = first
    return len(Q), 0


#: Sizes of the rules of cPG for an H that is no polynomial.
RULES = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)


def prepare(method, system, arithmetic):
    """Of data (kind, s) or ("hbvm", s, k); the Nystrom form where T is quadratic, else the field."""
    kind, s, *rest = method.data
    sizes = rest or [s]
    if kind == "cpg":
        degree = system.polynomial_degree
        kind, sizes = "hbvm", [max(s, -(-s * degree // 2))] if degree else [k for k in RULES if k >= s]
        if arithmetic != DOUBLE and not degree:
            sizes = [*sizes, 48, 64]
    nystrom = system.separable and system.quadratic_kinetic
    digits = 40 if arithmetic == DOUBLE else mpmath.mp.dps + 10
    unit = mpmath.mpf(2) ** (-52 if arithmetic == DOUBLE else 1 - mpmath.mp.prec)
    made = [tableaus.rows(kind, s, k, nystrom, digits, unit) for k in sizes]
    if nystrom:
        functions, width = (None, system.grad_T(arithmetic), system.grad_V(arithmetic)), system.d
    else:
        functions, width = (system.field(arithmetic), None, None), 2 * system.d
    plan = array(made[0][0], arithmetic)
    table = array([row for _, table in made for row in table], arithmetic)
    return Prepared(run, functions, plan, table, width, s, linear=s * width)
