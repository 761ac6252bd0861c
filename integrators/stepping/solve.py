r"""Solve stage equations :math:`x = G(x)` to round-off, by fixed point, or by Newton's method where that fails.

Fixed point: iterate until the increment can fall no further.  With :math:`\delta_k = \|x_{k+1} - x_k\|` and
:math:`\theta = \delta_k / \delta_{k-1}` the remaining error is about :math:`\delta_k\theta/(1 - \theta)`; it is brought
far below the round-off of x, or until it no longer falls.  Where the iteration does not contract, Newton's method takes
over on :math:`x - G(x)`, with a difference Jacobian (its error only slows the convergence: the residual is exact): from
the start, and where that fails from zero.

Both iterations are written once (`fixed_point`, `newton_method`).  Unknowns that fit into registers are values
(`solver`), also in lanes; those of many stages are the rows of a memory (`row_solver`), those of a lattice an array
whose matrix is a band (`banded`).  Their starts are extrapolated from earlier steps (`predict`, `remember`).

Integrals whose rule depends on the state are confirmed by the next finer rule (`unchanged`).

Reference: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), VIII.5-6.
"""

from __future__ import annotations

from collections.abc import Callable
from math import comb
from typing import Any, NamedTuple

import numpy as np

from phasebench.integrators.coefficients.tableaus import LEVELS
from phasebench.integrators.values.masks import broadcast_like, fails, number, overload_in_lanes, retire_lanes, where
from phasebench.integrators.values.vector import (
    axpy,
    bump,
    distance,
    head,
    inline,
    jit,
    load,
    minus,
    plus,
    scale,
    size,
    store,
    tail,
)

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


@inline
def predict(memory: np.ndarray, first: int, stages: int, known: int, like: Any) -> Any:
    """Extrapolate an equation's starting value from its solutions in the last steps, by a polynomial.

    At most LEVELS of the ``known`` solutions are used; the start is zero without any. They are the rows first,
    first + stages, ... of ``memory``, a ring. The newest is added last, so that only one product waits for it.
    """
    m = min(known, LEVELS)
    x = scale(0.0, like)
    for back in range(LEVELS, 0, -1):
        row = first + (known - back) % LEVELS * stages
        x = axpy(_EXTRAPOLATION[m, back - 1], load(memory, row, like), x)
    return x


@inline
def predict_number(memory: np.ndarray, first: int, stages: int, known: int) -> float:
    """Extrapolate a number from its values in the last steps, as `predict` does vectors.

    They stand in the first column of ``memory``, in every ``stages``-th of its rows from ``first`` on, as a ring
    buffer; ``known`` steps were made so far.
    """
    m = min(known, LEVELS)
    x = 0.0
    for back in range(LEVELS, 0, -1):
        x = x + _EXTRAPOLATION[m, back - 1] * memory[first + (known - back) % LEVELS * stages, 0]
    return x


@inline
def remember(memory: np.ndarray, first: int, stages: int, known: int, x: Any) -> None:
    """Store x, the solution of step number ``known``, in the ring that `predict` reads."""
    store(memory, first + known % LEVELS * stages, x)


@inline
def copy(memory: np.ndarray, old: int, new: int, stages: int, like: Any) -> None:
    """Copy ``stages`` unknowns from the rows ``old``, ... of ``memory`` to the rows ``new``, ..."""
    for j in range(stages):
        store(memory, new + j, load(memory, old + j, like))


# -- when to stop -----------------------------------------------------------------------------------------------------


@inline
def near(delta, last, unit):
    """True if the error left after the changes ``last``, then ``delta`` is far below ``unit``, the round-off of x."""
    return (last < np.inf) & (delta * delta <= SHARE * unit * (last - delta))


@inline
def converged(delta: Any, last: Any, length: Any, span: Any, eps: float) -> Any:
    """True if a fixed-point iteration is at round-off, judged by its last two changes ``delta`` and ``last``.

    ``length`` is the size of the unknowns, ``span`` that of the variables in which their equation varies.
    """
    unit = eps * length
    return (
        (delta == 0)
        | near(delta, last, unit)
        | ((delta >= last) & (delta <= 64 * (unit + eps * span)) & (delta < np.inf))
    )


@inline
def lengths_of_both(x: Any, g: Any, e: NamedTuple) -> tuple[float, float]:
    """Sizes of the coordinates and of the momenta at increments x, for the lengths of finite differences.

    They are kept apart: if momenta are far smaller than coordinates, a difference of the coordinates' length would
    leave the momenta's range, and one of the momenta's length would be lost in the coordinates' round-off.
    """
    return size(e.q) + size(head(x)) + size(head(g)), size(e.p) + size(tail(x)) + size(tail(g))


