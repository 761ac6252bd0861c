r"""Solve stage equations :math:`x = G(x)` to round-off, by fixed point, or by Newton's method where that fails.

Fixed point: iterate until the increment can fall no further.  With :math:`\delta_k = \|x_{k+1} - x_k\|` and
:math:`\theta = \delta_k / \delta_{k-1}` the remaining error is about :math:`\delta_k\theta/(1 - \theta)`; it is brought
far below the round-off of x, or until it no longer falls.  Where the iteration does not contract, Newton's method takes
over on :math:`x - G(x)` (`newton`): from the start, and where that fails from zero.

Unknowns that fit into registers are tuples (`solver`), also of SIMD lanes; unknowns of many stages are rows of a
two-dimensional array (`row_solver`), and those of a lattice an array whose Jacobian is banded (`banded`).  Starting
values are extrapolated from earlier steps (`predict`,
`remember`).

In equations with integrals, a quadrature rule is confirmed by the next finer one (`unchanged`, `refinement`).

Reference: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), VIII.5-6.
"""

from __future__ import annotations

from collections.abc import Callable
from math import comb
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasebench.integrators.coefficients.tableaus import LEVELS
from phasebench.integrators.values.masks import broadcast_like, fails, number, overload_in_lanes, retire_lanes, where
from phasebench.integrators.values.vector import axpy, distance, head, inline, load, scale, size, store, tail

from .codes import ASKED, NOT_FINITE, OUT_OF_STEP, SOLVED, STALLED  # noqa: F401
from .newton import ASKED_AT, begin

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Condition, Number, Value

#: Row m: weights that extrapolate the last m solutions by one step, the newest first.
_EXTRAPOLATION = np.array(
    [[(-1) ** j * comb(m, j + 1) if j < m else 0 for j in range(LEVELS)] for m in range(LEVELS + 1)], dtype=float
)
FIXED_POINT_LIMIT = 40
#: The iteration stops when its error is this share of round-off: a larger error has a bias, and accumulates linearly
#: in time.
SHARE = 1e-3


@inline
def predict(memory: np.ndarray, first: int, stages: int, known: int, like: Any) -> Any:
    """Extrapolate the starting value of a stage equation from its solutions in the last steps, by a polynomial.

    ``known`` is the number of steps made so far, of which the last LEVELS at most are used; without any the result is
    zero.  Their solutions are the rows first, first + stages, ... of ``memory``, a ring buffer; the result is a value
    of the kind and length of ``like``.  The newest is added last, so that only one product waits for it.
    """
    m = min(known, LEVELS)
    x = scale(0.0, like)
    for back in range(LEVELS, 0, -1):
        row = first + (known - back) % LEVELS * stages
        x = axpy(_EXTRAPOLATION[m, back - 1], load(memory, row, like), x)
    return x


@inline
def predict_number(memory: np.ndarray, first: int, stages: int, known: int) -> float:
    """Extrapolate a number from its values in the last steps by a polynomial, as `predict` extrapolates vectors.

    The values stand in the first column of ``memory``, in the rows first, first + stages, ..., as a ring buffer;
    ``known`` is the number of steps made so far.
    """
    m = min(known, LEVELS)
    x = 0.0
    for back in range(LEVELS, 0, -1):
        x = x + _EXTRAPOLATION[m, back - 1] * memory[first + (known - back) % LEVELS * stages, 0]
    return x


@inline
def remember(memory: np.ndarray, first: int, stages: int, known: int, x: Any) -> None:
    """Store x, the solution of a stage equation, in the ring buffer in ``memory`` from which `predict` extrapolates.

    ``known`` is the number of steps made before this one.  The buffer has `LEVELS` places, ``stages`` rows apart; its
    first place is row ``first``.
    """
    store(memory, first + known % LEVELS * stages, x)


@inline
def copy(memory: np.ndarray, old: int, new: int, stages: int, like: Any) -> None:
    """Copy ``stages`` rows of ``memory``, from row ``old`` on, to the rows from ``new`` on.

    Of each row as many components are copied as ``like`` has.
    """
    for j in range(stages):
        store(memory, new + j, load(memory, old + j, like))


# -- when to stop -----------------------------------------------------------------------------------------------------


@inline
def near(delta: Number, last: Number, unit: Number) -> bool:
    """True if the error of x in a contracting iteration is far below ``unit``, the round-off of x.

    The error is estimated from the lengths of the last change of x, ``delta``, and of the one before, ``last``.
    """
    return (last < np.inf) & (delta * delta <= SHARE * unit * (last - delta))


