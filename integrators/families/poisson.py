r"""Energy-preserving collocation for Poisson systems :math:`\dot y = B(y)\nabla H(y)`, canonical ones among them.

With the nodes :math:`c_i` and weights :math:`b_i` of the Gauss rule of s nodes, their Lagrange polynomials
:math:`\ell_i`, and the polynomial Y of degree s with :math:`Y(0) = y_0` and

.. math::
    \dot Y(c_i) = h\,B\bigl(Y(c_i)\bigr) \int_0^1 \frac{\ell_i(\tau)}{b_i}\,\nabla H\bigl(Y(\tau)\bigr)\,d\tau,
    \qquad y_1 = Y(1) .

Then :math:`H(y_1) - H(y_0) = \sum_i b_i g_i\cdot B(Y(c_i))\,g_i h = 0` with the integrals :math:`g_i`; a quadratic
Casimir C is kept because the rule is exact for :math:`\dot Y\cdot\nabla C(Y)`.  The order is 2s.  For s = 1 the line
from y_0 to y_1 takes the place of Y and B is taken in the middle: on canonical systems this is the averaged vector
field method, for all s the continuous Petrov-Galerkin method of `stages`.  The map is no Poisson map.

Unknown are the weighted increments :math:`x_i = b_i\dot Y(c_i)`, so that
:math:`Y(\tau) = y_0 + \sum_i x_i \int_0^\tau \ell_i / b_i` and :math:`y_1 = y_0 + \sum_i x_i`.  They are solved for by
fixed point to round-off, by Newton's method with a difference Jacobian where that does not contract.  The integrals are
Gauss-Legendre sums: exact with ceil(sm/2) nodes for a polynomial H of degree m; otherwise ``table`` lists rules of
rising size, and a step takes the first that the next one confirms to round-off (as in `averaged`).  A step that the
largest rule leaves unconfirmed is counted as a fallback.

``plan`` has s rows :math:`\int_0^{c_i} \ell_l / b_l`; ``table`` a row for each node of a rule: the size of the rule,
:math:`\int_0^\tau \ell_l / b_l` and the weight times :math:`\ell_l(\tau)`, l = 1, ..., s.

Source: D. Cohen, E. Hairer, "Linear energy-preserving integrators for Poisson systems", BIT 51 (2011) 91-101,
section 2; E. Hairer, J. Numer. Anal. Ind. Appl. Math. 5 (2010) 73-84 (canonical systems).
"""

from __future__ import annotations

from functools import cache

import mpmath
import numpy as np

from phasebench.integrators.coefficients.quadrature import RULES, gauss_legendre, legendre, legendre_integrals
from phasebench.integrators.engine.codegen import DOUBLE
from phasebench.integrators.engine.kernel import Prepared, array
from phasebench.integrators.engine.solve import (
    FIXED_POINT_LIMIT,
    LEVELS,
    NEWTON_LIMIT,
    NOT_FINITE,
    SOLVED,
    STALLED,
    confirmed,
    gauss,
    polished,
    predict,
    settled,
)
from phasebench.integrators.engine.vector import (
    add,
    axpy,
    chosen,
    close,
    distance,
    head,
    inlined,
    jit,
    join,
    load,
    opened,
    plus,
    scale,
    size,
    store,
    tail,
)

from .collocation import copy

#: B(q, p) applied to an integral g; of a canonical system the field itself is integrated and B is the identity.
applied = chosen(
    lambda structure, q, p, g: g,
    lambda structure, q, p, g: join(*structure(q, p, head(g), tail(g))),
)


@inlined
def at(weights, i, first, slots, memory, rows, like):
    """The sum of ``weights[i, first + j]`` times the increment in row ``rows + j`` of the memory."""
    x = like
    for j in range(slots):
        x = axpy(weights[i, first + j], load(memory, rows + j, like), x)
    return x


