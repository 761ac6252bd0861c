r"""The solver of the stage equations :math:`x = G(x)`: to round-off, by fixed point, by Newton where that fails.

Fixed point: iterate until the increment can fall no further.  With :math:`\delta_k = \|x_{k+1} - x_k\|` and
:math:`\theta = \delta_k / \delta_{k-1}` the remaining error is about :math:`\delta_k\theta/(1 - \theta)`; it is brought
far below the round-off of x, or until it no longer falls.  Where the iteration does not contract, Newton's method takes
over on :math:`x - G(x)`, with a difference Jacobian (its error only slows the convergence: the residual is exact): from
the start, and where that fails from zero.

Unknowns that fit into registers are values (`solver`; in lanes, `lane_solver`), those of many stages the rows of a
memory (`row_solver`).  Their starts are extrapolated from earlier steps (`predict`, `remember`).

Integrals whose rule depends on the state are confirmed by the next finer rule (`unchanged`).

Reference: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), VIII.5-6.
"""

from __future__ import annotations

from math import comb
from typing import NamedTuple

import numpy as np

from phasebench.integrators.coefficients.tableaus import LEVELS
from phasebench.integrators.values.masks import also_in_lanes
from phasebench.integrators.values.vector import (
    axpy,
    bump,
    distance,
    head,
    inlined,
    jit,
    load,
    minus,
    plus,
    scale,
    size,
    store,
    tail,
)

from .lane_solver import lane_solver

SOLVED, STALLED, NOT_FINITE, OUT_OF_STEP = 0, 1, 2, 3

#: Row m: weights that extrapolate the last m solutions by one step, the newest first.
_EXTRAPOLATION = np.array(
    [[(-1) ** j * comb(m, j + 1) if j < m else 0 for j in range(LEVELS)] for m in range(LEVELS + 1)], dtype=float
)
FIXED_POINT_LIMIT = 40
#: The iteration stops when its error is this share of round-off: a larger one has a bias and accumulates linearly in
#: time.
SHARE = 1e-3
NEWTON_LIMIT = 25


@inlined
def predict(memory, first, stages, known, like):
    """Extrapolate the start of an equation from its last solutions, polynomially in the step number.

    At most LEVELS of the ``known`` solutions are used; the start is zero without any. They are the rows first,
    first + stages, ... of ``memory``, a ring. The newest is added last, so that only one product waits for it.
    """
    m = min(known, LEVELS)
    x = scale(0.0, like)
    for back in range(LEVELS, 0, -1):
        row = first + (known - back) % LEVELS * stages
        x = axpy(_EXTRAPOLATION[m, back - 1], load(memory, row, like), x)
    return x


@inlined
def predict_number(memory, first, stages, known):
    """Extrapolate a number as `predict` does, from a ring in the first column of ``memory``."""
    m = min(known, LEVELS)
    x = 0.0
    for back in range(LEVELS, 0, -1):
        x = x + _EXTRAPOLATION[m, back - 1] * memory[first + (known - back) % LEVELS * stages, 0]
    return x


@inlined
def remember(memory, first, stages, known, x):
    """Store x, the solution of step number ``known``, in the ring that `predict` reads."""
    store(memory, first + known % LEVELS * stages, x)


@inlined
def copy(memory, old, new, stages, like):
    """Copy ``stages`` unknowns from the rows ``old``, ... of ``memory`` to the rows ``new``, ..."""
    for j in range(stages):
        store(memory, new + j, load(memory, old + j, like))


# -- when to stop -----------------------------------------------------------------------------------------------------


@inlined
def converged(delta, last, length, span, eps):
    """True if a fixed-point iteration is at round-off, judged by its last two changes ``delta`` and ``last``.

    ``length`` is the size of the unknowns, ``span`` that of the variables in which their equation varies.
    """
    if delta == 0:
        return True
    if delta < last:
        return last < np.inf and delta * delta <= SHARE * (eps * length) * (last - delta)
    return delta <= 64 * (eps * length + eps * span)


