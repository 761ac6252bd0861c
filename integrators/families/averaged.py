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

Where H = p . M^-1 p / 2 + V(q) and the path has one block, the unknown is the kick k, the increment of p, alone:

.. math::
    \Delta q = hM^{-1}(p + k/2),\qquad k = -h\int_0^1 \nabla V(q + s\,\Delta q)\,ds .

The fixed point of this equation contracts with the square of h, that of both increments with h.

The integral is a Gauss-Legendre sum: exact with ceil(m/2) nodes for a polynomial H of degree m; otherwise there is a
list of rules of rising size, and a step takes the first that the next one confirms to round-off.  The confirming sweep
is itself an iterate of the finer rule, so that no work is lost.  A step that the largest rule leaves unconfirmed is
counted as a fallback.  The nodes of a rule are evaluated side by side in SIMD lanes if the system's functions compile
for them (`orbit_lanes.twin`); lanes that are left over repeat a node with the weight 0.

Source: G. R. W. Quispel, D. I. McLaren, J. Phys. A 41 (2008) 045206; E. Celledoni et al., M2AN 43 (2009) 645-649;
W. Cai, H. Li, Y. Wang, J. Comput. Phys. 370 (2018) 25-42; T. Itoh, K. Abe, J. Comput. Phys. 76 (1988) 85-102.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import mpmath
import numpy as np

from phasebench.integrators.coefficients.quadrature import LARGE, RULES, gauss_legendre, sizes
from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Carry, Prepared, array, freeze, numbers
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.orbit_lanes import compiles_in_lanes, twin
from phasebench.integrators.stepping.solve import lengths_of_both, predict, refinement, remember, solver
from phasebench.integrators.values.lanes import Lanes, take, total
from phasebench.integrators.values.vector import (
    State,
    axpy,
    dispatch_on_none,
    elementwise,
    head,
    inline,
    join,
    load,
    plus,
    scale,
    size,
    tail,
    update,
    velocity,
)

from .collocation import add_increments as change
from .parametric import lengths_of_kick, unknown

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.stepping.solve import Change
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Number, Value

#: Nodes side by side, and the least size of the largest rule for which that is faster.
WIDTH, FEWEST = 4, 3


class Averaged(NamedTuple):
    """The data of an averaged vector field method: its substeps, and the quadrature rules for the averages.

    In a substep from y to y + x the components of (q, p) are grouped into blocks, which move from y to y + x one block
    after the other (the *path*); each component of the gradient of H is averaged while its own block moves.  The
    unknown of a substep is the kick (increment of p) alone if ``field`` is None, else the increments of q and p.

    Attributes
    ----------
    path : the vector field (q', p') if some substep has several blocks; None if all components move together in every
        substep, so that each path is a straight line
    field : the vector field (q', p'); None if H = p . M^-1 p / 2 + V(q) and every path is a straight line
    dT, dV : the gradients of T and V, if ``field`` is None
    like : a tuple of zeros, one for each SIMD lane, if several quadrature nodes are evaluated side by side; else None
    place : array (substeps, 2 d), the number of the block of each component of (q, p)
    blocks : the number of blocks of each substep
    direction : for each substep, 1 if blocks move in the order of their numbers, -1 in the reverse order, 0 for the
        mean over both orders
    fraction : the length of each substep as a fraction of h
    c, b : nodes and weights, arrays (rows, lanes): a row has the nodes that are evaluated at once, a rule is some
        successive rows
    nodes, rows : for each row of c and b, the numbers of nodes and of rows of the rule that the row belongs to
    h, eps : the step size and the unit round-off, set by the run
    """

    path: Callable | None
    field: Callable | None
    dT: Callable | None
    dV: Callable | None
    like: tuple | None
    place: np.ndarray
    blocks: np.ndarray
    direction: np.ndarray
    fraction: np.ndarray
    nodes: np.ndarray
    rows: np.ndarray
    c: np.ndarray
    b: np.ndarray
    h: float = 0.0
    eps: float = 0.0


