r"""EQUIP: Gauss methods with a parameter that is chosen in each step so that the energy is H0.

With the orthonormal Legendre polynomials at the Gauss nodes, :math:`P_{ij} = P_{j-1}(c_i)`, the Gauss method is
:math:`A = P X_s P^{-1}`, and

.. math::
    A(\alpha) = P\,(X_s - \alpha V)\,P^{-1},\qquad V = e_s e_{s-1}^T - e_{s-1} e_s^T .

Every fixed alpha gives a symplectic, symmetric method of order 2s - 2, so every quadratic invariant is kept; alpha is
the root of :math:`E(\alpha) = H(y_1(\alpha)) - H_0` next to zero.  As E(0) is O(h^(2s+1)) and the slope of E is
O(h^(2s-1)), the root is O(h^2), and the method has the order 2s of Gauss.

In the form of `stages`, :math:`A_{ij}/b_j` loses :math:`\alpha S_{ij}`, with the skew :math:`S = P V P^T`; for each
alpha the tableau is written anew, in Nystrom form where T is quadratic, the conditions of symplecticity being imposed.

The root: if E(0) is at the round-off of H, alpha = 0; else Muller's method from the smaller root of the quadratic
model that the last step left; where that fails a search outwards from zero for a change of sign, to `RADIUS`.  Where
the slope of E passes through zero a step may have no root: it is taken with alpha = 0 and counted as a fallback.  The
target stays H0, so that a later step wins the energy back.

``plan`` is that of `stages`; ``table`` has the rows of the tableau in use, then (b_i, c_i, A_i, S_i) and [H0].

Source: L. Brugnano, F. Iavernaro, D. Trigiante, SIAM J. Numer. Anal. 50 (2012) 2897-2916.
"""

from __future__ import annotations

from dataclasses import replace

import mpmath
import numpy as np

from phasebench.integrators.coefficients import tableaus
from phasebench.integrators.coefficients.quadrature import legendre
from phasebench.integrators.engine.codegen import DOUBLE
from phasebench.integrators.engine.kernel import array, zeros
from phasebench.integrators.engine.solve import LEVELS, SOLVED
from phasebench.integrators.engine.vector import add, chosen, close, jit, opened, store

from . import collocation as stages
from .schemes_iv_v import muller, smaller_root

RADIUS = 0.5
MULLER_LIMIT = 14
REFINE_LIMIT = 60
#: The search's points on either side: RADIUS / RATIO^k.
RATIO, POINTS = 1.5, 16
#: A root farther than this is taken only if there is no nearer change of sign.
NEAR = 0.1
#: Where the first root is looked for.
FIRST = 0.01
#: H is known to its round-off times this where the iteration can do no better.
SLACK = 8.0
MISSED = "have no parameter near 0 that keeps the energy and were taken as Gauss's method"


def _tableau_kicks(field, plan, table, slots, alpha):
    base = slots
    for i in range(slots):
        c = 0.0
        for j in range(slots):
            c = c + (table[base + i, 2 + j] - alpha * table[base + i, 2 + slots + j]) * table[base + j, 0]
        plan[0, i] = 1.0 - c
        table[i, 1] = 1.0 - plan[0, i]
    for i in range(slots):
        for j in range(i, slots):
            a = 0.0
            for m in range(slots):
                left = table[base + i, 2 + m] - alpha * table[base + i, 2 + slots + m]
                right = table[base + m, 2 + j] - alpha * table[base + m, 2 + slots + j]
                a = a + left * table[base + m, 0] * right
            table[i, 2 + j] = a
            table[j, 2 + i] = a - table[i, 1] + table[j, 1]
            table[i, 2 + slots + j] = table[i, 2 + j]
            table[j, 2 + slots + i] = table[j, 2 + i]


def _tableau_both(field, plan, table, slots, alpha):
    for i in range(slots):
        for j in range(i, slots):
            a = table[slots + i, 2 + j] - alpha * table[slots + i, 2 + slots + j]
            for part in range(2, 2 + 2 * slots, slots):
                table[i, part + j] = a
                table[j, part + i] = 1.0 - a


#: Write the tableau at alpha into the first rows of the table (and the weights of q into the plan).
tableau = chosen(_tableau_kicks, _tableau_both)


@jit
def attempt(alpha, predicted, arguments):
    """Take the step with alpha; (q, p, cq, cp, E, round-off of H, status).

    The stages start from earlier steps' (``predicted``) or from the last attempt's.
    """
    energy, field, dT, dV, plan, table, h, eps, zero, q, p, cq, cp, v, memory, work, counts = arguments
    slots = int(plan[2, 1])
    at = LEVELS * slots
    tableau(field, plan, table, slots, alpha)
    if predicted:
        stages.begin(plan, memory, at, slots, counts[0], stages.unknown(field, zero))
    inner = field, dT, dV, h, zero, q, p, v, memory, slots, True
    n, used, status = stages.solve(inner, table, 0, at, eps, work)
    counts[1] += n
    counts[2] += used
    if status != SOLVED:
        return q, p, cq, cp, np.inf, eps, status
    dq, dp = stages.moves(field, dT, plan, memory, at, v, h, zero)
    q, cq = add(q, cq, dq)
    p, cp = add(p, cp, dp)
    E, magnitude = energy(q, p)
    return q, p, cq, cp, E - table[2 * slots, 0], eps * magnitude, status