@inlined
def lengths_of_both(x, g, e):
    """Sizes of the coordinates and of the momenta at increments x, for the lengths of finite differences.

    They are kept apart: if momenta are far smaller than coordinates, a difference of the coordinates' length would
    leave the momenta's range, and one of the momenta's length would be lost in the coordinates' round-off.
    """
    return size(e.q) + size(head(x)) + size(head(g)), size(e.p) + size(tail(x)) + size(tail(g))


@inlined
def difference(length, span, eps):
    """Length of a finite difference in a variable of size ``length``, or of size ``span`` if that is zero."""
    return eps**0.5 * (length if length > 0 else span)


@inlined
def newton_converged(delta, last, unit, noise):
    """True if Newton's method has reached round-off, or is near it and no longer converging."""
    return delta <= unit or (delta >= 0.5 * last and delta <= 1e3 * (unit + noise))


class Change(NamedTuple):
    """Distance of the unknowns of two quadrature rules, and their size, for q and for p.

    They are kept apart: if momenta are far smaller than coordinates, a joint norm hides their error.
    """

    q: float
    p: float
    size_q: float
    size_p: float


@inlined
def change(old, new):
    """The `Change` between two increments, each of q and p."""
    return Change(distance(head(old), head(new)), distance(tail(old), tail(new)), size(head(new)), size(tail(new)))


@inlined
def unchanged(move, last, noise, eps):
    """(True if a finer quadrature changed nothing, True if it changed round-off at most).

    ``last`` is the change before, ``noise`` the size of the terms that an increment sums up.
    """
    sure_q, sure_p = move.q <= 16 * eps * move.size_q, move.p <= 16 * eps * move.size_p
    ended_q = sure_q or (move.q > 0.5 * last.q and move.q <= 64 * eps * (move.size_q + noise))
    ended_p = sure_p or (move.p > 0.5 * last.p and move.p <= 64 * eps * (move.size_p + noise))
    return sure_q and sure_p, ended_q and ended_p


# -- linear equations -------------------------------------------------------------------------------------------------


@jit
def gauss(A, n):
    """Solve n equations in place by elimination with pivots; column n of A is the right side. False if singular."""
    for j in range(n):
        pivot = j
        for i in range(j + 1, n):
            if abs(A[i, j]) > abs(A[pivot, j]):
                pivot = i
        if not abs(A[pivot, j]) > 0:
            return False
        for k in range(n + 1):
            A[j, k], A[pivot, k] = A[pivot, k], A[j, k]
        for i in range(n):
            if i != j:
                factor = A[i, j] / A[j, j]
                for k in range(j, n + 1):
                    A[i, k] = A[i, k] - factor * A[j, k]
    for j in range(n):
        A[j, n] = A[j, n] / A[j, j]
    return True


# -- unknowns that are values -----------------------------------------------------------------------------------------


