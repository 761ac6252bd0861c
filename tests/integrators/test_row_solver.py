"""The row solver: stopping rules, linear equations, unknowns stored in rows, confirmation of a quadrature rule."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from phasebench.integrators.stepping import solve
from phasebench.integrators.stepping.kernel import COUNTS
from phasebench.integrators.stepping.solve import NOT_FINITE, SOLVED, STALLED, Change
from phasebench.integrators.values.vector import axpy, distance, inline, load, scale, size, store
from support.values import value

EPS = np.finfo(float).eps


# -- when to stop -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("theta", [0.01, 0.5, 0.9])
@pytest.mark.parametrize("length", [1.0, 1e-6])
def test_fixed_point_iteration_ends_at_a_share_of_round_off(theta, length):
    """The remainder of the geometric series of changes is compared with a fraction of round-off."""
    left = solve.SHARE * EPS * length
    for factor, reached in ((0.99, True), (1.01, False)):
        delta = factor * left * (1 - theta) / theta
        assert solve.converged(delta, delta / theta, length, 1e9, EPS) == reached


def test_stagnating_changes_count_as_converged_near_round_off():
    for noise in ((1.0, 0.0), (0.0, 1.0)):
        assert solve.converged(60 * EPS, 50 * EPS, *noise, EPS)
        assert solve.converged(60 * EPS, 60 * EPS, *noise, EPS)
        assert not solve.converged(70 * EPS, 60 * EPS, *noise, EPS)
    assert solve.converged(0.0, np.inf, 1.0, 1.0, EPS)
    assert not solve.converged(1e-300, np.inf, 1.0, 1.0, EPS), "one change says nothing of the next"


def test_newton_ends_at_round_off_or_stagnates_near_it():
    unit, noise = EPS, 1e-12
    assert solve.newton_converged(unit, np.inf, unit, 0.0)
    assert not solve.newton_converged(1.1 * unit, np.inf, unit, 0.0)
    assert solve.newton_converged(900 * noise, 1000 * noise, unit, noise)
    assert not solve.newton_converged(900 * noise, 2000 * noise, unit, noise), "it still falls"
    assert not solve.newton_converged(1100 * noise, 1000 * noise, unit, noise), "it is far from round-off"


def test_rules_confirm_each_other_if_both_halves_agree():
    noise = 1.0
    far, none, small = 1e-6, 10 * EPS, 50 * EPS
    for move, last, wanted in (
        (none, far, (True, True)),
        (small, far, (False, False)),
        (small, small, (False, True)),
        (100 * small, small, (False, False)),
    ):
        for other, before in ((0.0, np.inf), (none, far)):
            for of_q, of_p, last_q, last_p in ((move, other, last, before), (other, move, before, last)):
                found = solve.unchanged(Change(of_q, of_p, 1.0, 1.0), Change(last_q, last_p, 1.0, 1.0), noise, EPS)
                assert tuple(found) == wanted
    small_momenta = Change(none, none, 1.0, 1e-3)
    assert not solve.unchanged(small_momenta, Change(far, far, 1.0, 1.0), 0.0, EPS)[0], "sizes are told apart"


class MovedState(NamedTuple):
    """Stand-in for stage equations, of which only the state (q, p) is read."""

    q: Any
    p: Any


def test_scales_of_coordinates_and_momenta_are_separate():
    q, p, x, g = (0.5, -0.25), (8.0, 1.0), (1.0, -2.0, 4.0, 0.125), (3.0, 4.0, -16.0, 2.0)

    def lengths(of_q, of_p):
        """The scales that the solver uses for fixed unknowns, with q in units of `of_q` and p in units of `of_p`."""
        units = np.array([of_q, of_q, of_p, of_p])
        moved = MovedState(value(*np.multiply(q, of_q)), value(*np.multiply(p, of_p)))
        return solve.lengths_of_both(value(*units * x), value(*units * g), moved)

    first, second = lengths(1.0, 1.0)
    assert first >= 7
    assert second >= 18
    assert tuple(lengths(4.0, 1.0)) == (4 * first, second)
    assert tuple(lengths(1.0, 2.0**-30)) == (first, second * 2.0**-30)


def test_difference_steps_lose_half_of_the_digits():
    assert solve.difference(3.0, 1e6, EPS) == pytest.approx(3 * EPS**0.5)
    assert solve.difference(0.0, 1e6, EPS) == pytest.approx(1e6 * EPS**0.5)


# -- starting values of numbers ---------------------------------------------------------------------------------------


def test_numbers_are_extrapolated_like_vectors():
    stages, like = 3, value(0.0)
    memory = np.random.default_rng(2).normal(size=((solve.LEVELS + 1) * stages, 1))
    for known in range(2 * solve.LEVELS + 2):
        for first in range(stages):
            number = solve.predict_number(memory, first, stages, known)
            assert number == pytest.approx(solve.predict(memory, first, stages, known, like)[0], rel=1e-14)


# -- linear equations -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 2, 5])
def test_linear_equations_are_solved_with_pivoting(n):
    rng = np.random.default_rng(n)
    A, x = rng.normal(size=(n, n)), rng.normal(size=n)
    A[range(n), range(n)] = 0 if n > 1 else 3.0
    table = np.column_stack([A, A @ x])
    assert solve.gauss(table, n)
    assert table[:, n] == pytest.approx(x, rel=1e-12)


def test_the_largest_pivot_is_used():
    for tiny in (1e-20, -1e-20):
        table = np.array([[tiny, 1.0, 1.0], [1.0, 1.0, 2.0]])
        assert solve.gauss(table, 2)
        assert table[:, 2] == pytest.approx([1, 1], rel=1e-15)
    assert not solve.gauss(np.array([[1.0, 2.0, 1.0], [2.0, 4.0, 2.0]]), 2), "singular"


# -- unknowns in rows of memory ---------------------------------------------------------------------------------------


class Ring(NamedTuple):
    """Linear test equations for rows of unknowns in a ring: x_j = offset + factor x_{j + 1} + constant_j - offset."""

    memory: np.ndarray
    stages: int
    like: Any
    constants: np.ndarray
    factor: float
    offset: float


@inline
def sweep(e, old, new):
    """Evaluate all rows of the ring's equations; return the norms of the change and of the new rows."""
    delta, length = 0.0, 0.0
    for j in range(e.stages):
        x = load(e.memory, old + (j + 1) % e.stages, e.like)
        whole = axpy(e.factor, x, load(e.constants, e.stages + j, e.like))
        g = axpy(-1.0, load(e.constants, e.stages, e.like), whole)
        store(e.memory, new + j, axpy(1.0, load(e.constants, j, e.like), g))
        g = load(e.memory, new + j, e.like)
        delta += distance(g, load(e.memory, old + j, e.like))
        length += size(g)
    return delta, length


