r"""Averaged vector fields along a path of blocks: discrete gradients that keep H for every Hamiltonian.

With y = (q, p) and the increment x of a step let each component i belong to a block :math:`b_i`.  The path from y to
y + x moves one block after the other; component i of the gradient is averaged over the piece that moves its own block,

.. math::
    x = h J^{-1} \bar\nabla H,\qquad
    \bar\nabla_i H = \int_0^1 H_{y_i}\bigl(y + w(b_i, s)\circ x\bigr)\,ds,\qquad
    w_j(b, s) = 1, s, 0 \text{ where } b_j <, =, > b .

Then :math:`\bar\nabla H\cdot x = H(y + x) - H(y)`, so that H is kept.  One block is the averaged vector field method
(AVF), the momenta and then the coordinates make the partitioned one, 2d blocks the coordinate increments of Itoh and
Abe: an average over a single component is a difference quotient.  The reverse path gives the adjoint method; the mean
over both paths, and the composition of both maps over half steps, are symmetric.  Where H has no term in variables of
two blocks, every path is AVF (the partitioned method where H is separable).

The integral is a Gauss-Legendre sum: exact with ceil(m/2) nodes for a polynomial H of degree m; otherwise ``table``
lists rules of rising size, and a step takes the first that the next one confirms to round-off.  The confirming sweep
is itself an iterate of the finer rule, so nothing of it is lost.  A step that the largest rule leaves unconfirmed is
counted as a fallback.

Source: G. R. W. Quispel, D. I. McLaren, J. Phys. A 41 (2008) 045206; E. Celledoni et al., M2AN 43 (2009) 645-649;
W. Cai, H. Li, Y. Wang, J. Comput. Phys. 370 (2018) 25-42; T. Itoh, K. Abe, J. Comput. Phys. 76 (1988) 85-102.
"""

from __future__ import annotations

from functools import cache
from itertools import combinations

import mpmath
import numpy as np
import sympy as sp

from phasebench.integrators.coefficients.quadrature import RULES, gauss_legendre
from phasebench.integrators.engine.codegen import DOUBLE
from phasebench.integrators.engine.kernel import Prepared, array
from phasebench.integrators.engine.solve import SOLVED, confirmed, predict, remember, solver
from phasebench.integrators.engine.vector import (
    add,
    axpy,
    chosen,
    close,
    distance,
    elementwise,
    head,
    inlined,
    join,
    load,
    opened,
    plus,
    scale,
    size,
    store,
    tail,
)


@elementwise()
def moved(direction, b, place, s, x, y):
    """The point of the path where block b has gone the part s of its way; ``direction`` -1: on the reverse path."""
    return y + np.minimum(np.maximum(direction * (b - place) + s, 0.0), 1.0) * x


@elementwise()
def of_block(b, place, a, f, total):
    """total + a f in the components of block b."""
    return total + a * (place == b) * f


@inlined
def one_way(direction, x, arguments):
    """h times the mean of f along a path: each block's part of the gradient where that block moves."""
    field, q, p, h, table, first, plan, s = arguments
    place = load(plan, s, x)
    at_q, at_p = head(place), tail(place)
    total = scale(0.0, x)
    for b in range(int(plan[s, len(x)])):
        for i in range(first, first + int(table[first, 0])):
            c, a = table[i, 1], table[i, 2] * h
            dq, dp = field(moved(direction, b, at_q, c, head(x), q), moved(direction, b, at_p, c, tail(x), p), h, 0.0)
            # q' is a derivative by p: it belongs to the block of p
            total = join(of_block(b, at_p, a, dq, head(total)), of_block(b, at_q, a, dp, tail(total)))
    return total


def _along(path, x, arguments):
    plan, s = arguments[6:]
    direction = plan[s, len(x) + 1]
    if direction == 0:
        return scale(0.5, plus(one_way(1.0, x, arguments), one_way(-1.0, x, arguments)))
    return one_way(direction, x, arguments)


def _straight(path, x, arguments):
    field, q, p, h, table, first = arguments[:6]
    total = scale(0.0, x)
    for i in range(first, first + int(table[first, 0])):
        s = table[i, 1]
        dq, dp = field(axpy(s, head(x), q), axpy(s, tail(x), p), h, 0.0)
        total = axpy(table[i, 2] * h, join(dq, dp), total)
    return total


#: h times the mean of f between (q, p) and (q, p) + x, by the rule in rows first, ... of the table: over the straight
#: line where ``path`` is None, else over the path of row s of the plan; (path, x, arguments) -> x.
mean = chosen(_straight, _along)