@inline
def converged(delta: Any, last: Any, length: Any, span: Any, eps: float) -> Any:
    """True if a fixed-point iteration is at round-off, judged by its last two changes ``delta`` and ``last``.

    ``length`` is the size of the unknowns, ``span`` that of the variables in which their equation varies, ``eps`` the
    machine epsilon.  In lanes the result is a mask.
    """
    unit = eps * length
    return (
        (delta == 0)
        | near(delta, last, unit)
        | ((delta >= last) & (delta <= 64 * (unit + eps * span)) & (delta < np.inf))
    )


@inline
def lengths_of_both(x: Any, g: Any, e: NamedTuple) -> tuple[float, float]:
    """Sizes (1-norms) of the coordinates and of the momenta in a step, for the lengths of finite differences.

    ``e`` has the fields q and p, the start of the step; x and g = G(x) are increments, first those of q, then of p.  If
    momenta are far smaller than coordinates, a difference of the coordinates' length would leave the momenta's range,
    and one of the momenta's length would be lost in the coordinates' round-off: hence two sizes.
    """
    return size(e.q) + size(head(x)) + size(head(g)), size(e.p) + size(tail(x)) + size(tail(g))


class Change(NamedTuple):
    """How far the unknowns, increments of q and p, move from one quadrature rule to the next.

    There are two numbers for each: if momenta are far smaller than coordinates, a joint norm hides their error.

    Attributes
    ----------
    q, p : 1-norms of the change of the increments of q and of p
    size_q, size_p : 1-norms of the increments themselves
    """

    q: float
    p: float
    size_q: float
    size_p: float


@inline
def change(old: Any, new: Any) -> Change:
    """The `Change` from increments ``old`` to ``new``, the first half of each of q, the second of p."""
    return Change(distance(head(old), head(new)), distance(tail(old), tail(new)), size(head(new)), size(tail(new)))


@inline
def unchanged(move: Change, last: Change, noise: float, eps: float) -> tuple[bool, bool]:
    """Test whether a finer quadrature rule has confirmed the one before; returns two truth values (sure, ended).

    ``move`` is the `Change` to the finer rule, ``last`` the one before it; ``noise`` is the size of the terms that an
    increment sums up, eps the machine epsilon.  sure: the change is at the round-off of the increments.  ended: it is
    that, or it no longer falls and is at the round-off of the terms.
    """
    sure_q, sure_p = move.q <= 16 * eps * move.size_q, move.p <= 16 * eps * move.size_p
    ended_q = sure_q or (move.q > 0.5 * last.q and move.q <= 64 * eps * (move.size_q + noise))
    ended_p = sure_p or (move.p > 0.5 * last.p and move.p <= 64 * eps * (move.size_p + noise))
    return sure_q and sure_p, ended_q and ended_p


# -- the fixed point -------------------------------------------------------------------------------------------------


def _started(x, span):
    return True, np.inf, 0.0


def _started_in_lanes(x, span):
    return (size(x) < np.inf) & (span < np.inf), broadcast_like(np.inf, span), broadcast_like(0.0, span)


#: Function (x, span) -> (where to iterate, the length of the change before the first, how often it grew) with which a
#: fixed-point iteration begins; it excludes the lanes in which x or ``span`` is not finite.
started = overload_in_lanes(_started, _started_in_lanes)


def _replace(active, x, new):
    return new


def _replace_in_lanes(active, x, new):
    return where(active, new, x)


#: Function (active, x, new) -> the new x in the active lanes, the old one in the others; for a scalar the new x.
replace = overload_in_lanes(_replace, _replace_in_lanes)


def fixed_point(sweep: Callable) -> Callable:
    """Make the function that iterates x -> G(x) to round-off, for scalars and for SIMD lanes.

    The function is (equations, x, span, eps) -> (x, number of sweeps, True if solved), with ``span`` the size of the
    variables in which G varies.  ``sweep(equations, x, active)`` returns (G(x) in the lanes where ``active`` holds, its
    distance from x, its size).  Each lane stops where it would stop alone, and keeps its value while the others go on;
    a lane that is not solved becomes NaN.  The number of sweeps is the sum over the lanes.
    """

    @inline
    def iterate(e: Any, x: Value, span: Number, eps: Number) -> tuple:
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


# -- unknowns that are values -----------------------------------------------------------------------------------------


