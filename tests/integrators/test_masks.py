"""Masks, i.e. conditions on SIMD lanes: selection, functions lane by lane, and fixed-point iteration in lanes."""

from __future__ import annotations

import math
import operator
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from llvmlite import binding
from numba import njit

from phasebench.integrators.stepping.solve import FIXED_POINT_LIMIT, NOT_FINITE, SOLVED, solver
from phasebench.integrators.values import masks
from phasebench.integrators.values.lanes import Lanes, put, take
from phasebench.integrators.values.masks import broadcast_like, count, fails, number, retire_lanes, select, where
from phasebench.integrators.values.vector import TUPLES, jit
from support.marks import compiled

pytestmark = [pytest.mark.processor, compiled]
EPS = np.finfo(float).eps
WIDTH = 8
LIKE = (0.0,) * WIDTH
LEFT = np.array([1.0, 2.0, 3.0, np.nan, np.inf, -np.inf, 0.0, 2.0])
RIGHT = np.array([2.0, 2.0, 1.0, 1.0, np.inf, np.inf, -0.0, np.nan])
COMPARED = (operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne)


# -- conditions -------------------------------------------------------------------------------------------------------


@njit(**TUPLES)
def _compare(table, out, two):
    a, b = take(table, 0, LIKE), take(table, 1, LIKE)
    one, zero = broadcast_like(1.0, a), broadcast_like(0, a)
    k = 0
    for held in (a < b, a <= b, a > b, a >= b, a == b, a != b):
        put(out, k, select(held, one, zero), LIKE)
        k += 1
    for held in (a < 2, a <= two, 2.0 > a, a >= 2.0, a == 2, two != a):  # noqa: SIM300 (a number on the left)
        put(out, k, select(held, one, zero), LIKE)
        k += 1


def test_comparisons_of_lanes_with_lanes_and_numbers():
    out = np.empty((12, WIDTH))
    _compare(np.array([LEFT, RIGHT]), out, 2)
    with np.errstate(invalid="ignore"):
        assert out[:6].tolist() == [f(LEFT, RIGHT).tolist() for f in COMPARED]
        two = [LEFT < 2, LEFT <= 2, LEFT < 2, LEFT >= 2, LEFT == 2, LEFT != 2]
    assert out[6:].tolist() == np.array(two, float).tolist()


@njit(**TUPLES)
def _combine(table, out):
    x = take(table, 0, LIKE)
    one, zero = broadcast_like(1.0, x), broadcast_like(0.0, x)
    low, odd = x < 4, take(table, 1, LIKE) == 1
    for k, held in enumerate((low & odd, low | odd, ~low, ~low & ~odd)):
        put(out, k, select(held, one, zero), LIKE)
    return count(low), count(low & ~low), count(low | ~low), bool(x > 6), bool(x > 7), 1 if low & odd else 0


def test_masks_are_combined_and_counted():
    """A mask is true if it holds in any lane."""
    n, out = np.arange(8.0), np.empty((4, WIDTH))
    assert _combine(np.array([n, n % 2]), out) == (4, 0, 8, True, False, 1)
    low, odd = n < 4, n % 2 == 1
    assert out.tolist() == [[*map(float, held)] for held in (low & odd, low | odd, ~low, ~low & ~odd)]


@njit(**TUPLES)
def _choose(table, out):
    x, y = take(table, 0, LIKE), take(table, 1, LIKE)
    held = x < y
    pair = select(held, (x, 2 * x), (y, -y))
    put(out, 0, pair[0], LIKE)
    put(out, 1, pair[1], LIKE)
    put(out, 2, select(held, x, 7), LIKE)
    put(out, 3, select(held, 0.5, y), LIKE)
    put(out, 4, where(held, x, y), LIKE)
    kept, more = retire_lanes(x < 3, x < 2, (x, y))
    put(out, 5, kept[0], LIKE)
    put(out, 6, kept[1], LIKE)
    put(out, 7, select(fails(held), x, y), LIKE)
    return number(held), more


def test_select_works_lane_by_lane():
    x, y, out = np.arange(8.0), 7 - np.arange(8.0), np.empty((8, WIDTH))
    assert _choose(np.array([x, y]), out) == (4, True)
    held = x < y
    rows = [
        (x, y),
        (2 * x, -y),
        (x, 7),
        (0.5, y),
        (x, y),
    ]
    assert out[:5].tolist() == [np.where(held, a, b).tolist() for a, b in rows]
    lost = (x < 3) & ~(x < 2)
    for row, z in zip(out[5:7], (x, y), strict=True):
        np.testing.assert_array_equal(row, np.where(lost, np.nan, z))
    assert out[7].tolist() == np.where(held, y, x).tolist()