def solver(G, lengths=lengths_of_both):
    """Make the solver of x = G(x, arguments): fixed point to round-off, Newton's method if it does not contract.

    It is a function (arguments, start, span, eps, work) -> (x, evaluations of G, 1 if Newton's method was used else 0,
    status). ``lengths(x, G(x), arguments)`` gives the sizes of the variables that the two halves of x belong to;
    ``span`` is the size of the variables in which G varies, ``work`` room for a matrix.
    """

    @jit
    def newton(arguments, x, span, eps, work):
        """Solve x = G(x) by Newton's method with a finite-difference Jacobian; (x, evaluations of G, status).

        ``work`` is an array of at least (n + 1, n + 1) numbers, ``span`` the size of the variables in which G varies.
        """
        n = len(x)
        last = np.inf
        evaluations = 0
        for _ in range(NEWTON_LIMIT):
            g = G(x, arguments)
            first, second = lengths(x, g, arguments)
            for i in range(n):
                step = difference(first if 2 * i < n else second, span, eps)
                column = minus(G(bump(x, i, step), arguments), g)
                store(work, n, column)
                for j in range(n):
                    work[j, i] = (1.0 if i == j else 0.0) - work[n, j] / step
            evaluations += n + 1
            store(work, n, minus(g, x))
            for j in range(n):
                work[j, n] = work[n, j]
            if not size(x) < np.inf:
                return x, evaluations, NOT_FINITE
            if not gauss(work, n):
                return x, evaluations, STALLED
            for j in range(n):
                work[n, j] = work[j, n]
            new = plus(x, load(work, n, x))
            delta = distance(new, x)
            x = new
            if not delta < np.inf:
                return x, evaluations, NOT_FINITE
            if newton_converged(delta, last, eps * size(x), eps * span):
                return x, evaluations, SOLVED
            last = delta
        return x, evaluations, STALLED

    def solve(arguments, x, span, eps, work):
        """Solve x = G(x, arguments) from the start x; results as of `solver`."""
        start = x
        last = np.inf
        growth = 0
        k = 0
        while growth < 2:
            new = G(x, arguments)
            delta = distance(new, x)
            x = new
            k += 1
            if not delta < np.inf:
                break
            # `converged`, written out: called it makes a step of Scheme I 6 % slower
            unit = eps * size(x)
            if delta == 0:
                return x, k, 0, SOLVED
            if delta < last:
                if last < np.inf and delta * delta <= SHARE * unit * (last - delta):
                    return x, k, 0, SOLVED
            elif delta <= 64 * (unit + eps * span):
                return x, k, 0, SOLVED
            else:
                growth += 1
            if k >= FIXED_POINT_LIMIT and delta > 0.5 * last:
                break
            last = delta
        new, evaluations, status = newton(arguments, start, span, eps, work)
        if status != SOLVED:
            new, more, status = newton(arguments, minus(start, start), span, eps, work)
            evaluations += more
        return new, k + evaluations, 1, status

    return also_in_lanes(solve, lane_solver(G, SHARE, FIXED_POINT_LIMIT, SOLVED, NOT_FINITE))


# -- unknowns that are rows of a memory -------------------------------------------------------------------------------


def row_solver(sweep, linearize):
    """Make the solver of x = G(x) for unknowns in rows of a memory: fixed point, then Newton's method.

    It is a function (equations, at, span, eps, work) -> (sweeps, sweeps that Newton's method took, status). The
    unknowns are the rows at, ..., at + stages - 1, which hold the start and then the solution; the 3 ``stages`` rows
    after them are overwritten. ``equations`` is a NamedTuple with the fields memory, stages, and like, a zero of the
    kind of a row.

    - ``sweep(equations, old, new)`` writes G of the rows ``old`` to the rows ``new``; returns (their distance, the size
      of
      the new).
    - ``linearize(equations, at, span, work)`` writes the matrix of 1 - G' into ``work``, by differences of length
      `difference`, and G itself to the rows at + stages; may use the ``stages`` rows after those. Returns the number of
      sweeps that cost as much.
    """

    @jit
    def newton(equations, at, span, eps, work):
        """Apply Newton's method to the rows ``at``, ...; returns (sweeps, status)."""
        memory, stages, like = equations.memory, equations.stages, equations.like
        n = len(like)
        order = stages * n
        last = np.inf
        sweeps = 0
        for _ in range(NEWTON_LIMIT):
            sweeps += linearize(equations, at, span, work)
            for r in range(order):
                j, i = r // n, r % n
                work[r, order] = memory[at + stages + j, i] - memory[at + j, i]
                if not abs(work[r, order]) < np.inf:
                    return sweeps, NOT_FINITE
            if not gauss(work, order):
                return sweeps, STALLED
            delta, length = 0.0, 0.0
            for r in range(order):
                j, i = r // n, r % n
                memory[at + j, i] += work[r, order]
                delta += abs(work[r, order])
                length += abs(memory[at + j, i])
            if not delta < np.inf:
                return sweeps, NOT_FINITE
            if newton_converged(delta, last, eps * length, eps * span):
                return sweeps, SOLVED
            last = delta
        return sweeps, STALLED

    @inlined
    def solve(equations, at, span, eps, work):
        """Solve from the start in the rows ``at``, ...; returns (sweeps, sweeps of Newton's method, status)."""
        memory, stages, like = equations.memory, equations.stages, equations.like
        start = at + 3 * stages
        copy(memory, at, start, stages, like)
        old, new = at, at + stages
        last = np.inf
        growth = 0
        k = 0
        while growth < 2:
            delta, length = sweep(equations, old, new)
            old, new = new, old
            k += 1
            if not delta < np.inf:
                break
            if converged(delta, last, length, span, eps):
                if old != at:
                    copy(memory, old, at, stages, like)
                return k, 0, SOLVED
            if delta >= last:
                growth += 1
            if k >= FIXED_POINT_LIMIT and delta > 0.5 * last:
                break
            last = delta
        copy(memory, start, at, stages, like)
        sweeps, status = newton(equations, at, span, eps, work)
        if status != SOLVED:
            for j in range(stages):
                store(memory, at + j, like)
            more, status = newton(equations, at, span, eps, work)
            sweeps += more
        return k, sweeps, status

    return solve