@inlined
def averaged(x, arguments):
    """The equation's right-hand side, for arguments (path, (field, q, p, h, table, first, plan, s))."""
    return mean(arguments[0], x, arguments[1])


solve_averaged = solver(averaged)


def run(path, field, plan, table, h, every, eps, zero, state, memory, work, Q, P, aux, counts):
    """Fill the rows of Q and P, each after ``every`` steps; returns (rows, status).

    A row of ``plan`` is a substep: the 2d blocks of the components, the number of blocks, the direction of the path
    (0: the mean of both) and the fraction of h.  ``path`` is None where every substep has one block only.
    """
    q, p, cq, cp = opened(state, zero)
    both = join(zero, zero)
    n = len(both)
    slots = len(plan)
    first = counts[4]
    for row in range(len(Q)):
        for _ in range(every):
            for s in range(slots):
                c = plan[s, n + 2] * h
                sweeps = int(plan[s, n]) * (2 if plan[s, n + 1] == 0 else 1)
                x = predict(memory, s, slots, counts[0], both)
                if counts[0] % 16 == 0:
                    first = 0
                moved_q = moved_p = np.inf
                before = first
                while True:
                    nodes = int(table[first, 0])
                    span = size(q) + size(p)
                    arguments = path, (field, q, p, c, table, first, plan, s)
                    x, sums, used, status = solve_averaged(arguments, x, span, eps, work)
                    counts[1] += sums * sweeps * nodes
                    counts[2] += used
                    if status != SOLVED:
                        return row, status
                    if len(table) == int(table[0, 0]):
                        break
                    if first + nodes == len(table):
                        counts[3] += 1
                        break
                    new = averaged(x, (path, (field, q, p, c, table, first + nodes, plan, s)))
                    counts[1] += sweeps * int(table[first + nodes, 0])
                    last_q, last_p = moved_q, moved_p
                    moved_q, moved_p = distance(head(new), head(x)), distance(tail(new), tail(x))
                    x = new
                    noise = abs(c) * span
                    sure_q, ended_q = confirmed(moved_q, last_q, size(head(x)), noise, eps)
                    sure_p, ended_p = confirmed(moved_p, last_p, size(tail(x)), noise, eps)
                    if sure_q and sure_p:
                        break
                    if ended_q and ended_p:  # the next step need not begin with the rule that only showed the end
                        first = before
                        break
                    before = first
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


#: They are computed once, not for every run.
rule = cache(gauss_legendre)
#: Path -> d -> the blocks of q1, ..., qd, p1, ..., pd, in the order in which they move.
PATHS = {
    "whole": lambda d: (0,) * 2 * d,
    "momenta, coordinates": lambda d: (1,) * d + (0,) * d,
    "components": lambda d: tuple(range(2 * d)),
}


def coupled(path: str, system) -> bool:
    """Whether H has a term in variables of two blocks of the path; where not, the path makes no difference to AVF."""
    place = PATHS[path](system.d)
    if len(set(place)) == 1 or (path == "momenta, coordinates" and system.separable):
        return False
    variables = zip((*system.q, *system.p), place, strict=True)
    return any(a != b and sp.expand(sp.diff(system.H, x, y)) != 0 for (x, a), (y, b) in combinations(variables, 2))


def is_avf(method, system) -> bool:
    """Whether every substep is one of the averaged vector field method, because no path makes a difference."""
    return not any(coupled(path, system) for _, path, _ in method.data)


def prepare(method, system, arithmetic):
    """One exact rule for a polynomial H, else the list of rules; substeps (fraction, path, direction)."""
    degree = system.polynomial_degree
    sizes = RULES if degree is None else (max(1, -(-degree // 2)),)
    if arithmetic != DOUBLE and degree is None:
        sizes = (*RULES, 48, 64)
    digits = 40 if arithmetic == DOUBLE else mpmath.mp.dps
    table = array([(n, x, w) for n in sizes for x, w in rule(n, digits)], arithmetic)
    rows = []
    for fraction, path, direction in method.data:
        if not coupled(path, system):
            path, direction = "whole", 1
        place = PATHS[path](system.d)
        rows.append((*place, 1 + max(place), direction, fraction))
    field = system.field(arithmetic)
    path = field if any(blocks > 1 for *_, blocks, _, _ in rows) else None
    return Prepared(run, (path, field), array(rows, arithmetic), table, 2 * system.d, len(rows))