@inline
def difference(length: float, span: float, eps: float) -> float:
    """Length of a finite difference in a variable of size ``length``, or of size ``span`` if that is zero."""
    return eps**0.5 * (length if length > 0 else span)


@inline
def newton_converged(delta: float, last: float, unit: float, noise: float) -> bool:
    """True if Newton's method has reached round-off, or is near it and no longer converging."""
    return delta <= unit or (delta >= 0.5 * last and delta <= 1e3 * (unit + noise))


class Change(NamedTuple):
    """How far the unknowns move from one quadrature rule to the next, and how large they are, for q and for p.

    q and p are kept apart: if momenta are far smaller than coordinates, a joint norm hides their error.
    """

    q: float
    p: float
    size_q: float
    size_p: float


@inline
def change(old: Any, new: Any) -> Change:
    """The `Change` (distances and sizes) from the increments ``old`` to ``new``, each of q and p."""
    return Change(distance(head(old), head(new)), distance(tail(old), tail(new)), size(head(new)), size(tail(new)))


@inline
def unchanged(move: Change, last: Change, noise: float, eps: float) -> tuple[bool, bool]:
    """(True if a finer quadrature rule changed nothing, True if it changed no more than round-off).

    ``last`` is the change before, ``noise`` the size of the terms that an increment sums up.
    """
    sure_q, sure_p = move.q <= 16 * eps * move.size_q, move.p <= 16 * eps * move.size_p
    ended_q = sure_q or (move.q > 0.5 * last.q and move.q <= 64 * eps * (move.size_q + noise))
    ended_p = sure_p or (move.p > 0.5 * last.p and move.p <= 64 * eps * (move.size_p + noise))
    return sure_q and sure_p, ended_q and ended_p


# -- linear equations -------------------------------------------------------------------------------------------------


@jit
def gauss(A: np.ndarray, n: int) -> bool:
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


# -- the two iterations -----------------------------------------------------------------------------------------------


def _started(x, span):
    return True, np.inf, 0.0


def _started_in_lanes(x, span):
    return (size(x) < np.inf) & (span < np.inf), broadcast_like(np.inf, span), broadcast_like(0.0, span)


#: (where to iterate, the change before the first, how often it grew); not where x or ``span`` is not finite in lanes.
started = overload_in_lanes(_started, _started_in_lanes)


def _replace(active, x, new):
    return new


def _replace_in_lanes(active, x, new):
    return where(active, new, x)


#: The new x in lanes that are active, and the old one in the others; of a number the new one, since its loop goes on.
replace = overload_in_lanes(_replace, _replace_in_lanes)


def fixed_point(sweep: Callable) -> Callable:
    """Make the iteration x -> G(x) to round-off, for numbers and for lanes of them.

    It is a function (equations, x, span, eps) -> (x, sweeps, True if solved). ``sweep(equations, x, active)`` returns
    (G(x) where ``active`` holds, its distance from x, its size). Each lane stops where it would stop alone, and keeps
    its value while the others go on; one that is not solved becomes NaN. Sweeps of lanes are added up.
    """

    @inline
    def iterate(e, x, span, eps):
        active, last, growth = started(x, span)
        good = True
        sweeps, k = 0, 0
        while active:
            sweeps += number(active)
            x, delta, length = sweep(e, x, active)
            k += 1
            active = active & fails(converged(delta, last, length, span, eps))
            if active:
                growth = where(delta < last, growth, growth + 1.0)
                kept = (delta < np.inf) & (growth < 2)
                if k >= FIXED_POINT_LIMIT:
                    kept = kept & (delta <= 0.5 * last)
                x, good = retire_lanes(active, kept, x)
                active = active & kept
                last = delta
        return x, sweeps, good

    return iterate


def newton_method(improve: Callable) -> Callable:
    """Make Newton's method: a function (equations, x, span, eps, work) -> (x, sweeps, status).

    ``improve(equations, x, span, eps, work)`` makes the linear equations at x and solves them; it returns (new x, its
    distance from x, its size, sweeps that it took, status).  span, eps and the memory ``work`` are passed on to it.
    """

    @jit
    def newton(equations, x, span, eps, work):
        last = np.inf
        sweeps = 0
        for _ in range(NEWTON_LIMIT):
            x, delta, length, more, status = improve(equations, x, span, eps, work)
            sweeps += more
            if status != SOLVED:
                return x, sweeps, status
            if not delta < np.inf:
                return x, sweeps, NOT_FINITE
            if newton_converged(delta, last, eps * length, eps * span):
                return x, sweeps, SOLVED
            last = delta
        return x, sweeps, STALLED

    return newton


