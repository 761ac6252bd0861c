"""When the solver stops, its linear equations, its unknowns in rows of a memory, and the confirmation of a rule."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from phasebench.integrators.engine import solve
from phasebench.integrators.engine.kernel import COUNTS
from phasebench.integrators.engine.solve import NOT_FINITE, SOLVED, STALLED, Change
from phasebench.integrators.engine.vector import axpy, distance, inlined, load, scale, size, store
from support.values import value

EPS = np.finfo(float).eps


# -- when to stop -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("theta", [0.01, 0.5, 0.9])
@pytest.mark.parametrize("length", [1.0, 1e-6])
def test_a_fixed_point_is_reached_when_what_is_left_is_a_share_of_round_off(theta, length):
    """What is left of a geometric series is the next change and all that follow."""
    left = solve.SHARE * EPS * length
    for factor, reached in ((0.99, True), (1.01, False)):
        delta = factor * left * (1 - theta) / theta
        assert solve.converged(delta, delta / theta, length, 1e9, EPS) == reached


def test_a_fixed_point_that_no_longer_falls_is_reached_near_round_off_alone():
    for noise in ((1.0, 0.0), (0.0, 1.0)):
        assert solve.converged(60 * EPS, 50 * EPS, *noise, EPS)
        assert solve.converged(60 * EPS, 60 * EPS, *noise, EPS)
        assert not solve.converged(70 * EPS, 60 * EPS, *noise, EPS)
    assert solve.converged(0.0, np.inf, 1.0, 1.0, EPS)
    assert not solve.converged(1e-300, np.inf, 1.0, 1.0, EPS), "one change says nothing of the next"


def test_newton_ends_at_round_off_or_near_it_where_it_no_longer_falls():
    unit, noise = EPS, 1e-12
    assert solve.newton_converged(unit, np.inf, unit, 0.0)
    assert not solve.newton_converged(1.1 * unit, np.inf, unit, 0.0)
    assert solve.newton_converged(900 * noise, 1000 * noise, unit, noise)
    assert not solve.newton_converged(900 * noise, 2000 * noise, unit, noise), "it still falls"
    assert not solve.newton_converged(1100 * noise, 1000 * noise, unit, noise), "it is far from round-off"


def test_a_rule_confirms_another_where_coordinates_and_momenta_moved_by_round_off_alone():
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


class Moved(NamedTuple):
    q: Any
    p: Any


def test_lengths_hold_all_that_is_varied_and_each_its_own_units():
    q, p, x, g = (0.5, -0.25), (8.0, 1.0), (1.0, -2.0, 4.0, 0.125), (3.0, 4.0, -16.0, 2.0)

    def lengths(of_q, of_p):
        units = np.array([of_q, of_q, of_p, of_p])
        moved = Moved(value(*np.multiply(q, of_q)), value(*np.multiply(p, of_p)))
        return solve.lengths_of_both(value(*units * x), value(*units * g), moved)

    first, second = lengths(1.0, 1.0)
    assert first >= 7
    assert second >= 18
    assert tuple(lengths(4.0, 1.0)) == (4 * first, second)
    assert tuple(lengths(1.0, 2.0**-30)) == (first, second * 2.0**-30)


def test_a_difference_loses_half_of_the_digits_of_what_is_varied():
    assert solve.difference(3.0, 1e6, EPS) == pytest.approx(3 * EPS**0.5)
    assert solve.difference(0.0, 1e6, EPS) == pytest.approx(1e6 * EPS**0.5)


# -- the start of a number --------------------------------------------------------------------------------------------


def test_the_start_of_a_number_is_that_of_a_value():
    stages, like = 3, value(0.0)
    memory = np.random.default_rng(2).normal(size=((solve.LEVELS + 1) * stages, 1))
    for known in range(2 * solve.LEVELS + 2):
        for first in range(stages):
            number = solve.predict_number(memory, first, stages, known)
            assert number == pytest.approx(solve.predict(memory, first, stages, known, like)[0], rel=1e-14)


# -- linear equations -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 2, 5])
def test_linear_equations_are_solved_in_any_order(n):
    rng = np.random.default_rng(n)
    A, x = rng.normal(size=(n, n)), rng.normal(size=n)
    A[range(n), range(n)] = 0 if n > 1 else 3.0
    table = np.column_stack([A, A @ x])
    assert solve.gauss(table, n)
    assert table[:, n] == pytest.approx(x, rel=1e-12)


def test_the_largest_pivot_is_taken():
    for tiny in (1e-20, -1e-20):
        table = np.array([[tiny, 1.0, 1.0], [1.0, 1.0, 2.0]])
        assert solve.gauss(table, 2)
        assert table[:, 2] == pytest.approx([1, 1], rel=1e-15)
    assert not solve.gauss(np.array([[1.0, 2.0, 1.0], [2.0, 4.0, 2.0]]), 2), "singular"


# -- unknowns in rows -------------------------------------------------------------------------------------------------


class Ring(NamedTuple):
    """x_j = offset + factor x_{j + 1} + constant_j - offset, of the rows in a ring."""

    memory: np.ndarray
    stages: int
    like: Any
    constants: np.ndarray
    factor: float
    offset: float


@inlined
def sweep(e, old, new):
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


@inlined
def linearize(e, at, span, work):
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
    """(The equations, a memory of them with the start at `AT`)."""
    memory = np.full((AT + 4 * STAGES, D), 9.0)
    memory[AT : AT + STAGES] = 0.0 if start is None else start
    table = np.vstack([constants, np.full((STAGES, D), offset)])
    return Ring(memory, STAGES, value(*[0.0] * D), table, factor, offset)


def solution(factor, constants):
    """Of the equations without an offset, by NumPy."""
    matrix = np.eye(STAGES) - factor * np.roll(np.eye(STAGES), 1, axis=1)
    return np.linalg.solve(matrix, constants)


def solved(e, span=1.0):
    """((sweeps, Newton's, status), the rows of the solution)."""
    with np.errstate(all="ignore"):
        found = solve_rows(e, AT, span, EPS, np.zeros((STAGES * D, STAGES * D + 1)))
    assert (e.memory[:AT] == 9).all(), "rows before the unknowns are others'"
    return tuple(found), e.memory[AT : AT + STAGES]


CONSTANTS = np.array([[0.7, -1.0], [0.25, 3.0], [2.0, 0.5]])


@pytest.mark.parametrize("factor", [0.0, 1e-8, 0.1, -0.3])
def test_a_contraction_of_rows_needs_no_newton(factor):
    (sweeps, newton, status), x = solved(ring(factor, CONSTANTS))
    assert (newton, status) == (0, SOLVED)
    assert sweeps <= 60
    assert x == pytest.approx(solution(factor, CONSTANTS), rel=4 * EPS)


@pytest.mark.parametrize("factor", [0.999, -1.0, 1.5, -30.0, 1e6])
def test_newton_takes_over_of_rows_that_stall_or_diverge(factor):
    (sweeps, newton, status), x = solved(ring(factor, CONSTANTS, start=1.0))
    assert status == SOLVED
    assert 1 <= newton <= 8
    assert x == pytest.approx(solution(factor, CONSTANTS), rel=1e-12)
    assert sweeps <= solve.FIXED_POINT_LIMIT


def test_a_fixed_point_has_its_sweeps_where_it_is_slow_and_more_where_it_is_fast_enough():
    slow, half = (solved(ring(f, np.full((STAGES, D), 1.25)))[0] for f in (0.999, 0.5))
    assert slow[0] == solve.FIXED_POINT_LIMIT
    assert half[0] > solve.FIXED_POINT_LIMIT
    assert half[2] == SOLVED


def test_rows_that_are_differences_of_large_numbers_are_solved_to_their_round_off():
    offset = 2.0**20
    (_, newton, status), x = solved(ring(-30.0, CONSTANTS, offset=offset), span=offset)
    assert status == SOLVED
    assert newton > 0
    assert np.abs(x - solution(-30.0, CONSTANTS)).max() < 8 * EPS * offset


def test_rows_without_a_solution_are_not_called_solved():
    assert solved(ring(1.0, CONSTANTS))[0][2] == STALLED
    assert solved(ring(np.nan, CONSTANTS))[0][2] == NOT_FINITE
    assert solved(ring(1 + 1e-6, np.full((STAGES, D), 1e303)))[0][2] == NOT_FINITE, "it is beyond the largest double"


# -- a rule that the next one confirms --------------------------------------------------------------------------------


class Step(NamedTuple):
    h: float
    eps: float
    nodes: np.ndarray
    rows: np.ndarray


class Rounded(NamedTuple):
    """x_j = factor x_j + the constants of row j of the rule in use."""

    memory: np.ndarray
    stages: int
    like: Any
    q: Any
    p: Any
    step: Step
    rules: np.ndarray
    counts: Any


@inlined
def by_rule(e, old, new):
    delta, length = 0.0, 0.0
    for j in range(e.stages):
        x = load(e.memory, old + j, e.like)
        g = axpy(0.125, x, scale(1.0, load(e.rules, e.counts.rule * e.stages + j, e.like)))
        store(e.memory, new + j, g)
        delta += distance(g, x)
        length += size(g)
    return delta, length


@inlined
def no_derivative(e, at, span, work):
    return 0


@inlined
def from_row(e, x, y):
    return solve.change(x, y)


confirm = solve.confirmer(solve.row_solver(by_rule, no_derivative), by_rule, solve.by_rows(from_row))


def confirmed(digits, rule=0):
    """(The status, the counts, the rows) of rules whose constants have so many digits each; a rule has one row."""
    limits = np.array([[1 / 3, -2 / 3], [3.3, 1 / 7]])
    stages = len(limits)
    table = np.array([limits * (1 + 10.0**-d) for d in digits]).reshape(-1, 2)
    counts = np.zeros(1, COUNTS).view(np.recarray)[0]
    counts.rule = rule
    memory = np.zeros((4 * stages, 2))
    nodes, rows = np.arange(10, 10 + len(digits)), np.ones(len(digits), int)
    e = Rounded(memory, stages, value(0.0, 0.0), value(1.0), value(0.5), Step(0.1, EPS, nodes, rows), table, counts)
    status = confirm(e, 0, np.zeros((4, 5)), counts)
    error = np.abs(memory[:stages] / (limits / 0.875) - 1).max()
    return status, counts, error


def test_a_rule_is_refined_until_the_next_changes_nothing():
    status, counts, error = confirmed([2, 4, 8, 30, 30, 30])
    assert (status, counts.fallbacks, counts.newton) == (SOLVED, 0, 0)
    assert error < 4 * EPS
    assert counts.rule == 3, "the next step begins where nothing changed"
    sweeps = counts.gradient
    again = confirmed([2, 4, 8, 30, 30, 30], rule=3)[1]
    assert again.rule == 3
    assert again.gradient < sweeps / 2


def test_a_step_that_the_largest_rule_leaves_unconfirmed_is_a_fallback():
    status, counts, error = confirmed([2, 4, 8])
    assert (status, counts.fallbacks) == (SOLVED, 1)
    assert error == pytest.approx(1e-8, rel=1e-3)


def test_one_rule_needs_no_other():
    status, counts, error = confirmed([3])
    assert (status, counts.fallbacks, counts.rule) == (SOLVED, 0, 0)
    assert error == pytest.approx(1e-3, rel=1e-3)
    assert counts.gradient % 10 == 0


def test_the_change_of_rows_is_that_of_all():
    rng = np.random.default_rng(4)
    memory = rng.normal(size=(6, 2))
    step = Step(0.1, EPS, np.array([1]), np.array([1]))
    counts = np.zeros(1, COUNTS).view(np.recarray)[0]
    e = Rounded(memory, 3, value(0.0, 0.0), value(1.0), value(0.5), step, memory, counts)
    found = solve.by_rows(from_row)(e, 0, 3)
    moved = np.abs(memory[3:] - memory[:3]).sum(0)
    assert tuple(found) == pytest.approx((*moved, *np.abs(memory[3:]).sum(0)), rel=1e-14)