class Average(NamedTuple):
    """Arguments of the equation of a substep of an averaged vector field method, which starts at the state (q, p).

    Attributes
    ----------
    step : the coefficients of the method
    q, p : the state before the substep
    v : M^-1 p if the unknown is the kick (increment of p) alone, else p
    h : the length of the substep
    s : the number of the substep
    rule : the quadrature rule in use, given by its first row in the table of nodes ``step.c``
    """

    step: Averaged
    q: Any
    p: Any
    v: Any
    h: float
    s: int
    rule: int


# -- nodes, one in a row or several in lanes --------------------------------------------------------------------------


@elementwise()
def sum_lanes(x):
    """Sum each component of the vector x over its SIMD lanes; returns a vector of numbers."""
    return total(x)


#: Nodes or weights of a row.
of_row = dispatch_on_none(lambda like, table, row: table[row, 0], lambda like, table, row: take(table, row, like))
#: The sum over the lanes of what was summed over the rows.
over_nodes = dispatch_on_none(lambda like, x: x, lambda like, x: sum_lanes(x))


@inline
def zero_sum(x: Value, e: Average) -> Value:
    """Return a vector of zeros with as many components as x, from which a sum over quadrature nodes starts.

    Each component is a vector of SIMD lanes if the equation with the arguments e has its nodes in lanes, else a number.
    """
    return scale(0.0 * of_row(e.step.like, e.step.b, e.rule), x)


# -- the mean along a path --------------------------------------------------------------------------------------------


@elementwise()
def path_point(direction, b, place, s, x, y):
    """Components of the point y + w x of the path from y to y + x at which block b has gone the fraction s of its way.

    ``place`` is the block of each component; w is 1 in blocks already moved, s in block b, 0 in the others.  The
    reverse path has ``direction`` -1.
    """
    return y + (1.0 * (b == place) * s + 1.0 * (direction * (b - place) > 0)) * x


@elementwise()
def add_to_block(b, place, a, f, sums):
    """Return ``sums`` + a f in the components whose block number in ``place`` is b, and ``sums`` in the others."""
    return sums + 1.0 * (place == b) * a * f


@inline
def mean_one_way(direction: Number, x: Value, e: Average) -> Value:
    """Return h times the mean of the vector field along a path from (q, p) to (q, p) + x, the step's end.

    On the path one block of variables moves after the other, each on a straight line.
    Each derivative of H is averaged over the motion of the block that its variable belongs to: q_i' = dH/dp_i over that
    of the block of p_i.  x has the increments of q and p at the end of the path, e the arguments of the
    equation; ``direction`` is -1 for the reverse path.  Returns a vector of 2 d components.
    """
    step = e.step
    place = load(step.place, e.s, x)
    at_q, at_p = head(place), tail(place)
    sums = zero_sum(x, e)
    for b in range(step.blocks[e.s]):
        for row in range(e.rule, e.rule + step.rows[e.rule]):
            c, a = of_row(step.like, step.c, row), of_row(step.like, step.b, row) * e.h
            q, p = path_point(direction, b, at_q, c, head(x), e.q), path_point(direction, b, at_p, c, tail(x), e.p)
            dq, dp = step.field(q, p, e.h, 0.0)
            # q' is a derivative by p: it belongs to the block of p
            sums = join(add_to_block(b, at_p, a, dq, head(sums)), add_to_block(b, at_q, a, dp, tail(sums)))
    return over_nodes(step.like, sums)


def _mean_along_path(path, x, e):
    direction = e.step.direction[e.s]
    if direction == 0:
        return scale(0.5, plus(mean_one_way(1.0, x, e), mean_one_way(-1.0, x, e)))
    return mean_one_way(direction, x, e)


# -- the mean along the straight line ---------------------------------------------------------------------------------


def _mean_along_line(path, x, e):
    step = e.step
    sums = zero_sum(x, e)
    for row in range(e.rule, e.rule + step.rows[e.rule]):
        c = of_row(step.like, step.c, row)
        dq, dp = step.field(axpy(c, head(x), e.q), axpy(c, tail(x), e.p), e.h, 0.0)
        sums = axpy(of_row(step.like, step.b, row) * e.h, join(dq, dp), sums)
    return over_nodes(step.like, sums)


@inline
def drift(x: Value, e: Average) -> Value:
    """The increment of q in a substep for the kick x, the increment of p: h M^-1 (p + x / 2)."""
    return scale(e.h, axpy(0.5, velocity(e.step.dT, x), e.v))


