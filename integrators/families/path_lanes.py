r"""The kernel of HBVM and of the continuous Petrov-Galerkin method with quadrature nodes in SIMD lanes.

The equations are those of `collocation`.  The path of a step is y + :math:`\sum_m r_m \int_0^\tau P_m` with the
orthonormal Legendre polynomials :math:`P_m`.  The unknowns are the increments :math:`x_0, \dots, x_{s-1}` (of q and p);
each component has a row of memory, with :math:`x_j` in lane j:

.. math::
    Z_i = y + \sum_m A_{im}\,r_m,\qquad x_j = h\sum_i B_{ji}\,f(Z_i),\qquad y_1 = y + r_0,\qquad
    A_{im} = \int_0^{c_i} P_m,\qquad B_{ji} = b_i\,P_j(c_i) .

In general r = x.  For :math:`H = \sum p_i^2 / 2 m_i + V(q)` only the kicks x of p are unknown, f is :math:`-\nabla V`,
and the path of q follows from that of p:

.. math::
    r_m = h M^{-1}\Bigl(\delta_{m0}\,p + \sum_j X_{mj}\,x_j\Bigr),\qquad p_1 = p + x_0,\qquad
    X_{mj} = \int_0^1 P_m(\tau)\int_0^\tau P_j .

The doubles of X, too, are exactly skew except for the entry 1/2 in the first row and column: so the gain of kinetic
energy is :math:`\sum_m r_m\cdot x_m / h` up to the round-off of the evaluation, whatever the integrals are.

The nodes of a quadrature rule are grouped in rows, a node in each SIMD lane; lanes that are left over repeat a node
with the weight 0.  The choice of the quadrature rule, the solver and the starting values are those of `collocation`.

Source: L. Brugnano, F. Iavernaro, D. Trigiante, J. Numer. Anal. Ind. Appl. Math. 5 (2010) 17-37 (HBVM); M. Antonana, J.
Makazaga, A. Murua, arXiv 2511.03655 (2026) (stages in SIMD lanes).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import mpmath
import numpy as np

from phasebench.integrators.coefficients.tableaus import LEVELS, tableau
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Carry, Prepared, array, freeze
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.solve import Change, confirmer, row_solver
from phasebench.integrators.values.lanes import combine, put, take, total
from phasebench.integrators.values.vector import State, dispatch_on_none, inline, size

from . import gauss_lanes
from .gauss_lanes import functions, pad, pad_square, start_weights
from .lane_rows import DP, DQ, DRIFT, FREE, ORIGIN, begin, components, ender, enter, extrapolate, lengths, shape

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Number

#: Nodes side by side (at least as many as increments); least product of nodes and increments for which that is faster.
WIDTH, FEWEST = 4, 3


class Path(NamedTuple):
    """The data of HBVM or of the continuous Petrov-Galerkin method in SIMD lanes (formulae: see the module).

    Attributes
    ----------
    f : evaluates the field, or -grad V, at all nodes of a row at once; it reads the points from the first rows of the
        array that it is handed, and writes its values to the rows after them
    like, terms : tuples of zeros, one for each lane, and one for each of the s increments x_j
    inverse_mass : 1 / m_i, array (1, d), if only the kicks of p are unknown; None if the increments of q and p are
    drift : the row 1, 0, ..., 0, then the rows of X transposed, by which the path of q follows from the kicks; X is the
        matrix of `skew`
    nodes, rows : for each row of nodes, the numbers of nodes and of rows of the quadrature rule that it belongs to
    A, B : for each row of nodes, s rows of A_im, the integral of P_m from 0 to c_i, with a lane for each node i, and a
        row of B_ji = b_i P_j(c_i) for each node; b, c are weights and nodes, P_m the orthonormal Legendre polynomials
    extrapolation : rows that predict the increments from those of earlier steps: from one step, then from two, ...
    steps : how many earlier steps the prediction uses at most
    h, eps : the step size and the unit round-off, set by the run
    """

    f: Callable
    like: tuple
    terms: tuple
    inverse_mass: np.ndarray | None
    drift: np.ndarray
    nodes: np.ndarray
    rows: np.ndarray
    A: np.ndarray
    B: np.ndarray
    extrapolation: np.ndarray
    steps: int
    h: float = 0.0
    eps: float = 0.0


class Equations(NamedTuple):
    """Arguments of the equations for the increments of a step, which starts at the state (q, p).

    The memory is arranged as in `lane_rows`, with the unknowns in ``stages`` rows: one for each component, a lane for
    each increment.  If the unknowns are kicks, the ``stages`` rows from ``base + FREE`` on have the path of q: the
    coefficients of its velocity in Legendre polynomials, times h.

    Attributes
    ----------
    step : the coefficients of the method
    q, p : the state before the step
    memory, base : the array, and its first row after those of the points and values of the field
    stages : the number of components of an increment
    like : a tuple of zeros, one for each lane
    h : the step size
    counts : the counters of evaluations, and the quadrature rule in use
    """

    step: Path
    q: Any
    p: Any
    memory: np.ndarray
    base: int
    stages: int
    like: tuple
    h: float
    counts: np.record


# -- the two forms ----------------------------------------------------------------------------------------------------


def _path_of_kicks(inverse_mass, e, at):
    step, memory, path = e.step, e.memory, e.base + FREE
    for k in range(e.stages):
        start = memory[e.base + DRIFT, k] * take(step.drift, 0, e.like)
        x = take(memory, at + k, e.like)
        put(memory, path + k, combine(start, x, e.h * inverse_mass[0, k], step.drift, 1, step.terms), e.like)
    return path


def _end_both(inverse_mass, e, at):
    memory, d = e.memory, e.stages // 2
    for k in range(d):
        memory[e.base + DQ, k], memory[e.base + DP, k] = memory[at + k, 0], memory[at + d + k, 0]


def _end_kicks(inverse_mass, e, at):
    path = path_of(inverse_mass, e, at)
    for k in range(e.stages):
        e.memory[e.base + DQ, k], e.memory[e.base + DP, k] = e.memory[path + k, 0], e.memory[at + k, 0]


def _change_of_both(inverse_mass, e, old, new):
    d = e.stages // 2
    (q, size_q), (p, size_p) = moves(e, old, new, 0, d), moves(e, old, new, d, e.stages)
    return Change(q, p, size_q, size_p)


def _change_of_kicks(inverse_mass, e, old, new):
    p, size_p = moves(e, old, new, 0, e.stages)
    return Change(0.0, p, 0.0, size_p)


#: The rows of r, by the increments in the rows ``at``, ...
path_of = dispatch_on_none(lambda inverse_mass, e, at: at, _path_of_kicks)
#: Write the increments of q and p over the step.
sums = dispatch_on_none(_end_both, _end_kicks)
#: The `Change` from the rows ``old``, ... to the rows ``new``, ...
change = dispatch_on_none(_change_of_both, _change_of_kicks)


# -- what they share --------------------------------------------------------------------------------------------------


@inline
def moves(e: Equations, old: int, new: int, first: int, last: int) -> tuple[Number, Number]:
    """How far unknowns move from one iterate to the next: returns (1-norm of the change, 1-norm of the new iterate).

    The iterates are in the rows of ``e.memory`` from ``old`` and from ``new`` on, a row for each component of the
    increments; only the components first, ..., last - 1 count.
    """
    moved, sized = 0.0, 0.0
    for k in range(first, last):
        x = take(e.memory, new + k, e.like)
        moved, sized = moved + total(abs(x - take(e.memory, old + k, e.like))), sized + total(abs(x))
    return moved, sized


@inline
def places(e: Equations, path: int, row: int) -> None:
    """Write the points of the path at which f is evaluated, for one row of nodes, to the first rows of the memory.

    ``path`` is the first row of ``e.memory`` with the path's coefficients r, ``row`` the number of the row of nodes.
    """
    step, memory = e.step, e.memory
    for k in range(e.stages):
        r = take(memory, path + k, e.like)
        put(memory, k, combine(memory[e.base + ORIGIN, k], r, 1.0, step.A, row * len(step.terms), step.terms), e.like)


@inline
def sweep(e: Equations, old: int, new: int) -> tuple[Number, Number]:
    """Apply the right-hand side of x = h B f to the increments x in rows ``old``; write the result to rows ``new``.

    ``old`` and ``new`` are the first of these rows in ``e.memory``.  Returns (the distance between the two, the size of
    the result).
    """
    step, memory, n = e.step, e.memory, len(e.like)
    path = path_of(step.inverse_mass, e, old)
    for k in range(e.stages):
        put(memory, new + k, 0.0, e.like)
    first, last = rule(e)
    for row in range(first, last):
        places(e, path, row)
        step.f(memory)
        for k in range(e.stages):
            f = take(memory, e.stages + k, e.like)
            put(memory, new + k, combine(take(memory, new + k, e.like), f, 1.0, step.B, row * n, e.like), e.like)
    moved = sized = 0.0 * take(step.B, 0, e.like)
    for k in range(e.stages):
        x = e.h * take(memory, new + k, e.like)
        moved = moved + abs(x - take(memory, old + k, e.like))
        sized = sized + abs(x)
        put(memory, new + k, x, e.like)
    return total(moved), total(sized)


@inline
def rule(e: Equations) -> tuple[int, int]:
    """The rows of nodes of the quadrature rule in use: returns (the first, the one after the last)."""
    return e.counts.rule, e.counts.rule + e.step.rows[e.counts.rule]


solve_once = row_solver(sweep, lengths, inline(lambda e: shape(e, len(e.step.terms))))
solve = confirmer(solve_once, sweep, inline(lambda e, old, new: change(e.step.inverse_mass, e, old, new)))
end = ender(sums)


def step(method: Path, y: State, carry: Carry, counts: np.record) -> tuple[State, int]:
    """Take one step from the state y; returns (state, status: `SOLVED` or why the equations could not be solved).

    They start from solutions of earlier steps, kept in ``carry``; evaluations are added to ``counts``.
    """
    rows = components(method.inverse_mass, len(carry.zero))
    if counts.steps % 16 == 0:
        counts.rule = 0
    e = Equations(method, y.q, y.p, carry.memory, 2 * rows, rows, method.like, method.h, counts)
    ring = e.base + FREE + rows  # after the path of q
    at = ring + method.steps * rows
    begin(method.inverse_mass, e, y)
    extrapolate(e, ring, counts.steps, at)
    span = size(y.q) + size(y.p)
    _, status = solve(e, at, span, abs(method.h) * span, carry.work, counts)
    if status != SOLVED:
        return y, status
    enter(e, ring, counts.steps, at)
    return end(e, at, y, carry.zero), status


run = loop(step)


# -- what it is handed ------------------------------------------------------------------------------------------------


def build_path(s: int, rules: Sequence[int], system: Hamiltonian, arithmetic: str) -> Path:
    """Make the data `Path` of a method whose path is a polynomial of degree s.

    ``rules`` are the numbers of nodes of its quadrature rules.  The coefficients are padded to groups of `WIDTH` nodes,
    which the system's functions evaluate side by side.
    """
    digits = 40 if arithmetic == DOUBLE else mpmath.mp.dps + 10
    unit = mpmath.mpf(2) ** (-52 if arithmetic == DOUBLE else 1 - mpmath.mp.prec)
    tableaus = [tableau("hbvm", s, k, False, digits, unit) for k in rules]
    nodes, rows, A, B = [], [], [], []
    for t, k in zip(tableaus, rules, strict=True):
        for first in range(0, k, WIDTH):
            part = slice(first, first + WIDTH)
            nodes.append(k)
            rows.append(-(-k // WIDTH))
            A += (pad(column, WIDTH, column[0]) for column in zip(*t.A_q[part], strict=True))
            B += pad_square(t.B[part], WIDTH)
    f, inverse_mass = functions(system, WIDTH, arithmetic, digits)
    return Path(
        f,
        like=(0.0,) * WIDTH,
        terms=(0.0,) * s,
        inverse_mass=inverse_mass,
        drift=array([pad([1], WIDTH, 0), *pad_square(zip(*skew(s, digits), strict=True), WIDTH)], arithmetic),
        nodes=freeze(nodes),
        rows=freeze(rows),
        A=array(A, arithmetic),
        B=array(B, arithmetic),
        extrapolation=array(start_weights(tableaus[0].extrapolation, s, WIDTH), arithmetic),
        steps=len(tableaus[0].extrapolation) // s,
    )


def skew(s: int, digits: int) -> list[list]:
    """The matrix X of integrals over [0, 1] of P_m times the integral of P_j, with orthonormal Legendre polynomials P.

    Returns the s rows as lists of mpmath numbers; X is 1/2 in its first entry, and skew in the others.
    """
    X = [[mpmath.mpf(0)] * s for _ in range(s)]
    X[0][0] = mpmath.mpf(1) / 2
    with mpmath.workdps(digits):
        for j in range(1, s):
            X[j][j - 1] = 1 / (2 * mpmath.sqrt(4 * j * j - 1))
            X[j - 1][j] = -X[j][j - 1]
    return X


def serves(s: int, rules: Sequence[int], system: Hamiltonian) -> bool:
    """True if quadrature nodes should be evaluated in SIMD lanes, and the system's functions allow it.

    s is the number of increments, ``rules`` are the numbers of nodes of the quadrature rules.
    """
    return s <= WIDTH and s * rules[-1] >= FEWEST and gauss_lanes.serves(WIDTH, system)


def prepare(s: int, rules: Sequence[int], system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a method whose path is a polynomial of degree s, in SIMD lanes.

    ``rules`` are the numbers of nodes of its quadrature rules.
    """
    step = build_path(s, rules, system, arithmetic)
    unknowns = components(step.inverse_mass, system.d)
    rows = FREE + (7 + step.steps) * unknowns
    return Prepared(run, step, max(WIDTH, unknowns), -(-rows // (3 * LEVELS + 1)), linear=WIDTH * unknowns)