# -- unknowns that are values -----------------------------------------------------------------------------------------


def solver(G: Callable, lengths: Callable = lengths_of_both) -> Callable:
    """Make the solver of x = G(x, arguments): fixed point to round-off, Newton's method if it does not contract.

    It is a function (arguments, start, span, eps, work) -> (x, evaluations of G, 1 if Newton's method was used else 0,
    status). ``lengths(x, G(x), arguments)`` gives the sizes of the variables that the two halves of x belong to;
    ``span`` is the size of the variables in which G varies, ``work`` room for a matrix, at least (n + 1, n + 1).

    Lanes have the fixed point alone: the orbit of one that becomes NaN is integrated again by the scalar kernel. Their
    status is SOLVED if any lane is.
    """

    @inline
    def sweep(arguments, x, active):
        new = G(x, arguments)
        return replace(active, x, new), distance(new, x), size(new)

    @inline
    def improve(arguments, x, span, eps, work):
        """One step of Newton's method from x, with a finite-difference matrix and elimination."""
        n = len(x)
        g = G(x, arguments)
        first, second = lengths(x, g, arguments)
        for i in range(n):
            step = difference(first if 2 * i < n else second, span, eps)
            column = minus(G(bump(x, i, step), arguments), g)
            store(work, n, column)
            for j in range(n):
                work[j, i] = (1.0 if i == j else 0.0) - work[n, j] / step
        store(work, n, minus(g, x))
        for j in range(n):
            work[j, n] = work[n, j]
        if not size(x) < np.inf:
            return x, np.inf, np.inf, n + 1, NOT_FINITE
        if not gauss(work, n):
            return x, np.inf, np.inf, n + 1, STALLED
        for j in range(n):
            work[n, j] = work[j, n]
        new = plus(x, load(work, n, x))
        return new, distance(new, x), size(new), n + 1, SOLVED

    iterate, newton = fixed_point(sweep), newton_method(improve)

    def solve(arguments, start, span, eps, work):
        """Solve x = G(x, arguments) from the start; (x, evaluations, 1 if Newton's method was used else 0, status)."""
        x, k, solved = iterate(arguments, start, span, eps)
        if solved:
            return x, k, 0, SOLVED
        x, evaluations, status = newton(arguments, start, span, eps, work)
        if status != SOLVED:
            x, more, status = newton(arguments, minus(start, start), span, eps, work)
            evaluations += more
        return x, k + evaluations, 1, status

    def solve_lanes(arguments, start, span, eps, work):
        """Solve x = G(x, arguments) in lanes, by fixed point."""
        x, evaluations, _ = iterate(arguments, start, span, eps)
        return x, evaluations, 0, SOLVED if (size(x) < np.inf) & (span < np.inf) else NOT_FINITE

    return overload_in_lanes(solve, solve_lanes)


# -- unknowns that are rows of a memory -------------------------------------------------------------------------------


def row_solver(sweep: Callable, linearize: Callable) -> Callable:
    """Make the solver of x = G(x) for unknowns in rows of a memory: fixed point, then Newton's method.

    It is a function (equations, at, span, eps, work) -> (sweeps, sweeps that Newton's method took, status). The
    unknowns are the rows at, ..., at + stages - 1, which hold the start and then the solution; the 3 ``stages`` rows
    after them are overwritten. ``equations`` is a NamedTuple with the fields memory, stages, and like, a zero of the
    kind of a row.

    - ``sweep(equations, old, new)`` writes G of the rows ``old`` to the rows ``new``; returns (their distance, the size
      of the new).
    - ``linearize(equations, at, span, work)`` writes the matrix of 1 - G' into ``work``, by differences of length
      `difference`, and G itself to the rows at + stages; may use the ``stages`` rows after those. Returns the number of
      sweeps that cost as much.
    """

    @inline
    def to_and_fro(equations, rows, active):
        old, new = rows
        delta, length = sweep(equations, old, new)
        return (new, old), delta, length

    @inline
    def improve(equations, at, span, eps, work):
        """One step of Newton's method, by elimination; changes the unknowns in the rows ``at``, ..."""
        memory, stages, n = equations.memory, equations.stages, len(equations.like)
        order = stages * n
        sweeps = linearize(equations, at, span, work)
        delta, length = 0.0, 0.0
        for r in range(order):
            j, i = r // n, r % n
            work[r, order] = memory[at + stages + j, i] - memory[at + j, i]
            if not abs(work[r, order]) < np.inf:
                return at, delta, length, sweeps, NOT_FINITE
        if not gauss(work, order):
            return at, delta, length, sweeps, STALLED
        for r in range(order):
            j, i = r // n, r % n
            memory[at + j, i] += work[r, order]
            delta += abs(work[r, order])
            length += abs(memory[at + j, i])
        return at, delta, length, sweeps, SOLVED

    iterate, newton = fixed_point(to_and_fro), newton_method(improve)

    @inline
    def solve(equations, at, span, eps, work):
        """Solve from the start in the rows ``at``, ...; returns (sweeps, sweeps of Newton's method, status)."""
        memory, stages, like = equations.memory, equations.stages, equations.like
        start = at + 3 * stages
        copy(memory, at, start, stages, like)
        (last, _), k, solved = iterate(equations, (at, at + stages), span, eps)
        if solved:
            if last != at:
                copy(memory, last, at, stages, like)
            return k, 0, SOLVED
        copy(memory, start, at, stages, like)
        _, sweeps, status = newton(equations, at, span, eps, work)
        if status != SOLVED:
            for j in range(stages):
                store(memory, at + j, like)
            _, more, status = newton(equations, at, span, eps, work)
            sweeps += more
        return k, sweeps, status

    return solve