def _kick(field, x, e):
    step = e.step
    sums, dq = zero_sum(x, e), drift(x, e)
    for row in range(e.rule, e.rule + step.rows[e.rule]):
        c, a = of_row(step.like, step.c, row), of_row(step.like, step.b, row) * -e.h
        sums = axpy(a, step.dV(axpy(c, dq, e.q)), sums)
    return over_nodes(step.like, sums)


_both = dispatch_on_none(_mean_along_line, _mean_along_path)
_mean = dispatch_on_none(_kick, lambda field, x, e: _both(e.step.path, x, e))
_lengths = dispatch_on_none(
    lambda field, x, g, e: lengths_of_kick(x, g, e), lambda field, x, g, e: lengths_of_both(x, g, e)
)
_velocity = dispatch_on_none(lambda field, dT, p: velocity(dT, p), lambda field, dT, p: p)
_end = dispatch_on_none(
    lambda field, y, x, e: update(y, drift(x, e), x), lambda field, y, x, e: update(y, head(x), tail(x))
)


@inline
def mean(x: Value, e: Average) -> Value:
    """Evaluate G(x), the right-hand side of the equation x = G(x) of a substep, at the unknown x.

    G(x) is h times the mean of the vector field (of -grad V if x is a kick) along the path from (q, p) to the state
    that the increment x leads to; ``e`` has what else the equation depends on, q, p and h among it.
    """
    return _mean(e.step.field, x, e)


@inline
def lengths(x: Value, g: Value, e: Average) -> tuple[Number, Number]:
    """Return the sizes of q and of p, to scale finite differences in the first and in the second half of the unknown x.

    If the unknown is the increment of p alone, both numbers are the size of p.  x is an iterate of the equation
    x = G(x) with the arguments e, and g = G(x).
    """
    return _lengths(e.step.field, x, g, e)


solve_mean = solver(mean, lengths)


@inline
def by_rule(e: Average, rule: int) -> Average:
    """Return the arguments ``e`` of the equation of a substep, with their quadrature rule replaced by ``rule``.

    A rule is given by the number of its first row in the table of all rules' nodes and weights.
    """
    return Average(e.step, e.q, e.p, e.v, e.h, e.s, rule)


@inline
def evaluations(e: Average, rule: int) -> int:
    """Number of gradient evaluations in one call of `mean` with the arguments e, but with the quadrature rule ``rule``.

    A rule is given by the number of its first row in the table of all rules' nodes and weights.
    """
    return e.step.blocks[e.s] * (2 if e.step.direction[e.s] == 0 else 1) * e.step.nodes[rule]


@inline
def iterate(e: Average, x: Value) -> tuple[Value, Change]:
    """Take one step of the fixed-point iteration from x: returns (the new x, how far it moved from the old one).

    The latter is a `Change`: 1-norms of what was added to the increments of q and of p, and of these increments.
    """
    new = mean(x, e)
    return new, change(e.step.field, x, new)


refine = refinement(solve_mean, iterate, by_rule, evaluations)


# -- steps ------------------------------------------------------------------------------------------------------------


@inline
def substep(step: Averaged, y: State, s: int, carry: Carry, counts: np.record) -> tuple[State, Value, int]:
    """Take substep s from the state y, with finer and finer quadrature rules until one is confirmed by the next.

    The equation starts from its solutions in earlier steps, kept in ``carry``; evaluations are added to ``counts``.
    Returns (state, the solution x of the substep's equation, status: `SOLVED` or why it failed).
    """
    x = predict(carry.memory, s, len(step.fraction), counts.steps, unknown(step.field, carry.zero))
    v, h = _velocity(step.field, step.dT, y.p), step.fraction[s] * step.h
    span = size(y.q) + size(y.p)
    e = Average(step, y.q, y.p, v, h, s, counts.rule)
    x, status = refine(e, x, span, abs(h) * span, carry.work, counts)
    return _end(step.field, y, x, by_rule(e, counts.rule)), x, status