@njit(**TUPLES)
def _of_one(x, y):
    return where(x < y, x, y), number(x < y), fails(x < y), retire_lanes(True, False, x), retire_lanes(True, True, x)


def test_the_condition_of_a_single_orbit_is_a_bool():
    for f in (_of_one, _of_one.py_func):
        assert f(1.0, 2.0) == (1.0, 1, False, (1.0, False), (1.0, True))
        assert f(3.0, 2.0) == (2.0, 0, True, (3.0, False), (3.0, True))


def test_the_number_of_lanes_follows_from_the_processor(monkeypatch):
    """There are as many lanes as doubles in two of the processor's vector registers."""
    for features, doubles in (("+avx512f,+avx", 8), ("-avx512f,+avx", 4), ("+sse2,-avx", 2), ("", 2)):
        monkeypatch.setattr(masks.config, "CPU_FEATURES", features)
        assert masks._native() == doubles
    for features, doubles in (({"avx512f": True}, 8), ({"avx": True, "avx512f": False}, 4), ({"avx": False}, 2)):
        monkeypatch.setattr(masks.config, "CPU_FEATURES", None)
        monkeypatch.setattr(binding, "get_host_cpu_features", lambda features=features: features)
        assert masks._native() == doubles
    monkeypatch.undo()
    assert masks.LANES.n == 2 * masks._native()


# -- functions --------------------------------------------------------------------------------------------------------

BY_LANE = (math.tan, math.log, math.sinh, math.cosh, math.tanh, math.asin, math.acos, math.atan)


@njit(**TUPLES)
def _functions(table, out, n, a):
    x = take(table, 0, LIKE)
    put(out, 0, math.tan(x), LIKE)
    put(out, 1, math.log(x), LIKE)
    put(out, 2, math.sinh(x), LIKE)
    put(out, 3, math.cosh(x), LIKE)
    put(out, 4, math.tanh(x), LIKE)
    put(out, 5, math.asin(x), LIKE)
    put(out, 6, math.acos(x), LIKE)
    put(out, 7, math.atan(x), LIKE)
    put(out, 8, math.sin(x), LIKE)
    put(out, 9, math.cos(x), LIKE)
    put(out, 10, math.exp(x), LIKE)
    put(out, 11, math.sqrt(x), LIKE)
    put(out, 12, x**n, LIKE)
    put(out, 13, x**a, LIKE)


def test_functions_apply_to_each_lane():
    x, out = np.linspace(0.1, 0.9, WIDTH), np.empty((14, WIDTH))
    _functions(x[None], out, 3, -0.7)
    named = (*BY_LANE, math.sin, math.cos, math.exp, math.sqrt)
    for f, row in zip(named, out, strict=False):
        assert row == pytest.approx([f(a) for a in x], rel=4 * EPS), f
    assert out[12:] == pytest.approx(np.array([x**3, x**-0.7]), rel=4 * EPS)


def test_types_that_hold_lanes_are_recognized():
    lanes, double = Lanes(WIDTH), numba.float64
    for kind in (lanes, numba.types.UniTuple(lanes, 2), numba.types.Array(lanes, 2, "C")):
        assert masks.holds_lanes([double, kind])
    assert not masks.holds_lanes([double, numba.types.UniTuple(double, 2), numba.types.Array(double, 2, "C")])
    assert not masks.holds_lanes([])


# -- fixed-point iteration --------------------------------------------------------------------------------------------


class Line(NamedTuple):
    """The coefficients of the equation x = factor x + constant."""

    factor: Any
    constant: Any


@jit
def line(x, e):
    """Right-hand side of the equation: factor x + constant."""
    return (e.factor * x[0] + e.constant,)


@jit
def of_one(x, g, e):
    """The scales that the solver asks for, of the unknown and of its variable: both 1."""
    return 1.0, 1.0


@pytest.fixture(scope="module")
def solvers():
    """(scalar solver, solver in SIMD lanes) of x = factor x + constant.

    Each is a function (factor, constant, start, span) -> results.
    """
    solve, work = solver(line, of_one), np.zeros((4, 4))

    @njit(**TUPLES)
    def of_numbers(factor, constant, start, span, work):
        return solve(Line(factor, constant), (start,), span, EPS, work)

    @njit(**TUPLES)
    def of_rows(table, out, work):
        e = Line(take(table, 0, LIKE), take(table, 1, LIKE))
        (x,), evaluations, newton, status = solve(e, (take(table, 2, LIKE),), take(table, 3, LIKE), EPS, work)
        put(out, 0, x, LIKE)
        return evaluations, newton, status

    def in_lanes(factor, constant=0.7, start=0.0, span=1.0):
        rows = np.broadcast_arrays(np.zeros(WIDTH), factor, constant, start, span)[1:]
        out = np.empty((1, WIDTH))
        return out[0], of_rows(np.array(rows), out, work)

    return lambda *equation: of_numbers(*map(float, equation), work), in_lanes