def changes_by_row(change: Callable) -> Callable:
    """Make ``changes`` of `confirmer` from ``change(equations, x, y)``, the `Change` from a row x to a row y."""

    @inline
    def changes(e, old, new):
        total = Change(0.0, 0.0, 0.0, 0.0)
        for j in range(e.stages):
            c = change(e, load(e.memory, old + j, e.like), load(e.memory, new + j, e.like))
            total = Change(total.q + c.q, total.p + c.p, total.size_q + c.size_q, total.size_p + c.size_p)
        return total

    return changes


@inline
def single(rows: np.ndarray) -> bool:
    """True if there is only one quadrature rule; ``rows[i]`` is the number of rows of row i's rule."""
    return rows[0] == len(rows)


def refinement(solve: Callable, sweep: Callable, by_rule: Callable, cost: Callable) -> Callable:
    """Make the solver of equations with integrals: by finer and finer quadrature rules, until one confirms the last.

    It is a function (equations, x, span, noise, work, counts) -> (x, status), from the start x by the rule whose first
    row is ``counts.rule`` and by finer ones.

    - ``solve`` is that of a `solver`; ``sweep(equations, x)`` iterates once, and returns (the new x,
      the `Change` to it).
    - ``by_rule(equations, rule)`` makes the equations with that rule, ``cost(equations, rule)`` the evaluations that a
      sweep takes.
    - ``span`` is the size of the variables, ``noise`` that of the terms that an increment sums up. The equations have
      the field step, and the step the fields eps and ``rows``: for each row of coefficients, the rows of its rule.

    The confirming sweep is an iterate of the finer rule, so that it is not wasted. A step that the largest rule leaves
    unconfirmed is a fallback.
    """

    @inline
    def refine(e, x, span, noise, work, counts):
        rows = e.step.rows
        move = Change(np.inf, np.inf, np.inf, np.inf)
        before = counts.rule
        while True:
            rule = counts.rule
            following = rule + rows[rule]
            x, sweeps, newton, status = solve(by_rule(e, rule), x, span, e.step.eps, work)
            counts.gradient += sweeps * cost(e, rule)
            counts.newton += newton
            if status != SOLVED or single(rows):
                return x, status
            if following == len(rows):
                counts.fallbacks += 1
                return x, status
            counts.rule = following
            last = move
            x, move = sweep(by_rule(e, following), x)
            counts.gradient += cost(e, following)
            sure, ended = unchanged(move, last, noise, e.step.eps)
            if sure or ended:  # the next step need not begin with the rule that only showed the end
                counts.rule = rule if sure else before
                return x, status
            before = rule

    return refine


def confirmer(solve: Callable, sweep: Callable, changes: Callable) -> Callable:
    """Make the `refinement` of unknowns in rows of a memory, x being the first row.

    ``solve``, ``sweep`` and the equations are those of `row_solver`; the functions read the rule from
    ``equations.counts.rule``, and the step also has ``nodes``: for each row of coefficients, the nodes of its rule.
    ``changes(equations, old, new)`` is the `Change` from the unknowns in the rows ``old`` to those in the rows ``new``.
    """

    @inline
    def solve_rows(e, at, span, eps, work):
        sweeps, newton, status = solve(e, at, span, eps, work)
        return at, sweeps + newton, min(newton, 1), status

    @inline
    def sweep_rows(e, at):
        sweep(e, at, at + e.stages)
        move = changes(e, at, at + e.stages)
        copy(e.memory, at + e.stages, at, e.stages, e.like)
        return at, move

    return refinement(solve_rows, sweep_rows, inline(lambda e, rule: e), inline(lambda e, rule: e.step.nodes[rule]))