def solver(G: Callable, lengths: Callable = lengths_of_both) -> Callable:
    """Make the solver of x = G(x, arguments): fixed point to round-off, Newton's method if that does not contract.

    The solver is a function (arguments, start, span, eps, work) -> (x, evaluations of G, 1 if Newton's method was used
    else 0, status), for x a tuple or array of n numbers.  ``lengths(x, G(x), arguments)`` gives the sizes of the
    variables to which the two halves of x belong; ``span`` is the size of the variables (such as q and p) of the
    functions in G, ``work`` a `newton.Work` for n unknowns.  The status is SOLVED, STALLED or NOT_FINITE.

    For SIMD lanes there is no Newton's method: a lane that the fixed point does not solve becomes NaN, and its orbit is
    integrated again by the scalar kernel.  Their status is SOLVED if any lane is solved.
    """

    @inline
    def sweep(arguments: Any, x: Value, active: Condition) -> tuple[Value, Number, Number]:
        new = G(x, arguments)
        return replace(active, x, new), distance(new, x), size(new)

    iterate = fixed_point(sweep)

    def solve(arguments, start, span, eps, work):
        x, evaluations, solved = iterate(arguments, start, span, eps)
        if solved:
            return x, evaluations, 0, SOLVED
        rows, n = work.rows, len(start)
        at = n + ASKED_AT
        begin(rows, n)
        store(rows, at, start)
        status = ASKED
        while status == ASKED:
            x = load(rows, at, start)
            new = G(x, arguments)
            evaluations += 1
            store(rows, at + 1, new)
            first, second = lengths(x, new, arguments)
            status = work.newton(rows, rows, at, 1, n, (n + 1) // 2, first, second, span, eps)
        x = load(rows, at, start)
        if status == NOT_FINITE and size(x) < np.inf:
            status = STALLED  # G has no value at x
        return x, evaluations, 1, status

    def solve_lanes(arguments, start, span, eps, work):
        x, evaluations, _ = iterate(arguments, start, span, eps)
        return x, evaluations, 0, SOLVED if (size(x) < np.inf) & (span < np.inf) else NOT_FINITE

    return overload_in_lanes(solve, solve_lanes)


# -- unknowns that are rows of a memory -------------------------------------------------------------------------------


@inline
def shape_of_rows(equations: Any) -> tuple[int, int]:
    """The numbers of unknowns in a row and in half a row: first increments of q, then of p."""
    return len(equations.like), (len(equations.like) + 1) // 2


def row_solver(
    sweep: Callable, lengths: Callable, shape: Callable = shape_of_rows, evaluate: Callable | None = None
) -> Callable:
    """Make the solver of x = G(x) for unknowns in rows of an array: fixed point, Newton's method where that fails.

    The solver is a function (equations, at, span, eps, work) -> (sweeps of the fixed point, sweeps that Newton's method
    took, status); a sweep is an evaluation of G.  ``equations`` is a NamedTuple with the fields ``memory``, the array,
    ``stages``, the number of rows of x, and ``like``, a zero of the kind and length of a row.  The unknowns are the
    rows at, ..., at + stages - 1, which hold the start and then the solution; the 3 ``stages`` rows after them are
    overwritten.

    - ``sweep(equations, old, new)`` writes G of the rows from ``old`` on to the rows from ``new`` on; it returns (the
      distance between them, the size of the new ones).
    - ``lengths(equations, at)`` gives the sizes of the variables to which unknowns in the rows from ``at`` on belong,
      as two numbers, in turn; the ``stages`` rows after these are G there.
    - ``shape(equations)`` gives the numbers of unknowns in a row, and of those to which each of the two sizes belongs.
    - ``evaluate`` is G for Newton's method, called like ``sweep``, if that leaves out unknowns that need no iteration.
    """

    @inline
    def to_and_fro(equations: Any, rows: tuple[int, int], active: Condition) -> tuple[tuple[int, int], Number, Number]:
        old, new = rows
        delta, length = sweep(equations, old, new)
        return (new, old), delta, length

    iterate, evaluate = fixed_point(to_and_fro), evaluate or sweep

    @inline
    def solve(equations, at, span, eps, work):
        memory, stages = equations.memory, equations.stages
        start = at + 3 * stages
        copy(memory, at, start, stages, equations.like)
        (last, _), k, solved = iterate(equations, (at, at + stages), span, eps)
        if solved:
            if last != at:
                copy(memory, last, at, stages, equations.like)
            return k, 0, SOLVED
        copy(memory, start, at, stages, equations.like)
        n, half = shape(equations)
        begin(work.rows, stages * n)
        sweeps, status = 0, ASKED
        while status == ASKED:
            evaluate(equations, at, at + stages)
            sweeps += 1
            first, second = lengths(equations, at)
            status = work.newton(work.rows, memory, at, stages, n, half, first, second, span, eps)
        return k, sweeps, status

    return solve


def lengths_by_row(lengths: Callable) -> Callable:
    """Make the function (equations, at) -> two sizes of `row_solver` from ``lengths(x, G(x), equations)`` of a row x.

    Each is the largest of the rows'.
    """

    @inline
    def largest(e: Any, at: int) -> tuple[Number, Number]:
        first, second = 0.0 * e.step.h, 0.0 * e.step.h
        for j in range(e.stages):
            a, b = lengths(load(e.memory, at + j, e.like), load(e.memory, at + e.stages + j, e.like), e)
            first, second = max(first, a), max(second, b)
        return first, second

    return largest


def changes_by_row(change: Callable) -> Callable:
    """Make the function (equations, old, new) -> `Change` that compares two sets of unknowns, each in rows of an array.

    ``change(equations, x, y)`` returns the `Change` from a row x to a row y.  The result is the sum of these over the
    rows of ``equations.memory`` from ``old`` on, each compared with its counterpart among the rows from ``new`` on.
    `confirmer` takes such a function.
    """

    @inline
    def changes(e: Any, old: int, new: int) -> Change:
        total = Change(0.0, 0.0, 0.0, 0.0)
        for j in range(e.stages):
            c = change(e, load(e.memory, old + j, e.like), load(e.memory, new + j, e.like))
            total = Change(total.q + c.q, total.p + c.p, total.size_q + c.size_q, total.size_p + c.size_p)
        return total

    return changes


@inline
def single(rows: np.ndarray) -> bool:
    """True if a table of coefficients, whose rows are grouped by quadrature rules, has only one such rule.

    rows[i] is the number of rows of the rule to which row i belongs.
    """
    return rows[0] == len(rows)


def refinement(solve: Callable, sweep: Callable, by_rule: Callable, cost: Callable) -> Callable:
    """Make the solver of equations with integrals: by finer quadrature rules, until one confirms the rule before it.

    The solver is a function (equations, x, span, noise, work, counts) -> (x, status).  It begins at x with the rule
    whose first row in the table of coefficients is ``counts.rule``, and goes on with the finer rules after it.

    - ``solve`` is a function as `solver` makes; ``sweep(equations, x)`` iterates once, and returns (the new x, the
      `Change` to it).
    - ``by_rule(equations, rule)`` returns the equations with the rule whose first row is ``rule``,
      ``cost(equations, rule)`` the number of evaluations that a sweep with it takes.
    - ``span`` is the size of the variables, ``noise`` that of the terms that an increment sums up.  The equations have
      the field ``step``, and the step the fields ``eps`` and ``rows``: for each row of coefficients, the number of rows
      of its rule.

    The confirming sweep is an iterate of the finer rule, so that it is not wasted.  A step that the largest rule leaves
    unconfirmed is counted in ``counts.fallbacks``, evaluations in ``counts.gradient``.
    """

    @inline
    def refine(e: Any, x: int | Value, span: Number, noise: Number, work: np.ndarray, counts: np.record) -> tuple:
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
    """Make a solver of stage equations that contain integrals; the unknowns are rows of an array.

    As with `refinement`, it solves with finer and finer quadrature rules, until one confirms the rule before it.  It is
    a function (equations, at, span, noise, work, counts) -> (at, status); the unknowns are the rows of
    ``equations.memory`` from number ``at`` on, and the other arguments are those of the solver that `refinement` makes.

    ``sweep`` iterates once, and ``solve`` is the solver that `row_solver` makes from it.  Both take the quadrature rule
    from ``equations.counts.rule``, the number of its first row in the table of coefficients.  ``equations.step`` has,
    besides the fields that `refinement` states, ``nodes``: for each row of this table the number of nodes of its rule.
    The other fields of ``equations`` are those that `row_solver` states.

    ``changes(equations, old, new)`` is the `Change` from the unknowns in the rows from ``old`` on to those in the rows
    from ``new`` on.
    """

    @inline
    def solve_rows(e: Any, at: int, span: Number, eps: Number, work: np.ndarray) -> tuple[int, ...]:
        sweeps, newton, status = solve(e, at, span, eps, work)
        return at, sweeps + newton, min(newton, 1), status

    @inline
    def sweep_rows(e: Any, at: int) -> tuple[int, Change]:
        sweep(e, at, at + e.stages)
        move = changes(e, at, at + e.stages)
        copy(e.memory, at + e.stages, at, e.stages, e.like)
        return at, move

    return refinement(solve_rows, sweep_rows, inline(lambda e, rule: e), inline(lambda e, rule: e.step.nodes[rule]))