@inline
def linearize(e, at, span, work):
    """Write the Jacobian of the ring's equations into ``work``."""
    n = len(e.like)
    for j in range(e.stages * n):
        for i in range(e.stages * n):
            work[j, i] = 1.0 if i == j else 0.0
        work[j, (j + n) % (e.stages * n)] -= e.factor
    sweep(e, at, at + e.stages)
    return 1


solve_rows = solve.row_solver(sweep, linearize)
STAGES, D = 3, 2
AT = 2


def ring(factor, constants, start=None, offset=0.0):
    """Test equations of a ring, with a memory in which the start of the iteration is at row `AT`."""
    memory = np.full((AT + 4 * STAGES, D), 9.0)
    memory[AT : AT + STAGES] = 0.0 if start is None else start
    table = np.vstack([constants, np.full((STAGES, D), offset)])
    return Ring(memory, STAGES, value(*[0.0] * D), table, factor, offset)


def solution(factor, constants):
    """Exact solution of the ring's equations without the offset, by NumPy."""
    matrix = np.eye(STAGES) - factor * np.roll(np.eye(STAGES), 1, axis=1)
    return np.linalg.solve(matrix, constants)


def solve_counted(e, span=1.0):
    """((sweeps, Newton iterations, status), rows of the solution) of the row solver."""
    with np.errstate(all="ignore"):
        found = solve_rows(e, AT, span, EPS, np.zeros((STAGES * D, STAGES * D + 1)))
    assert (e.memory[:AT] == 9).all(), "rows before the unknowns are others'"
    return tuple(found), e.memory[AT : AT + STAGES]


CONSTANTS = np.array([[0.7, -1.0], [0.25, 3.0], [2.0, 0.5]])


@pytest.mark.parametrize("factor", [0.0, 1e-8, 0.1, -0.3])
def test_a_contraction_of_rows_needs_no_newton(factor):
    (sweeps, newton, status), x = solve_counted(ring(factor, CONSTANTS))
    assert (newton, status) == (0, SOLVED)
    assert sweeps <= 60
    assert x == pytest.approx(solution(factor, CONSTANTS), rel=4 * EPS)


@pytest.mark.parametrize("factor", [0.999, -1.0, 1.5, -30.0, 1e6])
def test_newton_takes_over_from_a_stalled_iteration(factor):
    (sweeps, newton, status), x = solve_counted(ring(factor, CONSTANTS, start=1.0))
    assert status == SOLVED
    assert 1 <= newton <= 8
    assert x == pytest.approx(solution(factor, CONSTANTS), rel=1e-12)
    assert sweeps <= solve.FIXED_POINT_LIMIT


def test_the_limit_on_sweeps_applies_to_slow_convergence():
    slow, half = (solve_counted(ring(f, np.full((STAGES, D), 1.25)))[0] for f in (0.999, 0.5))
    assert slow[0] == solve.FIXED_POINT_LIMIT
    assert half[0] > solve.FIXED_POINT_LIMIT
    assert half[2] == SOLVED