@jit
def refine(a, Ea, b, Eb, arguments):
    """The root between a and b, where E changes sign: bisection quickened by the secant (Illinois); (alpha, found)."""
    side = 0
    x = b
    for k in range(REFINE_LIMIT):
        x = 0.5 * (a + b) if k % 3 == 2 else b - Eb * (b - a) / (Eb - Ea)
        if not (min(a, b) < x < max(a, b)):
            x = 0.5 * (a + b)
        E, unit, status = attempt(x, False, arguments)[4:]
        if status != SOLVED:
            return x, False
        if abs(E) <= unit or x in (a, b):
            return x, abs(E) <= 64 * unit
        if (E > 0) == (Eb > 0):
            b, Eb = x, E
            Ea = 0.5 * Ea if side == 1 else Ea
            side = 1
        else:
            a, Ea = x, E
            Eb = 0.5 * Eb if side == 2 else Eb
            side = 2
    return x, False


@jit
def search(E0, arguments):
    """The change of sign of E nearest zero, outwards on both sides at once; (alpha, found)."""
    x = 0.0
    above, below = E0, E0
    for k in range(POINTS):
        last, x = x, RADIUS * RATIO ** (k + 1 - POINTS)
        E, _, status = attempt(x, False, arguments)[4:]
        if status != SOLVED:
            return 0.0, False
        if (E > 0) != (above > 0):
            return refine(last, above, x, E, arguments)
        above = E
        E, _, status = attempt(-x, False, arguments)[4:]
        if status != SOLVED:
            return 0.0, False
        if (E > 0) != (below > 0):
            return refine(-last, below, -x, E, arguments)
        below = E
    return 0.0, False


@jit
def chase(x, E0, model, arguments):
    """Muller's method from x, with (0, E0) as its other point; (alpha, found, result of the last attempt)."""
    xa, Ea, xb, Eb = 0.0, E0, 0.0, E0
    c1, c2 = 0.0, model[1]  # the curvature of the last step's model serves until there is a third point
    result = attempt(x, False, arguments)
    for k in range(MULLER_LIMIT):
        E, unit, status = result[4:]
        if status != SOLVED:
            break
        if k == 0:
            c1 = (E - E0) / x + c2 * x
            model[0] = c1 - 2 * c2 * x
        elif x != xb and x != xa and xa != xb:
            c1, c2 = muller(xa, xb, x, Ea, Eb, E)
            if k == 1 and abs(Eb) > 1e4 * unit:
                model[0], model[1] = c1 - 2 * c2 * x, c2
        if abs(E) <= unit or (k > 1 and abs(E) <= SLACK * unit and abs(E) >= 0.5 * abs(Eb)):
            return x, True, result
        move = smaller_root(E, c1, c2)
        if not abs(x + move) <= RADIUS and Eb != E:
            move = -E * (x - xb) / (E - Eb)  # the parabola has no root: the secant
        xa, Ea, xb, Eb = xb, Eb, x, E
        x = x + move
        if not abs(x) <= RADIUS or x == xb:
            break
        result = attempt(x, False, arguments)
    return x, False, result


@jit
def find(model, arguments):
    """The root next to zero; (alpha, found, status, result of the attempt at alpha)."""
    result = attempt(0.0, True, arguments)
    E0, unit, status = result[4:]
    if status != SOLVED or abs(E0) <= unit:
        return 0.0, True, status, result
    x = smaller_root(E0, model[0], model[1])
    if not 0 < abs(x) <= RADIUS:
        x = FIRST
    x, found, result = chase(x, E0, model, arguments)
    if not found or abs(x) > NEAR:
        x, found = (0.0, True) if abs(E0) <= SLACK * unit else search(E0, arguments)
        result = attempt(x, True, arguments)
    return x, found, result[6], result


def run(energy, field, dT, dV, plan, table, h, every, eps, zero, state, memory, work, Q, P, aux, counts):
    """Fill the rows of Q, P and aux (the last alpha of the row, NaN for a fallback); returns (rows filled, status)."""
    q, p, cq, cp = opened(state, zero)
    slots = int(plan[2, 1])
    like = stages.unknown(field, zero)
    for row in range(len(Q)):
        alpha, found = 0.0, True
        for _ in range(every):
            v = stages.drift(field, dT, p, h)
            arguments = energy, field, dT, dV, plan, table, h, eps, zero, q, p, cq, cp, v, memory, work, counts
            alpha, found, status, result = find(state[4], arguments)
            if status != SOLVED:
                return row, status
            q, p, cq, cp = result[0], result[1], result[2], result[3]
            stages.copy(memory, LEVELS * slots, counts[0] % LEVELS * slots, slots, like)
            counts[0] += 1
            if not found:
                counts[3] += 1
        store(Q, row, q)
        store(P, row, p)
        aux[row] = alpha if found else np.nan
    close(state, q, p, cq, cp)
    return len(Q), 0


def skew(s: int, nodes):
    """S = P V P^T at the nodes, as a list of rows."""
    P = [legendre(s, c) for c in nodes]
    return [[a[s - 1] * b[s - 2] - a[s - 2] * b[s - 1] for b in P] for a in P]


def prepare(method, system, arithmetic):
    """Of data (s,); the Nystrom form where T is quadratic."""
    (s,) = method.data
    inner = stages.prepare(replace(method, data=("gauss", s)), system, arithmetic)
    energy = system.energy(arithmetic)
    with mpmath.workdps(40 if arithmetic == DOUBLE else mpmath.mp.dps + 10):
        A, _, b, c = tableaus.runge_kutta("gauss", s)
        S = skew(s, c)
        base = array([(b[i], c[i], *(A[i, j] / b[j] for j in range(s)), *S[i]) for i in range(s)], arithmetic)
    table = zeros((2 * s + 1, inner.table.shape[1]), arithmetic)
    table[:s], table[s : 2 * s, : base.shape[1]] = inner.table, base

    def begin(table, q, p):
        table[2 * s, 0] = energy(q, p)[0]

    return replace(inner, run=run, functions=(energy, *inner.functions), table=table, begin=begin, missed=MISSED)