FACTORS = [0.0, 1e-8, -1e-3, 0.1, 0.3, -0.2, 0.25, 1e-17]


def test_every_lane_stops_as_it_would_alone(solvers):
    """Solution and number of evaluations equal those of the scalar solver."""
    alone, in_lanes = solvers
    rng = np.random.default_rng(2)
    for factors in (FACTORS, rng.uniform(-0.3, 0.3, WIDTH), 10.0 ** rng.uniform(-12, -0.6, WIDTH)):
        for start, span in ((0.0, 1.0), (1.2, 1.0), (0.0, 1e6), (rng.normal(size=WIDTH), rng.uniform(0, 100, WIDTH))):
            x, (evaluations, newton, status) = in_lanes(factors, 0.7, start, span)
            both = zip(*np.broadcast_arrays(factors, 0.7, start, span), strict=True)
            found = [alone(*of) for of in both]
            assert {(a[2], a[3]) for a in found} == {(0, SOLVED)} == {(newton, status)}
            assert x.tolist() == [a[0][0] for a in found]
            assert evaluations == sum(a[1] for a in found)


@pytest.mark.parametrize(
    ("lane", "evaluations"),
    [
        ({"factor": 2.0}, 3),
        ({"factor": -1.0}, 3),
        ({"factor": 0.999}, FIXED_POINT_LIMIT),
        ({"constant": np.nan}, 1),
        ({"constant": np.inf}, 1),
        ({"start": np.nan}, 0),
    ],
)
def test_an_unsolvable_lane_is_nan_and_the_others_are_solved(solvers, lane, evaluations):
    _, in_lanes = solvers
    equation = {name: np.full(WIDTH, x) for name, x in {"factor": 0.1, "constant": 0.7, "start": 0.0}.items()}
    wanted, (each, _, _) = in_lanes(**equation)
    for name, x in lane.items():
        equation[name][3] = x
    found, (sum_, newton, status) = in_lanes(**equation)
    assert np.isnan(found[3]) or lane == {"constant": np.inf}
    assert not np.isfinite(found[3])
    assert np.delete(found, 3).tolist() == np.delete(wanted, 3).tolist()
    assert (sum_, newton, status) == (each // WIDTH * (WIDTH - 1) + evaluations, 0, SOLVED)
    assert in_lanes(**{"factor": 0.1} | lane)[1] == (WIDTH * evaluations, 0, NOT_FINITE)


def test_slowly_falling_changes_are_iterated_to_the_end(solvers):
    """The iterates are 1, 1 + 1/2, 1 + 1/2 + 1/4, ..."""
    alone, in_lanes = solvers
    x, (evaluations, _, _) = in_lanes(0.5, 1.0)
    assert x.tolist() == [2.0] * WIDTH
    assert alone(0.5, 1.0, 0.0, 1.0) == ((2.0,), evaluations // WIDTH, 0, SOLVED)
    assert evaluations // WIDTH > FIXED_POINT_LIMIT


def test_changes_that_stagnate_are_accepted_up_to_64_units(solvers):
    """The iteration x -> 2 + 128 eps - x from 1 alternates by 128 eps."""
    alone, in_lanes = solvers
    x, (evaluations, _, _) = in_lanes(-1.0, 2 + 128 * EPS, 1.0, 1.0)
    assert x.tolist() == [1.0] * WIDTH
    assert alone(-1.0, 2 + 128 * EPS, 1.0, 1.0) == ((1.0,), evaluations // WIDTH, 0, SOLVED)
    assert evaluations == 2 * WIDTH


def test_a_stopped_lane_is_left_unchanged(solvers):
    _, in_lanes = solvers
    spans = np.full(WIDTH, 1.0)
    spans[[1, 4]] = np.inf, np.nan
    start = np.full(WIDTH, 0.25)
    start[6] = np.inf
    found, (evaluations, _, status) = in_lanes(0.0, 0.7, start, spans)
    assert found.tolist() == [0.7, 0.25, 0.7, 0.7, 0.25, 0.7, np.inf, 0.7]
    assert (evaluations, status) == (5 * 2, SOLVED)
    assert in_lanes(0.0, 0.7, 0.25, np.inf)[1] == (0, 0, NOT_FINITE)
    assert in_lanes(0.0, 0.7, np.inf, 1.0)[1] == (0, 0, NOT_FINITE)
