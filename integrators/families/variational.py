r"""Galerkin variational integrators in position-momentum form.

For :math:`L = \tfrac12 v\cdot Mv - V(q)` the discrete Lagrangian is the action over a step of a polynomial of degree s
through the control points :math:`q^0, \dots, q^s` at the times :math:`\tau_0 = 0, \dots, \tau_s = 1` of the step, by a
quadrature :math:`(c_i, b_i)`,

.. math::
    L_d = h\sum_i b_i L(Q_i, \dot Q_i),\qquad
    Q_i = \sum_\mu \varphi_\mu(c_i)\,q^\mu,\qquad \dot Q_i = \tfrac1h\sum_\mu \varphi'_\mu(c_i)\,q^\mu ,

stationary in the inner control points; :math:`p_0 = -\partial L_d/\partial q^0`, :math:`p_1 = \partial L_d/\partial
q^s`.  With the forces :math:`F_i = -\nabla V(Q_i)` the derivative by :math:`q^\nu` is :math:`\tfrac1h M\sum_\mu
K_{\nu\mu}q^\mu + h\sum_i b_i\varphi_\nu(c_i)F_i`, :math:`K_{\nu\mu} = \sum_i b_i\varphi'_\nu(c_i)\varphi'_\mu(c_i)`:
-p0 for :math:`\nu = 0`, zero for the inner points.  These s equations are linear in the control points, with a matrix
of numbers; solved, they leave the equations of the kicks :math:`k_i = b_i F_i`,

.. math::
    Q_i = q_0 + h\,d_i M^{-1}p_0 + h^2 M^{-1}\sum_j a_{ij}k_j,\qquad
    p_1 = p_0 + h\sum_j k_j ,

and q1 = q^s likewise.  ``plan`` has the rows :math:`(a_{i1}, \dots, a_{ir}, d_i)` of the nodes, that of q1, and the
weights b; ``table`` is [[e, f]]: the kicks before e need no iteration, no other one needs those from f on.  The result
does not depend on the times of the inner control points.  The kicks are iterated to round-off from an extrapolated
start, by Newton's method where that does not contract.

The map is symplectic as :math:`a_{ij} - a_{ji} = d_i - d_j` and the row of q1 is :math:`1 - d_j`.  The latter holds of
the doubles too, whatever the weights: an error of it, rounded once and for all, has a sign, and angular momentum would
drift.

Source: J. E. Marsden, M. West, Acta Numerica 10 (2001) 357-514, 2.2.6 and 2.6.6; S. Ober-Bloebaum, N. Saake,
Adv. Comput. Math. 41 (2015) 955-986.
"""

from __future__ import annotations

import mpmath
import numpy as np

from phasebench.integrators.coefficients.fractions import DIGITS
from phasebench.integrators.coefficients.quadrature import gauss_legendre, gauss_lobatto
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
    predict,
    remember,
    settled,
)
from phasebench.integrators.engine.vector import (
    add,
    axpy,
    bump,
    close,
    distance,
    inlined,
    jit,
    load,
    minus,
    opened,
    plus,
    scale,
    size,
    store,
    velocity,
)


@inlined
def displacement(i, arguments):
    """The point of row i of the plan, less q: h d_i v + h^2 M^-1 sum_j a_ij k_j."""
    dT, _, q, v, h, plan, memory, latest = arguments
    r = len(plan) - 2
    x = scale(0.0, q)
    for j in range(r):
        if plan[i, j] != 0:
            x = axpy(plan[i, j], load(memory, latest + j, q), x)
    return scale(h, axpy(plan[i, r], v, scale(h, velocity(dT, x))))


@inlined
def kick(i, arguments):
    """k_i = b_i F_i from the present kicks."""
    dV, q, plan = arguments[1], arguments[2], arguments[5]
    return scale(-plan[len(plan) - 1, i], dV(axpy(1.0, displacement(i, arguments), q)))


@inlined
def sweep(first, last, arguments):
    """Renew the kicks first, ..., last - 1, each from the newest of the others; (h times their change, their size)."""
    q, h, memory, latest = arguments[2], arguments[4], arguments[6], arguments[7]
    change = total = 0.0 * h
    for i in range(first, last):
        k = kick(i, arguments)
        change = change + abs(h) * distance(k, load(memory, latest + i, q))
        total = total + abs(h) * size(k)
        store(memory, latest + i, k)
    return change, total


@jit
def newton(arguments, span, eps, work):
    """Newton's method for the kicks; their derivatives are differences of the gradient.  (evaluations, status)."""
    dT, dV, q, _, h, plan, memory, latest = arguments
    r, d = len(plan) - 2, len(q)
    n = r * d
    step = eps**0.5 * span
    last = np.inf
    evaluations = 0
    for _ in range(NEWTON_LIMIT):
        total = 0.0 * h
        for i in range(r):
            Q = axpy(1.0, displacement(i, arguments), q)
            b = plan[r + 1, i]
            present = scale(-b, dV(Q))
            for k in range(d):
                there = axpy(1.0, velocity(dT, bump(scale(0.0, q), k, step)), Q)
                store(work, n, minus(scale(-b, dV(there)), present))
                for m in range(d):
                    for j in range(r):
                        one = 1.0 if i == j and k == m else 0.0
                        work[i * d + m, j * d + k] = one - h * h * plan[i, j] * (work[n, m] / step)
            rest = minus(present, load(memory, latest + i, q))
            store(work, n, rest)
            for m in range(d):
                work[i * d + m, n] = work[n, m]
            total = total + abs(h) * size(present)
        evaluations += r * (d + 1)
        if not total < np.inf:
            return evaluations, NOT_FINITE
        if not gauss(work, n):
            return evaluations, STALLED
        delta = 0.0 * h
        for i in range(r):
            for m in range(d):
                memory[latest + i, m] = memory[latest + i, m] + work[i * d + m, n]
                delta = delta + abs(h * work[i * d + m, n])
        if not delta < np.inf:
            return evaluations, NOT_FINITE
        if polished(delta, last, eps * total, eps * span):
            return evaluations, SOLVED
        last = delta
    return evaluations, STALLED


