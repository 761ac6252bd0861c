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

from .lane_solver import lane_solver
from .masks import also_in_lanes
from .vector import axpy, bump, distance, head, inlined, jit, load, minus, plus, scale, size, store, tail

SOLVED, STALLED, NOT_FINITE, OUT_OF_STEP = 0, 1, 2, 3

#: Row m: the weights of the last m solutions, newest first.
_EXTRAPOLATION = np.array(
    [[(-1) ** j * comb(m, j + 1) if j < m else 0 for j in range(LEVELS)] for m in range(LEVELS + 1)], dtype=float
)
FIXED_POINT_LIMIT = 40
#: The iteration's own error is brought to this share of round-off: it is biased, so it accumulates linearly in time.
SHARE = 1e-3
NEWTON_LIMIT = 25


@inlined
def predict(memory, first, stages, known, like):
    """The start of an equation, extrapolated from its last solutions (at most LEVELS of ``known``; 0: zero).

    They are the rows first, first + stages, ... of ``memory``, a ring.  The newest is added last, so that a step's
    chain of operations waits for one product only.
    """
    m = min(known, LEVELS)
    x = scale(0.0, like)
    for back in range(LEVELS, 0, -1):
        row = first + (known - back) % LEVELS * stages
        x = axpy(_EXTRAPOLATION[m, back - 1], load(memory, row, like), x)
    return x


@inlined
def predict_number(memory, first, stages, known):
    """As `predict`, for a ring of numbers in the first column of ``memory``."""
    m = min(known, LEVELS)
    x = 0.0
    for back in range(LEVELS, 0, -1):
        x = x + _EXTRAPOLATION[m, back - 1] * memory[first + (known - back) % LEVELS * stages, 0]
    return x


@inlined
def remember(memory, first, stages, known, x):
    """Enter the solution x of the step after ``known`` others into its ring."""
    store(memory, first + known % LEVELS * stages, x)


@inlined
def copy(memory, old, new, stages, like):
    """Copy unknowns from the rows ``old`` to the rows ``new``."""
    for j in range(stages):
        store(memory, new + j, load(memory, old + j, like))


# -- when to stop -----------------------------------------------------------------------------------------------------


@inlined
def converged(delta, last, length, span, eps):
    """Whether a fixed point is reached, by the last two changes.

    ``length`` is the size of the unknowns, ``span`` that of the variables in which their equation varies.
    """
    if delta == 0:
        return True
    if delta < last:
        return last < np.inf and delta * delta <= SHARE * (eps * length) * (last - delta)
    return delta <= 64 * (eps * length + eps * span)


@inlined
def lengths_of_both(x, g, e):
    """How large the coordinates and the momenta are that the increments x, on the way to g, lead to.

    Differences are taken of these lengths, told apart: where momenta are far smaller than coordinates, a difference of
    the coordinates' length would leave their range, and one of the momenta's would be lost in the coordinates.
    """
    return size(e.q) + size(head(x)) + size(head(g)), size(e.p) + size(tail(x)) + size(tail(g))


@inlined
def difference(length, span, eps):
    """The length of a difference in a variable of the size ``length``, or of ``span`` where that is zero."""
    return eps**0.5 * (length if length > 0 else span)


@inlined
def newton_converged(delta, last, unit, noise):
    """Whether Newton's method is at its end, by the last two moves: at round-off, or near it and no longer falling."""
    return delta <= unit or (delta >= 0.5 * last and delta <= 1e3 * (unit + noise))


class Change(NamedTuple):
    """How far unknowns moved from one quadrature rule to the next and how large they are: of q, and of p.

    They are told apart: where momenta are far smaller than coordinates, a joint norm hides their error.
    """

    q: float
    p: float
    size_q: float
    size_p: float


@inlined
def change(old, new):
    """The `Change` from one increment (of q and p) to another."""
    return Change(distance(head(old), head(new)), distance(tail(old), tail(new)), size(head(new)), size(tail(new)))