@inlined
def sweep(arguments, table, first, old, new):
    """The right-hand sides at the increments in rows ``old``, into rows ``new``; (their distance, their size)."""
    structure, gradient, h, zero, q, p, plan, memory = arguments
    like = join(zero, zero)
    slots = len(plan)
    for j in range(slots):
        store(memory, new + j, like)
    for i in range(first, first + int(table[first, 0])):
        x = at(table, i, 1, slots, memory, old, like)
        a, b = gradient(plus(q, head(x)), plus(p, tail(x)), h, 0.0)
        g = join(a, b)
        for j in range(slots):
            store(memory, new + j, axpy(table[i, 1 + slots + j], g, load(memory, new + j, like)))
    delta, length = 0.0, 0.0
    for j in range(slots):
        x = at(plan, j, 0, slots, memory, old, like)
        z = scale(h, applied(structure, plus(q, head(x)), plus(p, tail(x)), load(memory, new + j, like)))
        store(memory, new + j, z)
        delta += distance(z, load(memory, old + j, like))
        length += size(z)
    return delta, length


@inlined
def changes(memory, old, new, slots, like):
    """Distances of the rows ``old`` from the rows ``new`` and the latter's sizes: of q, of p."""
    moved_q, moved_p, size_q, size_p = 0.0, 0.0, 0.0, 0.0
    for j in range(slots):
        x, y = load(memory, old + j, like), load(memory, new + j, like)
        moved_q += distance(head(x), head(y))
        moved_p += distance(tail(x), tail(y))
        size_q += size(head(y))
        size_p += size(tail(y))
    return moved_q, moved_p, size_q, size_p