@inlined
def solve_kicks(explicit, end, known, arguments, span, eps, work):
    """Find the kicks of a step, from those of ``known`` steps; returns (evaluations, Newton used: 0 or 1, status).

    Those before ``explicit`` and from ``end`` on are computed once.
    """
    q, plan, memory, latest = arguments[2], arguments[5], arguments[6], arguments[7]
    r = len(plan) - 2
    for i in range(r):
        store(memory, latest + i, predict(memory, i, r, known, q))
    sweep(0, explicit, arguments)
    last = np.inf
    growth = 0
    k = 0
    solved = explicit == end
    while not solved and k < FIXED_POINT_LIMIT and growth < 2:
        delta, total = sweep(explicit, end, arguments)
        k += 1
        if not delta < np.inf:
            break
        solved = settled(delta, last, total, span, eps)
        if delta >= last:
            growth += 1
        last = delta
    evaluations = r + (k - 1) * (end - explicit) if end > explicit else r
    if solved:
        sweep(end, r, arguments)
        return evaluations, 0, SOLVED
    for i in range(r):
        store(memory, latest + i, predict(memory, i, r, known, q))
    more, status = newton(arguments, span, eps, work)
    return evaluations + more, 1, status


def run(dT, dV, plan, table, h, every, eps, zero, state, memory, work, Q, P, aux, counts):
    """Fill the rows of Q and P, each after ``every`` steps; returns (rows, status)."""
    q, p, cq, cp = opened(state, zero)
    explicit, end = int(table[0, 0]), int(table[0, 1])
    r = len(plan) - 2
    latest = LEVELS * r
    for row in range(len(Q)):
        for _ in range(every):
            v = velocity(dT, p)
            arguments = (dT, dV, q, v, h, plan, memory, latest)
            n, used, status = solve_kicks(explicit, end, counts[0], arguments, size(q) + size(p), eps, work)
            counts[1] += n
            counts[2] += used
            if status != SOLVED:
                return row, status
            total = zero
            for j in range(r):
                k = load(memory, latest + j, zero)
                total = plus(total, k)
                remember(memory, j, r, counts[0], k)
            q, cq = add(q, cq, displacement(r, arguments))
            p, cp = add(p, cp, scale(h, total))
            counts[0] += 1
        store(Q, row, q)
        store(P, row, p)
    close(state, q, p, cq, cp)
    return len(Q), 0


QUADRATURES = {"gauss": gauss_legendre, "lobatto": gauss_lobatto}


def _basis(k, s):
    """The coefficients, highest first, of the polynomial of degree s that is 1 at k/s and 0 at the others."""
    out = [mpmath.mpf(1)]
    for j in range(s + 1):
        if j != k:
            root, scale_ = mpmath.mpf(j) / s, mpmath.mpf(k - j) / s
            out = [(a - root * b) / scale_ for a, b in zip([*out, 0], [0, *out], strict=True)]
    return out


def coefficients(degree, rule):
    """The plan of polynomials of that degree with a quadrature [(node, weight), ...]."""
    with mpmath.workdps(DIGITS):
        s, r = degree, len(rule)
        value = [[mpmath.polyval(_basis(k, s), c) for c, _ in rule] for k in range(s + 1)]
        slope = [[mpmath.polyval(_basis(k, s), c, derivative=1)[1] for c, _ in rule] for k in range(s + 1)]
        K = mpmath.matrix(s, s)
        for nu in range(s):
            for mu in range(1, s + 1):
                K[nu, mu - 1] = mpmath.fsum(b * slope[nu][i] * slope[mu][i] for i, (_, b) in enumerate(rule))
        columns = [[-value[nu][j] for nu in range(s)] for j in range(r)]
        columns.append([-1] + [0] * (s - 1))
        control = [mpmath.lu_solve(K, mpmath.matrix(c)) for c in columns]
        at = [[value[mu][i] for mu in range(1, s + 1)] for i in range(r)] + [[0] * (s - 1) + [1]]
        rows = [[mpmath.fdot(row, x) for x in control] for row in at]
        return [*rows, [b for _, b in rule]]


def prepare(method, system, arithmetic):
    """The coefficients from the action; which kicks are iterated."""
    degree, quadrature, nodes = method.data
    rows = coefficients(degree, QUADRATURES[quadrature](nodes, DIGITS))
    tiny = mpmath.mpf(10) ** (10 - DIGITS)
    rows = [[0 if abs(x) < tiny else x for x in row] for row in rows]
    explicit = 0
    while explicit < nodes and not any(rows[explicit][explicit:nodes]):
        explicit += 1
    end = nodes
    while end > explicit and not any(row[end - 1] for row in rows[:end]):
        end -= 1
    plan = array(rows, arithmetic)
    for j in range(nodes):
        plan[nodes, j] = 1 - plan[j, nodes]
        plan[j, nodes] = 1 - plan[nodes, j]
    return Prepared(
        run,
        (system.grad_T(arithmetic), system.grad_V(arithmetic)),
        plan,
        array([[explicit, end]], arithmetic),
        system.d,
        nodes,
        implicit=explicit < nodes,
        linear=nodes * system.d,
    )
