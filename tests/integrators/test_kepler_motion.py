"""Parts of the Kepler flow in SIMD lanes: the reverted series, square roots, the motion over one step."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
from numba import njit

from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.stepping import kepler_flow, kepler_lanes
from phasebench.integrators.stepping.kernel import array
from phasebench.integrators.values.lanes import put, take
from phasebench.integrators.values.masks import select
from phasebench.integrators.values.vector import TUPLES, inline
from support.marks import compiled

EPS = float(np.finfo(float).eps)
W = 8
LIKE = (0.0,) * W
TABLE = array(kepler_flow.constants(DOUBLE), DOUBLE)


# -- numbers ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("second", "third", "beta"), [(0.7, -0.4, 0.9), (-1.1, 0.8, -0.5), (0.3, 1.5, 2.0)])
def test_the_reverted_series_has_order_five(second, third, beta):
    """The error of x/delta - 1 is of order delta^5."""
    errors = []
    for delta in (0.04, 0.02, 0.01):
        with mpmath.workdps(30):
            F = [-delta, 1, second / 2, third / 6, -beta * second / 24, -beta * third / 120]
            root = mpmath.findroot(lambda x, F=F: mpmath.polyval(F[::-1], x), delta)
            errors.append(float(kepler_lanes._reversion(delta, second, third, beta) - (root / delta - 1)))
    assert abs(errors[0]) < 1e-6
    for a, b in pairwise(errors):
        assert a / b == pytest.approx(32, rel=0.25)


def test_reciprocals_as_sums_of_two_doubles():
    for n in (3, 10, 7**20):
        high, low = kepler_lanes._reciprocal(n)
        assert high == 1 / n
        with mpmath.workdps(50):
            assert abs(mpmath.mpf(high) + mpmath.mpf(low) - mpmath.mpf(1) / n) < EPS**2 / n


# -- lanes ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def lanes():
    """Functions of `kepler_lanes` compiled to act on rows of arrays: ``root``, ``motion``, ``in_one``.

    ``in_one`` is the motion with a single evaluation of the Stumpff functions.
    """

    @njit(**TUPLES)
    def root(rows, out):
        r, inverse = kepler_lanes.root(take(rows, 0, LIKE), take(rows, 1, LIKE))
        put(out, 0, r, LIKE)
        put(out, 1, inverse, LIKE)

    @njit(**TUPLES)
    def motion(rows, out, h, memory):
        r0, inverse, eta = take(rows, 0, LIKE), take(rows, 1, LIKE), take(rows, 2, LIKE)
        m = kepler_lanes.motion(
            r0, inverse, eta, take(rows, 3, LIKE), take(rows, 4, LIKE), h, EPS, TABLE, memory, 1, LIKE
        )
        keep(m, out)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kepler_lanes, "EVALUATIONS", 1)
        once = inline(kepler_lanes.motion_in_lanes.py_func)

        @njit(**TUPLES)
        def in_one(rows, out, h):
            r0, inverse, eta = take(rows, 0, LIKE), take(rows, 1, LIKE), take(rows, 2, LIKE)
            keep(once(r0, inverse, eta, take(rows, 3, LIKE), take(rows, 4, LIKE), h, EPS), out)

        in_one(np.ones((5, W)), np.empty((6, W)), 0.1)
    return SimpleNamespace(root=root, motion=motion, in_one=in_one)


@njit(**TUPLES)
def keep(m, out):
    """Write f - 1, g, f', g' - 1 and 1/r of a motion into rows 0 to 3 and 5; row 4 is 1 in unsolved lanes."""
    put(out, 0, m.f, LIKE)
    put(out, 1, m.g, LIKE)
    put(out, 2, m.df, LIKE)
    put(out, 3, m.dg, LIKE)
    put(out, 4, select(m.unsolved, 1.0 + 0 * m.f, 0 * m.f), LIKE)
    put(out, 5, m.inverse, LIKE)


@compiled
def test_a_square_root_and_its_inverse_from_a_guess(lanes):
    """One iteration from a guess that is off by 1e-3 or 1e-9."""
    square = np.random.default_rng(0).uniform(0.01, 100, W)
    exact = np.sqrt(square)
    for off, error in ((1e-3, 2e-6), (1e-9, EPS)):
        out = np.empty((2, W))
        lanes.root(np.array([square, (1 + off) / exact]), out)
        assert np.abs(out[0] / exact - 1).max() <= error**2 + 2 * EPS
        assert np.abs(out[1] * exact - 1).max() <= error + 2 * EPS
        assert off < 1e-6 or np.abs(out[1] * exact - 1).max() > error / 3


def starts(e, mu=2.5, a=1.7):
    """(rows (r0, 1/r0, eta, beta, mu) of bodies at eight places of a Kepler orbit, unit of time).

    r0: distance; eta: q . v; beta: twice the negative energy of the orbit; mu: gravitational parameter.
    """
    E = np.linspace(-2.8, 3.1, W)
    r, n = a * (1 - e * np.cos(E)), (mu / a**3) ** 0.5
    eta = n * a * a * e * np.sin(E)
    return np.array([r, 1 / r, eta, np.full(W, mu / a), np.full(W, mu)]), 1 / n


def alone(rows, h):
    """(f - 1, g, f', g' - 1) of each body over the time h, by the scalar `kepler_flow`."""
    return np.array([kepler_flow.coefficients(r, eta, beta, mu, h, EPS, TABLE)[:4] for r, _, eta, beta, mu in rows.T]).T


@compiled
@pytest.mark.processor
@pytest.mark.parametrize("e", [0.0, 0.2, 0.6])
@pytest.mark.parametrize("h", [1e-9, 0.02, 0.3, -0.3, 1.0])
def test_a_motion_equals_the_scalar_solver(lanes, e, h):
    """To round-off if solved in lanes, bit by bit if left to the scalar solver."""
    rows, unit = starts(e)
    memory, out = np.full((7, W), 5.0), np.empty((6, W))
    lanes.motion(rows, out, h * unit, memory)
    wanted, left = alone(rows, h * unit), out[4] == 1
    np.testing.assert_allclose(out[:4, ~left], wanted[:, ~left], rtol=3e-15 if abs(h) < 1 else 2e-14, atol=0)
    np.testing.assert_array_equal(out[:4, left], wanted[:, left])
    assert not left.any() or (e, abs(h)) in ((0.2, 1.0), (0.6, 0.3), (0.6, 1.0))
    assert (memory[[0, 6]] == 5).all()
    assert (memory == 5).all() or left.any()
    # The new distance, the length of (1 + f) q + g v, is 1/inverse.
    r, _, eta, beta, mu = rows
    v2 = 2 * mu / r - beta
    f, g = 1 + wanted[0], wanted[1]
    distance = np.sqrt(f * f * r * r + 2 * f * g * eta + g * g * v2)
    assert np.abs(out[5] * distance - 1)[~left].max(initial=0.0) < 1e-14


@compiled
def test_long_steps_are_left_to_the_scalar_solver(lanes):
    rows, unit = starts(0.0)
    for h, expected in ((3.1, False), (3.14, True), (4.0, True), (9.0, True), (-3.14, True)):
        out = np.empty((6, W))
        lanes.motion(rows, out, h * unit, np.empty((7, W)))
        assert ((out[4] == 1) == expected).all(), h
        np.testing.assert_allclose(out[:4], alone(rows, h * unit), rtol=1e-12, atol=1e-14)


@compiled
def test_a_free_body_keeps_its_velocity(lanes):
    rows, unit = starts(0.2)
    rows[:, 3] = 1.0, 1.0, 0.0, 0.0, 0.0
    for h in (0.3, 4.0):
        out = np.empty((6, W))
        lanes.motion(rows, out, h * unit, np.empty((7, W)))
        assert out[:4, 3].tolist() == [0.0, h * unit, 0.0, 0.0]


@compiled
@pytest.mark.parametrize(
    ("e", "h", "error", "left"),
    [(0.2, 0.5, 3e-15, 0), (0.2, 0.7, 3e-15, 2), (0.2, 1.2, 1e-13, 6), (0.5, 0.4, 1e-12, 3), (0.5, 0.6, 3e-7, 3)],
)
def test_the_accuracy_of_one_evaluation(lanes, e, h, error, left):
    """The start has an error of order h^6, its correction one of the sixth power of that.

    The number of lanes in which one evaluation may not suffice is checked too.
    """
    rows, unit = starts(e)
    out = np.empty((6, W))
    lanes.in_one(rows, out, h * unit)
    assert np.abs(out[:4] / alone(rows, h * unit) - 1).max() < error
    assert out[4].sum() == left