@inlined
def unchanged(move, last, noise, eps):
    """Whether a finer quadrature changed nothing, and whether it changed nothing or round-off.

    ``last`` is the change before, ``noise`` the size of what an increment is the rounded sum of.
    """
    sure_q, sure_p = move.q <= 16 * eps * move.size_q, move.p <= 16 * eps * move.size_p
    ended_q = sure_q or (move.q > 0.5 * last.q and move.q <= 64 * eps * (move.size_q + noise))
    ended_p = sure_p or (move.p > 0.5 * last.p and move.p <= 64 * eps * (move.size_p + noise))
    return sure_q and sure_p, ended_q and ended_p


# -- linear equations -------------------------------------------------------------------------------------------------


@jit
def gauss(A, n):
    """Solve in place the n equations in the rows of A, right-hand side in column n; False where singular."""
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
    """The solver of x = G(x, arguments).

    It is a function (arguments, start, span, eps, work) -> (x, evaluations, Newton used: 0 or 1, status); ``lengths``
    (x, G(x), arguments) are the sizes of the variables that the first and the second half of x move.
    """

    @jit
    def newton(arguments, x, span, eps, work):
        """Newton's method on x - G(x) with a difference Jacobian; returns (x, evaluations of G, status).

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

    @inlined
    def solve(arguments, x, span, eps, work):
        """Solve x = G(x, arguments) from the start x; returns (x, evaluations of G, Newton used: 0 or 1, status)."""
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
    """The solver of x = G(x) for x in the rows at, ..., at + stages - 1 of a memory.

    It is a function (equations, at, span, eps, work) -> (sweeps, sweeps that Newton's method took, status), which
    leaves the solution where the start was and writes over the 3 ``stages`` rows that follow.  ``equations`` is a
    NamedTuple with the fields memory, stages, and like, a zero of the kind of a row; sweep(equations, old, new) writes
    G of the rows ``old`` to the rows ``new`` and returns (their distance, the size of the new); linearize(equations,
    at, span, work) writes the matrix of 1 - G' into ``work``, by differences of the variables' own lengths
    (`difference`), G itself to the rows at + stages, may use the ``stages`` rows after those, and returns the sweeps
    that this is worth.
    """

    @jit
    def newton(equations, at, span, eps, work):
        """Newton's method from the rows ``at``; returns (sweeps, status)."""
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
        """Solve from the start in the rows ``at``."""
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
    """The changes(equations, old, new) of `confirmer`, of the `Change` change(equations, x, y) from a row x to y."""

    @inlined
    def changes(e, old, new):
        total = Change(0.0, 0.0, 0.0, 0.0)
        for j in range(e.stages):
            c = change(e, load(e.memory, old + j, e.like), load(e.memory, new + j, e.like))
            total = Change(total.q + c.q, total.p + c.p, total.size_q + c.size_q, total.size_p + c.size_p)
        return total

    return changes


def confirmer(solve, sweep, changes):
    """The solver of equations with integrals, by rules of rising size until the next one confirms the unknowns.

    It is a function (equations, at, work, counts) -> status, with ``solve``, ``sweep`` and ``equations`` as in
    `row_solver`; besides, these have the fields q, p and step, and the step the fields h, eps, ``nodes`` and ``rows``:
    for each row of coefficients of each rule the number of the rule's nodes, and of its rows.  The rule in use begins
    with the row ``counts.rule``; changes(equations, old, new) is the `Change` from the unknowns in the rows ``old`` to
    those in the rows ``new``.  The confirming sweep is itself an iterate of the finer rule, so nothing of it is lost.
    A step that the largest rule leaves unconfirmed is a fallback.
    """

    @inlined
    def confirmed(e, at, work, counts):
        """Solve from the start in the rows ``at``, by the rule ``counts.rule`` and finer ones."""
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