@jit
def newton(arguments, table, first, here, eps, work):
    """Newton's method for the increments in the rows ``here``; returns (sweeps, status)."""
    zero, q, p, plan, memory = arguments[3:]
    like = join(zero, zero)
    slots, n = len(plan), len(like)
    order = slots * n
    base, moved = here + slots, here + 2 * slots
    span = size(q) + size(p)
    step = eps**0.5 * span
    last = np.inf
    sweeps = 0
    for _ in range(NEWTON_LIMIT):
        sweep(arguments, table, first, here, base)
        for c in range(order):
            row, i = here + c // n, c % n
            value = memory[row, i]
            memory[row, i] = value + step
            sweep(arguments, table, first, here, moved)
            memory[row, i] = value
            for r in range(order):
                change = memory[moved + r // n, r % n] - memory[base + r // n, r % n]
                work[r, c] = (1.0 if r == c else 0.0) - change / step
        sweeps += order + 1
        for r in range(order):
            work[r, order] = memory[base + r // n, r % n] - memory[here + r // n, r % n]
            if not abs(work[r, order]) < np.inf:
                return sweeps, NOT_FINITE
        if not gauss(work, order):
            return sweeps, STALLED
        delta, length = 0.0, 0.0
        for r in range(order):
            row, i = here + r // n, r % n
            memory[row, i] += work[r, order]
            delta += abs(work[r, order])
            length += abs(memory[row, i])
        if not delta < np.inf:
            return sweeps, NOT_FINITE
        if polished(delta, last, eps * length, eps * span):
            return sweeps, SOLVED
        last = delta
    return sweeps, STALLED


@inlined
def solve(arguments, table, first, here, eps, work):
    """Solve for the increments in rows ``here``, from the start that stands there; (sweeps, Newton used, status).

    The rows from ``here + slots`` to ``here + 4 slots`` are written over.
    """
    zero, q, p, plan, memory = arguments[3:]
    like = join(zero, zero)
    slots = len(plan)
    new, start = here + slots, here + 3 * slots
    copy(memory, here, start, slots, like)
    span = size(q) + size(p)
    last = np.inf
    growth = 0
    k = 0
    while k < FIXED_POINT_LIMIT and growth < 2:
        delta, length = sweep(arguments, table, first, here, new)
        copy(memory, new, here, slots, like)
        k += 1
        if not delta < np.inf:
            break
        if settled(delta, last, length, span, eps):
            return k, 0, SOLVED
        if delta >= last:
            growth += 1
        last = delta
    copy(memory, start, here, slots, like)
    n, status = newton(arguments, table, first, here, eps, work)
    if status != SOLVED:
        for j in range(slots):
            store(memory, here + j, like)
        more, status = newton(arguments, table, first, here, eps, work)
        n += more
    return k + n, 1, status


def run(structure, gradient, plan, table, h, every, eps, zero, state, memory, work, Q, P, aux, counts):
    """Fill the rows of Q and P, each after ``every`` steps; returns (rows filled, status)."""
    q, p, cq, cp = opened(state, zero)
    both = join(zero, zero)
    slots = len(plan)
    here = LEVELS * slots
    first = counts[4]
    for row in range(len(Q)):
        for _ in range(every):
            if counts[0] % 16 == 0:
                first = 0
            arguments = structure, gradient, h, zero, q, p, plan, memory
            for j in range(slots):
                store(memory, here + j, predict(memory, j, slots, counts[0], both))
            noise = abs(h) * (size(q) + size(p))
            moved_q = moved_p = np.inf
            before = first
            while True:
                nodes = int(table[first, 0])
                sweeps, used, status = solve(arguments, table, first, here, eps, work)
                counts[1] += sweeps * nodes
                counts[2] += used
                if status != SOLVED:
                    return row, status
                following = first + nodes
                if nodes == len(table):
                    break
                if following == len(table):
                    counts[3] += 1
                    break
                sweep(arguments, table, following, here, here + slots)
                last_q, last_p = moved_q, moved_p
                moved_q, moved_p, size_q, size_p = changes(memory, here, here + slots, slots, both)
                copy(memory, here + slots, here, slots, both)
                counts[1] += int(table[following, 0])
                sure_q, ended_q = confirmed(moved_q, last_q, size_q, noise, eps)
                sure_p, ended_p = confirmed(moved_p, last_p, size_p, noise, eps)
                if sure_q and sure_p:
                    break
                if ended_q and ended_p:  # as in `averaged`
                    first = before
                    break
                before, first = first, following
            copy(memory, here, counts[0] % LEVELS * slots, slots, both)
            x = both
            for j in range(slots):
                x = plus(x, load(memory, here + j, both))
            q, cq = add(q, cq, head(x))
            p, cp = add(p, cp, tail(x))
            counts[0] += 1
        store(Q, row, q)
        store(P, row, p)
    close(state, q, p, cq, cp)
    counts[4] = first
    return len(Q), 0


@cache
def coefficients(s: int, sizes: tuple[int, ...], digits: int):
    """(rows of the plan, rows of the table), as mpmath numbers of so many digits."""
    with mpmath.workdps(digits + 10):
        gauss_rule = gauss_legendre(s, digits)
        # ell_l / b_l = sum_j P_j(c_l) P_j: the nodes' own rule is exact for the products of degree 2s - 2
        values = [legendre(s, c) for c, _ in gauss_rule]

        def combined(basis, j):
            return mpmath.fsum(a * b for a, b in zip(values[j], basis, strict=True))

        plan, table = [], []
        for c, _ in gauss_rule:
            basis = legendre_integrals(s, c)
            plan.append(tuple(combined(basis, j) for j in range(s)))
        for k in sizes:
            for x, weight in gauss_legendre(k, digits):
                integrals, plain = legendre_integrals(s, x), legendre(s, x)
                forces = [weight * b * combined(plain, j) for j, (_, b) in enumerate(gauss_rule)]
                table.append((k, *(combined(integrals, j) for j in range(s)), *forces))
    return plan, table


def prepare(method, system, arithmetic):
    """Of data (s,): one exact rule for a polynomial H, else the list of rules."""
    (s,) = method.data
    degree = system.polynomial_degree
    sizes = (max(s, -(-s * degree // 2)),) if degree else tuple(k for k in RULES if k >= s)
    if arithmetic != DOUBLE and not degree:
        sizes = (*(k for k in sizes if k >= 8), 48, 64)
    plan, table = coefficients(s, sizes, 40 if arithmetic == DOUBLE else mpmath.mp.dps)
    if system.canonical:
        functions = (None, system.field(arithmetic))
    else:
        functions = (system.structure(arithmetic), system.gradient(arithmetic))
    width = 2 * system.d
    return Prepared(run, functions, array(plan, arithmetic), array(table, arithmetic), width, s, linear=s * width)