def step(method: Averaged, y: State, carry: Carry, counts: np.record) -> tuple[State, int]:
    """Take one step from the state y, substep by substep; returns (state, status: `SOLVED` or why a substep failed).

    Equations start from their solutions in earlier steps, kept in ``carry``; evaluations are added to ``counts``.
    """
    stages = len(method.fraction)
    status = SOLVED
    for s in range(stages):
        if counts.steps % 16 == 0:
            counts.rule = 0
        following, x, status = substep(method, y, s, carry, counts)
        if status != SOLVED:
            break
        remember(carry.memory, s, stages, counts.steps, x)
        y = following
    return y, status


run = loop(step)


#: Path -> d -> the blocks of q1, ..., qd, p1, ..., pd, in the order in which they move.
PATHS = {
    "whole": lambda d: (0,) * 2 * d,
    "momenta, coordinates": lambda d: (1,) * d + (0,) * d,
    "components": lambda d: tuple(range(2 * d)),
}


def coupled(path: str, system: Hamiltonian) -> bool:
    """True if H has a term that depends on variables of two different blocks of the path, which is a name in `PATHS`.

    If not, the path gives the plain averaged vector field (AVF) method.
    """
    place = PATHS[path](system.d)
    if len(set(place)) == 1 or (path == "momenta, coordinates" and system.separable):
        return False
    variables = zip((*system.q, *system.p), place, strict=True)
    return any(a != b and sp.expand(sp.diff(system.H, x, y)) != 0 for (x, a), (y, b) in combinations(variables, 2))


def rules(system: Hamiltonian, width: int, arithmetic: str) -> tuple[tuple, tuple, tuple, tuple]:
    """Make a table of Gauss-Legendre rules of rising size; returns its four columns (n, groups, c, b).

    If H is a polynomial there is one rule, which is exact.  A rule of n nodes is cut into groups of ``width`` nodes,
    which are evaluated side by side; each group is a row of the table, an item of each column.

    - n : the number of nodes of the rule
    - groups : the number of its groups
    - c : the nodes of the group, a tuple (width,); the first is repeated as padding
    - b : their weights, a tuple (width,), 0 for padding
    """
    digits, known = (40, RULES) if arithmetic == DOUBLE else (mpmath.mp.dps, LARGE)
    found = []
    for n in sizes(1, system.polynomial_degree, known):
        c, b = zip(*gauss_legendre(n, digits), strict=True)
        for first in range(0, n, width):
            part = slice(first, first + width)
            rest = width - len(c[part])
            found.append((n, -(-n // width), (*c[part], *[c[first]] * rest), (*b[part], *[0] * rest)))
    return tuple(zip(*found, strict=True))


def serves(system: Hamiltonian, arithmetic: str) -> bool:
    """True if the nodes of a quadrature rule should be evaluated in SIMD lanes, and the system's functions allow it."""
    worth = sizes(1, system.polynomial_degree)[-1] >= FEWEST
    return worth and arithmetic == DOUBLE and codegen.value_kind(system.d) == "tuple" and compiles_in_lanes(system)


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of an averaged vector field method for a system.

    ``method.data`` are the substeps (fraction of h, name of the path in `PATHS`, direction 1, -1 or 0 for both).
    """
    substeps = []
    for fraction, path, direction in method.data:
        if not coupled(path, system):
            path, direction = "whole", 1
        place = PATHS[path](system.d)
        substeps.append((place, 1 + max(place), float(direction), fraction))
    place, blocks, directions, fractions = zip(*substeps, strict=True)
    laned = serves(system, arithmetic)
    source, width = (twin(system, Lanes(WIDTH)), WIDTH) if laned else (system, 1)
    nodes, rows, c, b = rules(system, width, arithmetic)
    kick = max(blocks) == 1 and system.separable and system.quadratic_kinetic
    step = Averaged(
        path=source.field(arithmetic) if max(blocks) > 1 else None,
        field=None if kick else source.field(arithmetic),
        dT=system.grad_T(arithmetic) if kick else None,
        dV=source.grad_V(arithmetic) if kick else None,
        like=(0.0,) * width if laned else None,
        place=array(place, arithmetic),
        blocks=freeze(blocks),
        direction=freeze(directions),
        fraction=numbers(fractions, arithmetic),
        nodes=freeze(nodes),
        rows=freeze(rows),
        c=array(c, arithmetic),
        b=array(b, arithmetic),
    )
    return Prepared(run, step, (1 if kick else 2) * system.d, len(substeps))
