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

The integral is a Gauss-Legendre sum: exact with ceil(m/2) nodes for a polynomial H of degree m; otherwise there is a
list of rules of rising size, and a step takes the first that the next one confirms to round-off.  The confirming sweep
is itself an iterate of the finer rule, so nothing of it is lost.  A step that the largest rule leaves unconfirmed is
counted as a fallback.

Source: G. R. W. Quispel, D. I. McLaren, J. Phys. A 41 (2008) 045206; E. Celledoni et al., M2AN 43 (2009) 645-649;
W. Cai, H. Li, Y. Wang, J. Comput. Phys. 370 (2018) 25-42; T. Itoh, K. Abe, J. Comput. Phys. 76 (1988) 85-102.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import Any, NamedTuple

import mpmath
import numpy as np

from phasebench.integrators.coefficients.quadrature import LARGE, RULES, gauss_legendre, sizes
from phasebench.integrators.engine.codegen import DOUBLE
from phasebench.integrators.engine.kernel import Prepared, array, fixed, numbers
from phasebench.integrators.engine.lazy import sympy as sp
from phasebench.integrators.engine.solve import SOLVED, Change, change, predict, remember, solver, unchanged
from phasebench.integrators.engine.vector import (
    advanced,
    axpy,
    chosen,
    close,
    elementwise,
    head,
    inlined,
    join,
    keep,
    load,
    opened,
    plus,
    scale,
    size,
    tail,
)


class Averaged(NamedTuple):
    """Substeps along paths, and quadrature rules.

    Substep s takes ``fraction[s]`` of h, its components belong to the blocks ``place[s]``, it goes along the path
    (``direction`` 1), its reverse (-1) or both (0).  ``path`` is None where every substep has one block only.  A rule
    is a range of nodes c with weights b, each with the ``nodes`` of its rule.
    """

    path: Callable | None
    field: Callable
    place: np.ndarray
    blocks: np.ndarray
    direction: np.ndarray
    fraction: np.ndarray
    nodes: np.ndarray
    c: np.ndarray
    b: np.ndarray
    h: float = 0.0
    eps: float = 0.0


class Average(NamedTuple):
    """The equation of substep s of length h from (q, p), by the rule that begins with the node ``rule``."""

    step: Averaged
    q: Any
    p: Any
    h: float
    s: int
    rule: int


@elementwise()
def moved(direction, b, place, s, x, y):
    """The point of the path where block b has gone the part s of its way; ``direction`` -1: on the reverse path."""
    return y + np.minimum(np.maximum(direction * (b - place) + s, 0.0), 1.0) * x


@elementwise()
def of_block(b, place, a, f, total):
    """total + a f in the components of block b."""
    return total + a * (place == b) * f


@inlined
def one_way(direction, x, e):
    """h times the mean of f along a path: each block's part of the gradient where that block moves."""
    step = e.step
    place = load(step.place, e.s, x)
    at_q, at_p = head(place), tail(place)
    total = scale(0.0, x)
    for b in range(step.blocks[e.s]):
        for i in range(e.rule, e.rule + step.nodes[e.rule]):
            c, a = step.c[i], step.b[i] * e.h
            q, p = moved(direction, b, at_q, c, head(x), e.q), moved(direction, b, at_p, c, tail(x), e.p)
            dq, dp = step.field(q, p, e.h, 0.0)
            # q' is a derivative by p: it belongs to the block of p
            total = join(of_block(b, at_p, a, dq, head(total)), of_block(b, at_q, a, dp, tail(total)))
    return total


def _along(path, x, e):
    direction = e.step.direction[e.s]
    if direction == 0:
        return scale(0.5, plus(one_way(1.0, x, e), one_way(-1.0, x, e)))
    return one_way(direction, x, e)


def _straight(path, x, e):
    step = e.step
    total = scale(0.0, x)
    for i in range(e.rule, e.rule + step.nodes[e.rule]):
        c = step.c[i]
        dq, dp = step.field(axpy(c, head(x), e.q), axpy(c, tail(x), e.p), e.h, 0.0)
        total = axpy(step.b[i] * e.h, join(dq, dp), total)
    return total


_mean = chosen(_straight, _along)


@inlined
def mean(x, e):
    """h times the mean of f between (q, p) and (q, p) + x, over the straight line or the path."""
    return _mean(e.step.path, x, e)


solve_mean = solver(mean)


@inlined
def increment(step, y, s, orbit, counts):
    """(The increment of substep s from y, status), with rules of rising size until one is confirmed."""
    eps, several = step.eps, len(step.nodes) > step.nodes[0]
    sweeps = step.blocks[s] * (2 if step.direction[s] == 0 else 1)
    x = predict(orbit.memory, s, len(step.fraction), counts.steps, join(orbit.zero, orbit.zero))
    h = step.fraction[s] * step.h
    span = size(y.q) + size(y.p)
    move = Change(np.inf, np.inf, np.inf, np.inf)
    rule = before = counts.rule
    while True:
        x, n, used, status = solve_mean(Average(step, y.q, y.p, h, s, rule), x, span, eps, orbit.work)
        counts.gradient += n * sweeps * step.nodes[rule]
        counts.newton += used
        following = rule + step.nodes[rule]
        if status != SOLVED or not several:
            break
        if following == len(step.nodes):
            counts.fallbacks += 1
            break
        new = mean(x, Average(step, y.q, y.p, h, s, following))
        counts.gradient += sweeps * step.nodes[following]
        last, move = move, change(x, new)
        x = new
        sure, ended = unchanged(move, last, abs(h) * span, eps)
        if sure:
            break
        if ended:  # the next step need not begin with the rule that only showed the end
            rule = before
            break
        before, rule = rule, following
    counts.rule = rule
    return x, status


def run(step, orbit, samples, counts):
    """The kernel."""
    y = opened(orbit)
    stages = len(step.fraction)
    for row in range(len(samples.q)):
        for _ in range(samples.every):
            for s in range(stages):
                if counts.steps % 16 == 0:
                    counts.rule = 0
                x, status = increment(step, y, s, orbit, counts)
                if status != SOLVED:
                    return row, status
                remember(orbit.memory, s, stages, counts.steps, x)
                y = advanced(y, head(x), tail(x))
            counts.steps += 1
        keep(samples, row, y)
    close(orbit, y)
    return len(samples.q), 0


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


def prepare(method, system, arithmetic):
    """One exact rule for a polynomial H, else the list of rules; substeps (fraction, path, direction)."""
    digits, rules = (40, RULES) if arithmetic == DOUBLE else (mpmath.mp.dps, LARGE)
    nodes, c, b = zip(
        *((n, x, w) for n in sizes(1, system.polynomial_degree, rules) for x, w in gauss_legendre(n, digits)),
        strict=True,
    )
    rows = []
    for fraction, path, direction in method.data:
        if not coupled(path, system):
            path, direction = "whole", 1
        place = PATHS[path](system.d)
        rows.append((place, 1 + max(place), float(direction), fraction))
    place, blocks, directions, fractions = zip(*rows, strict=True)
    step = Averaged(
        path=system.field(arithmetic) if max(blocks) > 1 else None,
        field=system.field(arithmetic),
        place=array(place, arithmetic),
        blocks=fixed(blocks),
        direction=fixed(directions),
        fraction=numbers(fractions, arithmetic),
        nodes=fixed(nodes),
        c=numbers(c, arithmetic),
        b=numbers(b, arithmetic),
    )
    return Prepared(run, step, 2 * system.d, len(rows))
