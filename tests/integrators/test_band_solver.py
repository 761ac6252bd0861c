"""Newton's method for banded equations, tested on six unknowns with known equations and derivatives."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import njit

from phasebench.integrators.compile import codegen
from phasebench.integrators.stepping.banded import Room, band_of, band_solver, columns, forget, is_stale, substitute
from phasebench.integrators.stepping.solve import NOT_FINITE, SOLVED, STALLED
from support.values import value

EPS = float(np.finfo(float).eps)
N = 6
#: The unknowns in chain order: each couples to the next two on either side.
CHAIN = [0, 3, 1, 4, 2, 5]
NEAR = [[abs(CHAIN.index(i) - CHAIN.index(j)) <= 2 for j in range(N)] for i in range(N)]
REACH = [np.flatnonzero(column) for column in np.array(NEAR).T]


class Equations(NamedTuple):
    """The equations x = G(x) with G_i(x) = c_i + sum_j M_ij (x_j + bend x_j^2).

    G has the round-off of numbers of size ``large``; ``first`` and ``unit`` are the scales of both halves of the
    unknowns; the length of ``q`` is d, half their number.
    """

    M: np.ndarray
    c: np.ndarray
    bend: float
    large: float
    first: float
    unit: float
    q: Any


@njit
def row(i, x, e):
    """The i-th component of G(x) for the equations e."""
    s = e.c[0, i]
    for j in range(N):
        s = s + e.M[i, j] * (x[j] + e.bend * x[j] * x[j])
    return (s + e.large) - e.large


@njit
def _G(x, e):
    return (row(0, x, e), row(1, x, e), row(2, x, e), row(3, x, e), row(4, x, e), row(5, x, e))


@njit
def lengths(x, g, e):
    """The scales of x that the solver asks for: three times the units of the two halves of the unknowns."""
    return 3.0 * e.first, 3.0 * e.unit


solve = band_solver(_G if codegen.compiled() else lambda x, e: np.array(_G(x, e)), lengths)


class Made:
    """Test equations x = G(x) with a banded derivative, and the solver's work array with guard rows on both sides."""

    SPARE, AT = 2, 1

    def __init__(self, seed=0, factor=2.0, bend=0.0, large=0.0, first=1.0, unit=1.0, M=None, c=None):
        rng = np.random.default_rng(seed)
        scales = np.where(np.arange(N) < N // 2, first, unit)
        self.M = factor * rng.normal(size=(N, N)) * NEAR if M is None else np.array(M, float)
        self.M = self.M * scales[:, None] / scales
        self.c = rng.normal(size=N) * scales if c is None else np.array(c, float)
        self.bend, self.large, self.first, self.unit = bend, large, first, unit
        self.band = band_of(REACH)
        self.memory, self.work = np.full((5, N + 1), 7.0), np.full((N + 3, columns(self.band)), 7.0)
        self.room = Room(self.memory, self.SPARE, self.work, self.AT)
        forget(self.work, self.AT, columns(self.band))

    def equations(self):
        return Equations(self.M, self.c[None], self.bend, self.large, self.first, self.unit, value(*[1.0] * (N // 2)))

    def solved(self, start=0.0, span=1.0):
        """(solution x, evaluations of G, status) of the banded Newton solver."""
        x, *rest = solve(self.equations(), value(*[start] * N), span, EPS, self.band, self.room)
        return np.array(x), *rest

    def residual(self, x):
        """Largest component of x - G(x)."""
        return np.abs(x - self.c - self.M @ (x + self.bend * x**2)).max()

    def inverse(self):
        """The inverse of the Newton matrix, from its stored factors."""
        out, place = np.zeros((N, N)), self.band.place
        for j in range(N):
            table = np.zeros((1, N))
            table[0, place[j]] = 1.0
            substitute(self.work, self.AT, N, self.band.width, table, 0)
            out[:, j] = table[0, place]
        return out


def test_the_band_is_that_of_the_chain():
    band = Made().band
    assert band.width == 2
    assert [abs(band.place[a] - band.place[b]) for a, b in pairwise(CHAIN)] == [1] * (N - 1)
    assert columns(band) == 8


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("unit", [1.0, 2.0**-30, 2.0**30])
def test_linear_equations_need_one_matrix(seed, unit):
    """The matrix is 1 - M whatever the units of the last three unknowns; differences take one evaluation per colour."""
    made = Made(seed, unit=unit)
    x, evaluations, status = made.solved()
    exact = np.linalg.solve(np.eye(N) - made.M, made.c)
    scales = np.where(np.arange(N) < N // 2, 1.0, unit)
    assert status == SOLVED
    np.testing.assert_allclose(x / scales, exact / scales, rtol=0, atol=1e-12 * np.abs(exact / scales).max())
    inverse = np.linalg.inv(np.eye(N) - made.M) * scales / scales[:, None]
    np.testing.assert_allclose(made.inverse() * scales / scales[:, None], inverse, atol=1e-6 * np.abs(inverse).max())
    colours = len(made.band.owner)
    assert colours == 5
    assert colours + 2 <= evaluations <= colours + 5
    assert not is_stale(made.work, made.AT, columns(made.band))
    again, fewer, status = made.solved()
    assert status == SOLVED
    np.testing.assert_allclose(again / scales, exact / scales, rtol=0, atol=1e-12 * np.abs(exact / scales).max())
    assert evaluations - fewer == colours
    forget(made.work, made.AT, columns(made.band))
    assert made.solved()[1] == evaluations


def test_the_solver_writes_only_into_its_work_rows():
    made = Made(bend=0.1, factor=1.0)
    assert made.solved()[2] == SOLVED
    mine = np.zeros(made.memory.shape, bool)
    mine[made.SPARE : made.SPARE + 2, :N] = True
    assert (made.memory[~mine] == 7).all()
    assert (made.memory[mine] != 7).all()
    rows = np.arange(len(made.work))
    assert (made.work[(rows < made.AT) | (rows >= made.AT + N)] == 7).all()


@pytest.mark.parametrize("seed", range(1, 6))
def test_nonlinear_equations_are_solved_to_round_off(seed):
    made = Made(seed, factor=0.7, bend=0.1)
    x, evaluations, status = made.solved()
    assert status == SOLVED
    assert made.residual(x) < 50 * EPS * (1 + np.abs(x).max())
    assert evaluations < 60
    close = Made(seed, factor=0.7, bend=0.1)
    close.work[:] = made.work
    close.c = made.c * (1 + 1e-3)
    y, fewer, status = close.solved()
    assert status == SOLVED
    assert close.residual(y) < 50 * EPS * (1 + np.abs(y).max())
    assert fewer < evaluations, "the matrix of the equations before serves"


def test_a_useless_matrix_is_replaced_at_the_start():
    """With the matrix of other equations the solver takes as many evaluations as with none."""
    made, other = Made(1), Made(2, factor=5.0)
    usual = made.solved()
    assert other.solved()[2] == SOLVED
    made.work[:] = other.work
    x, evaluations, status = made.solved()
    assert status == SOLVED
    np.testing.assert_allclose(x, usual[0], rtol=0, atol=1e-12 * np.abs(x).max())
    assert 1 <= evaluations - usual[1] <= 3


def test_a_start_at_the_solution_is_recognized():
    made = Made(c=np.zeros(N))
    x, evaluations, status = made.solved()
    assert (x == 0).all()
    assert (evaluations, status) == (1 + len(made.band.owner), SOLVED)


@pytest.mark.parametrize("large", [1e3, 1e6])
def test_equations_with_large_terms_are_solved_to_round_off(large):
    """The unknowns are small, but G is a difference of large numbers."""
    made = Made(3, factor=1.0, large=large, c=1e-6 * np.arange(1.0, N + 1))
    x, evaluations, status = made.solved(span=large)
    assert status == SOLVED
    assert made.residual(x) < 100 * EPS * large
    assert evaluations <= len(made.band.owner) + 16


def test_unsolvable_equations_drop_their_matrix():
    """For x = x + x^2 + 1 the solver stops and marks its matrix as stale."""
    made = Made(M=np.eye(N), bend=1.0, c=np.ones(N))
    _, evaluations, status = made.solved(start=0.3)
    assert status in (STALLED, NOT_FINITE)
    assert is_stale(made.work, made.AT, columns(made.band))
    assert evaluations > 25


def test_a_singular_matrix_is_not_solved():
    made = Made(M=np.eye(N), c=np.ones(N))
    _, evaluations, status = made.solved()
    assert status == STALLED
    assert is_stale(made.work, made.AT, columns(made.band))
    assert evaluations == 2 * (1 + len(made.band.owner)), "each of the two ways has seen it"


def test_an_overflow_is_reported_as_not_finite():
    """The sum of the moves overflows, and so does a difference of G."""
    made = Made(first=2.0**1000, unit=2.0**1000, c=1.7e308 * np.array([1, -1, 1, -1, 1, -1]))
    with np.errstate(all="ignore"):
        assert made.solved()[2] == NOT_FINITE
    assert is_stale(made.work, made.AT, columns(made.band))


def test_full_newton_takes_over_from_simplified_newton():
    """Simplified Newton fails for steep equations far from the start."""
    made = Made(M=np.diag([40.0, 30.0, 20.0, 10.0, 5.0, 3.0]), bend=1.0, c=-np.arange(1.0, N + 1))
    x, _, status = made.solved(start=-1.0)
    assert status == SOLVED
    assert made.residual(x) < 1e-12 * np.abs(made.M).max()