def test_rows_with_large_terms_are_solved_to_round_off():
    offset = 2.0**20
    (_, newton, status), x = solve_counted(ring(-30.0, CONSTANTS, offset=offset), span=offset)
    assert status == SOLVED
    assert newton > 0
    assert np.abs(x - solution(-30.0, CONSTANTS)).max() < 8 * EPS * offset


def test_unsolvable_rows_are_reported():
    assert solve_counted(ring(1.0, CONSTANTS))[0][2] == STALLED
    assert solve_counted(ring(np.nan, CONSTANTS))[0][2] == NOT_FINITE
    assert solve_counted(ring(1 + 1e-6, np.full((STAGES, D), 1e303)))[0][2] == NOT_FINITE, (
        "it is beyond the largest double"
    )


# -- confirmation by the next rule ------------------------------------------------------------------------------------


class Step(NamedTuple):
    """Stand-in for a method's step that has a list of quadrature rules."""

    h: float
    eps: float
    nodes: np.ndarray
    rows: np.ndarray


class RoundedRows(NamedTuple):
    """Test equations x_j = factor x_j + constant_j, with constants of their own for each quadrature rule."""

    memory: np.ndarray
    stages: int
    like: Any
    q: Any
    p: Any
    step: Step
    rules: np.ndarray
    counts: Any


@inline
def by_rule(e, old, new):
    """A fixed-point iteration by the rule that ``e.counts`` names: rows ``new`` of the memory from its rows ``old``.

    Returns (distance of new and old rows, size of the new ones).
    """
    delta, length = 0.0, 0.0
    for j in range(e.stages):
        x = load(e.memory, old + j, e.like)
        g = axpy(0.125, x, scale(1.0, load(e.rules, e.counts.rule * e.stages + j, e.like)))
        store(e.memory, new + j, g)
        delta += distance(g, x)
        length += size(g)
    return delta, length


@inline
def no_derivative(e, at, span, work):
    """Stand-in for a Jacobian, which is not needed."""
    return 0


@inline
def from_row(e, x, y):
    """Norm of the change from a row of unknowns x to y."""
    return solve.change(x, y)


confirm = solve.confirmer(solve.row_solver(by_rule, no_derivative), by_rule, solve.changes_by_row(from_row))


def solve_digits(digits, rule=0):
    """(status, counts, error) for rules whose constants have these numbers of correct digits."""
    limits = np.array([[1 / 3, -2 / 3], [3.3, 1 / 7]])
    stages = len(limits)
    table = np.array([limits * (1 + 10.0**-d) for d in digits]).reshape(-1, 2)
    counts = np.zeros(1, COUNTS).view(np.recarray)[0]
    counts.rule = rule
    memory = np.zeros((4 * stages, 2))
    nodes, rows = np.arange(10, 10 + len(digits)), np.ones(len(digits), int)
    e = RoundedRows(memory, stages, value(0.0, 0.0), value(1.0), value(0.5), Step(0.1, EPS, nodes, rows), table, counts)
    span = 1.5  # of q = 1 and p = 1/2
    _, status = confirm(e, 0, span, 0.1 * span, np.zeros((4, 5)), counts)
    error = np.abs(memory[:stages] / (limits / 0.875) - 1).max()
    return status, counts, error


def test_rules_are_refined_until_nothing_changes():
    status, counts, error = solve_digits([2, 4, 8, 30, 30, 30])
    assert (status, counts.fallbacks, counts.newton) == (SOLVED, 0, 0)
    assert error < 4 * EPS
    assert counts.rule == 3, "the next step begins where nothing changed"
    sweeps = counts.gradient
    again = solve_digits([2, 4, 8, 30, 30, 30], rule=3)[1]
    assert again.rule == 3
    assert again.gradient < sweeps / 2


def test_an_unconfirmed_largest_rule_is_a_fallback():
    status, counts, error = solve_digits([2, 4, 8])
    assert (status, counts.fallbacks) == (SOLVED, 1)
    assert error == pytest.approx(1e-8, rel=1e-3)


def test_a_single_rule_needs_no_confirmation():
    status, counts, error = solve_digits([3])
    assert (status, counts.fallbacks, counts.rule) == (SOLVED, 0, 0)
    assert error == pytest.approx(1e-3, rel=1e-3)
    assert counts.gradient % 10 == 0


def test_the_change_of_rows_is_the_total_change():
    rng = np.random.default_rng(4)
    memory = rng.normal(size=(6, 2))
    step = Step(0.1, EPS, np.array([1]), np.array([1]))
    counts = np.zeros(1, COUNTS).view(np.recarray)[0]
    e = RoundedRows(memory, 3, value(0.0, 0.0), value(1.0), value(0.5), step, memory, counts)
    found = solve.changes_by_row(from_row)(e, 0, 3)
    moved = np.abs(memory[3:] - memory[:3]).sum(0)
    assert tuple(found) == pytest.approx((*moved, *np.abs(memory[3:]).sum(0)), rel=1e-14)
