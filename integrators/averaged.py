r"""The averaged vector field method (AVF), which keeps H for every Hamiltonian.

.. math::
    y_{1} = y_0 + h \int_0^1 J^{-1}\nabla H\bigl((1 - s) y_0 + s y_1\bigr)\,ds .

The integral is a Gauss-Legendre sum: exact with ceil(m/2) nodes for a polynomial H of degree m; otherwise ``table``
lists rules of rising size, and a step takes the first that the next one confirms to round-off.  The confirming sweep
is itself an iterate of the finer rule, so nothing of it is lost.  A step that the largest rule leaves unconfirmed is
counted as a fallback.

Source: G. R. W. Quispel, D. I. McLaren, J. Phys. A 41 (2008) 045206; E. Celledoni et al., M2AN 43 (2009) 645-649.
"""

from __future__ import annotations

import mpmath

from .codegen import DOUBLE
from .compile import Prepared, array
from .solve import SOLVED, predict, remember, solver
from .vector import add, axpy, close, distance, head, inlined, join, opened, scale, size, store, tail


@inlined
def averaged(x, arguments):
    """h times the mean of f between (q, p) and (q, p) + x, by the rule in rows first, ... of the table."""
    field, q, p, h, table, first = arguments
    total = scale(0.0, x)
    for i in range(first, first + int(table[first, 0])):
        s = table[i, 1]
        dq, dp = field(axpy(s, head(x), q), axpy(s, tail(x), p), h, 0.0)
        total = axpy(table[i, 2] * h, join(dq, dp), total)
    return total


solve_averaged = solver(averaged)


def run(field, plan, table, h, every, eps, zero, state, memory, work, Q, P, aux, counts):
    """Fill the rows of Q and P, each after ``every`` steps (of substeps ``plan[s, 0]`` h); returns (rows, status)."""
    q, p, cq, cp = opened(state, zero)
    both = join(zero, zero)
    slots = len(plan)
    first = counts[4]
    for row in range(len(Q)):
        for _ in range(every):
            for s in range(slots):
                c = plan[s, 0] * h
                x = predict(memory, s, slots, counts[0], both)
                if counts[0] % 16 == 0:
                    first = 0
                last = eps
                while True:
                    nodes = int(table[first, 0])
                    span = size(q) + size(p)
                    x, n, used, status = solve_averaged((field, q, p, c, table, first), x, span, eps, work)
                    counts[1] += n * nodes
                    counts[2] += used
                    if status != SOLVED:
                        return row, status
                    if len(table) == int(table[0, 0]):
                        break
                    if first + nodes == len(table):
                        counts[3] += 1
                        break
                    new = averaged(x, (field, q, p, c, table, first + nodes))
                    counts[1] += int(table[first + nodes, 0])
                    delta = distance(new, x)
                    x = new
                    if delta <= 4 * eps * size(x) or (delta > 0.5 * last and delta <= 64 * eps * (size(x) + c * span)):
                        break
                    last = delta
                    first += nodes
                remember(memory, s, slots, counts[0], x)
                q, cq = add(q, cq, head(x))
                p, cp = add(p, cp, tail(x))
            counts[0] += 1
        store(Q, row, q)
        store(P, row, p)
    close(state, q, p, cq, cp)
    counts[4] = first
    return len(Q), 0


#: Sizes of the rules for an H that is no polynomial.
RULES = (2, 3, 4, 6, 8, 12, 16, 24, 32)


def gauss_legendre(nodes, digits=40):
    """[(node, weight), ...] of the Gauss-Legendre rule on [0, 1], as mpmath numbers of so many digits."""
    with mpmath.workdps(digits + 10):
        rule = []
        for i in range(nodes):
            x = mpmath.cos(mpmath.pi * (i + mpmath.mpf(3) / 4) / (nodes + mpmath.mpf(1) / 2))
            for _ in range(100):
                previous, value = mpmath.mpf(1), x
                for k in range(2, nodes + 1):
                    previous, value = value, ((2 * k - 1) * x * value - (k - 1) * previous) / k
                if nodes == 1:
                    previous, value = mpmath.mpf(1), x
                slope = nodes * (x * value - previous) / (x * x - 1)
                move = value / slope
                x -= move
                if abs(move) < mpmath.mpf(10) ** (-digits - 5):
                    break
            rule.append(((1 - x) / 2, 1 / ((1 - x * x) * slope * slope)))
        return rule


def prepare(method, system, arithmetic):
    """One exact rule for a polynomial H, else the list of rules."""
    degree = system.polynomial_degree
    sizes = RULES if degree is None else (max(1, -(-degree // 2)),)
    if arithmetic != DOUBLE and degree is None:
        sizes = (*RULES, 48, 64)
    digits = 40 if arithmetic == DOUBLE else mpmath.mp.dps
    table = array([(n, x, w) for n in sizes for x, w in gauss_legendre(n, digits)], arithmetic)
    plan = array([[c] for c in method.data[0]], arithmetic)
    return Prepared(run, (system.field(arithmetic),), plan, table, 2 * system.d, len(plan))