def by_rows(change):
    """Make the ``changes`` of `confirmer` from ``change(equations, x, y)``, the `Change` from a row x to a row y."""

    @inlined
    def changes(e, old, new):
        total = Change(0.0, 0.0, 0.0, 0.0)
        for j in range(e.stages):
            c = change(e, load(e.memory, old + j, e.like), load(e.memory, new + j, e.like))
            total = Change(total.q + c.q, total.p + c.p, total.size_q + c.size_q, total.size_p + c.size_p)
        return total

    return changes


def confirmer(solve, sweep, changes):
    """Make the solver of equations with integrals: quadrature rules of rising size, until the next one changes nothing.

    It is a function (equations, at, work, counts) -> status, with ``solve``, ``sweep`` and ``equations`` as in
    `row_solver`. The equations also have the fields q, p and step, and the step the fields h, eps, ``nodes`` and
    ``rows``: for each row of coefficients, the number of nodes and of rows of its rule. ``counts.rule`` is the first
    row of the rule in use. ``changes(equations, old, new)`` is the `Change` from the unknowns in the rows ``old`` to
    those in the rows ``new``.

    The confirming sweep is an iterate of the finer rule, so that it is not wasted. A step that the largest rule leaves
    unconfirmed is a fallback.
    """

    @inlined
    def confirmed(e, at, work, counts):
        """Solve from the start in the rows ``at``, ..., by the rule ``counts.rule`` and finer ones."""
        eps, nodes, rows = e.step.eps, e.step.nodes, e.step.rows
        span = size(e.q) + size(e.p)
        move = Change(np.inf, np.inf, np.inf, np.inf)
        before = counts.rule
        while True:
            rule = counts.rule
            following = rule + rows[rule]
            sweeps, newton, status = solve(e, at, span, eps, work)
            counts.gradient += (sweeps + newton) * nodes[rule]
            counts.newton += min(newton, 1)
            if status != SOLVED or rows[0] == len(rows):
                return status
            if following == len(rows):
                counts.fallbacks += 1
                return status
            counts.rule = following
            sweep(e, at, at + e.stages)
            counts.gradient += nodes[following]
            last, move = move, changes(e, at, at + e.stages)
            copy(e.memory, at + e.stages, at, e.stages, e.like)
            sure, ended = unchanged(move, last, abs(e.step.h) * span, eps)
            if sure or ended:  # the next step need not begin with the rule that only showed the end
                counts.rule = rule if sure else before
                return status
            before = rule

    return confirmed
