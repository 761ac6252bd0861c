"""The Kepler flow of bodies in SIMD lanes against the scalar one, which is tested against 40 digits."""

from __future__ import annotations

from math import factorial
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
import sympy as sp
from numba import njit

from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.families import planet_lanes, planet_pairs
from phasebench.integrators.stepping import kepler_flow, kepler_lanes
from phasebench.integrators.stepping.kernel import array
from phasebench.integrators.values.lanes import put, take
from phasebench.integrators.values.vector import TUPLES
from support.marks import compiled

EPS = np.finfo(float).eps
LANES = 8
TABLE = array(kepler_flow.constants(DOUBLE), DOUBLE)


@njit(**TUPLES)
def _advance(step, h, steps, memory):
    at = planet_lanes._add_distances(step, planet_lanes._read_state(memory, step.like).y)
    for _ in range(steps):
        at = planet_lanes._drift(step, at, h, memory)
    planet_lanes._save(memory, at, step.like)


def step_of(mu, mass):
    """The step of the Wisdom-Holman kernel in lanes, without an interaction: bodies with these mu and masses."""
    part = SimpleNamespace(mu=[sp.Rational(x) for x in mu], masses=[sp.Rational(x) for x in mass])
    empty = np.zeros((0, LANES))
    like = (0.0,) * LANES
    parts = array(planet_pairs._of_bodies(part, LANES), DOUBLE)
    return planet_lanes.Planets(empty, empty, like, (0.0,) * len(mu), empty, parts, empty, TABLE, 0.0, EPS)


def flow(q, v, h, steps=1, mu=None, mass=None):
    """(q, v, compensation of each), arrays (n, 3), of bodies after steps of length h."""
    n = len(q)
    mu, mass = np.ones(n) if mu is None else mu, np.ones(n) if mass is None else mass
    memory = np.zeros((planet_lanes.ROWS, LANES))
    memory[:3, :n], memory[3:6, :n] = q.T, (mass[:, None] * v).T
    _advance(step_of(mu, mass), float(h), steps, memory)
    found = [memory[3 * i : 3 * i + 3, :n].T for i in range(4)]
    assert not memory[:6, n:].any(), "a lane without a body moves"
    return found[0], found[1] / mass[:, None], found[2], found[3] / mass[:, None]


def alone(q, v, h, steps=1):
    """(q, v, compensation of each), arrays (n, 3), of bodies after steps of length h, by the scalar `kepler_flow`."""
    X = [np.array([a, b, 0 * a, 0 * a]) for a, b in zip(q, v, strict=True)]
    for _ in range(steps):
        for x in X:
            kepler_flow.advance(x, 0, 3, 1.0, 1.0, h, EPS, TABLE)
    return tuple(np.array([x[i] for x in X]) for i in range(4))


def orbits(e, anomalies):
    """(q, v) at some anomalies of orbits with mu = a = 1, rotated in space."""
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0][:, :2]
    A = np.asarray(anomalies, float)
    if e < 1:
        b, r = np.sqrt(1 - e * e), 1 - e * np.cos(A)
        q, v = np.array([np.cos(A) - e, b * np.sin(A)]), np.array([-np.sin(A) / r, b * np.cos(A) / r])
    else:
        b, r = np.sqrt(e * e - 1), e * np.cosh(A) - 1
        q, v = np.array([e - np.cosh(A), b * np.sinh(A)]), np.array([-np.sinh(A) / r, b * np.cosh(A) / r])
    return q.T @ turn.T, v.T @ turn.T


def energy_and_momentum(q, v):
    """(energy, angular momentum) of each body on its Kepler orbit."""
    r = np.sqrt((q**2).sum(1))
    return (v**2).sum(1) / 2 - 1 / r, np.linalg.norm(np.cross(q, v), axis=1)


ANOMALIES = np.linspace(-3, 3, LANES)
#: Eccentricities and steps: short, ordinary, too long for lanes near the pericentre, about a period.
CASES = [(e, h) for e in (0.0, 0.05, 0.6, 0.99, 1.5) for h in (1e-9, 0.01, 0.3, 1.2, 6.0)]


@pytest.mark.parametrize(("e", "h"), CASES)
@pytest.mark.parametrize("sign", [1, -1])
def test_a_lane_equals_the_scalar_solver_to_round_off(e, h, sign):
    """Increments and compensations, up to the effect of a few units of round-off in the state or time."""
    q, v = orbits(e, ANOMALIES)
    found, wanted = flow(q, v, sign * h), alone(q, v, sign * h)
    near = [alone(q * (1 + 4 * EPS), v, sign * h), alone(q, v * (1 + 4 * EPS), sign * h)]
    near += [alone(q, v, sign * h * (1 + 4 * EPS))]
    for i, start in enumerate((q, v)):
        moved = wanted[i] - start
        felt = sum(np.abs(n[i] - wanted[i]).max(1) for n in near) + EPS * np.abs(wanted[i]).max(1)
        error = np.abs(found[i] - wanted[i] + (found[i + 2] - wanted[i + 2])).max(1)
        assert (error <= 8 * (felt + EPS * np.abs(moved).max(1))).all()
    other = flow(q, v, sign * h * (1 + 1e-6))
    assert np.abs(other[0] - wanted[0]).max() > 1e-8 * h, "the control: another time"


def test_increments_of_tiny_steps_are_relatively_exact():
    q, v = orbits(0.6, ANOMALIES)
    found, wanted = flow(q, v, 1e-9), alone(q, v, 1e-9)
    for i, start in enumerate((q, v)):
        moved, expected = (x[i] - start + x[i + 2] for x in (found, wanted))
        assert moved == pytest.approx(expected, rel=1e-14, abs=0)


def test_a_lane_does_not_depend_on_its_neighbours():
    """As long as all take equally many evaluations; leaving one body to the scalar solver changes the others little."""
    q, v = orbits(0.05, ANOMALIES)
    one = flow(q, v, 0.3)
    q[3], v[3] = (x[0] for x in orbits(0.99, [0.0]))
    other = flow(q, v, 0.3)
    for a, b in zip(one, other, strict=True):
        assert np.abs(np.delete(a - b, 3, 0)).max() <= 8 * EPS
    wanted = alone(q, v, 0.3)
    assert np.abs(other[0][3] - wanted[0][3]).max() < 1e-12


@pytest.mark.parametrize("e", [0.0, 0.6, 0.99, 1.5])
def test_backwards_is_the_mirror_image(e):
    """(q, v, h) and (q, -v, -h) use the same arithmetic; going forth and back returns."""
    q, v = orbits(e, ANOMALIES)
    forth, mirrored = flow(q, v, 0.3), flow(q, -v, -0.3)
    assert np.array_equal(forth[0], mirrored[0])
    assert np.array_equal(forth[1], -mirrored[1])
    back = flow(forth[0], forth[1], -0.3)
    assert np.abs(back[0] - q).max() < (1e-13 if e < 0.9 else 1e-9)


def test_free_bodies_and_masses():
    q, v = orbits(0.2, ANOMALIES[:4])
    mu, mass = np.array([0.0, 1.0, 4.0, 1.0]), np.array([2.0, 1.0, 1.0, 8.0])  # powers of two keep momenta exact
    q[0] = 0  # a body at the origin
    found = flow(q, v, 0.3, mu=mu, mass=mass)
    assert found[0][0] == pytest.approx(0.3 * v[0], rel=1e-15, abs=0)
    assert np.array_equal(found[1][0], v[0])
    wanted = alone(q[1:], v[1:], 0.3)
    assert np.abs(found[0][[1, 3]] - wanted[0][[0, 2]]).max() < 4 * EPS
    assert np.abs(found[0][2] - wanted[0][1]).max() > 1e-3, "the control: another mu"


@pytest.mark.parametrize(("e", "h"), [(0.05, 0.05), (0.05, 0.31), (0.2, 0.31)])
def test_energy_and_angular_momentum_walk_at_random(e, h):
    """200,000 steps: the mean error over the bodies, a trend, is not significant against its spread."""
    steps = 200_000
    q, v = orbits(e, ANOMALIES)
    end = flow(q, v, h, steps)
    for before, after in zip(energy_and_momentum(q, v), energy_and_momentum(end[0], end[1]), strict=True):
        error = after / before - 1
        assert abs(error.mean()) < 6 * error.std() / LANES**0.5
        assert np.abs(error).max() < 2 * EPS * steps**0.5


def taylor(k, x):
    """Stumpff function c_k of an array of long doubles by its Taylor series."""
    total = term = np.ones_like(x) / np.longdouble(factorial(k))
    for n in range(1, 25):
        term = -term * x / ((2 * n + k) * (2 * n + k - 1))
        total = total + term
    return total


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="long double is double here")
@pytest.mark.parametrize(("low", "high"), [(-1.5, -0.1), (0.05, 0.1), (0.7, 0.9), (1.2, 1.69), (1.71, 2.4), (2.5, 6.0)])
def test_stumpff_functions_have_no_bias(low, high):
    """The mean error is below 1/300 of round-off; a larger one would cause an energy drift beyond the random walk."""
    n = 20_000
    x = np.random.default_rng(1).uniform(low, high, (n, LANES))
    found = np.zeros((4 * n, LANES))
    _stumpff(x, found, (0.0,) * LANES)
    for k in (1, 2, 3):
        exact = taylor(k, x.astype(np.longdouble))
        error = (found[k::4] / exact - 1).astype(float)
        assert np.abs(error).max() < 6 * EPS
        assert abs(error.mean()) < EPS / 300, k


@compiled
@pytest.mark.processor
def test_stumpff_functions_are_exact_to_round_off():
    x = np.concatenate([np.linspace(-1.69, 1.69, 24), np.linspace(-6, 9.8, 32)]).reshape(-1, LANES)
    found = np.empty((4 * len(x), LANES))
    _stumpff(x, found, (0.0,) * LANES)
    with mpmath.workdps(40):
        for k in range(4):
            exact = [[mpmath.nsum(lambda n, y=y, k=k: (-mpmath.mpf(y)) ** n / mpmath.factorial(2 * n + k), [0, 40])
                      for y in row] for row in x]  # fmt: skip
            wrong = np.array([[float(a - b) for a, b in zip(*rows, strict=True)]
                              for rows in zip(found[k::4], exact, strict=True)])  # fmt: skip
            assert np.abs(wrong[:3]).max() < 2 * EPS, k
            assert np.abs(wrong).max() < 12 * EPS * (np.cosh(6**0.5) if k < 2 else 1), k


@njit(**TUPLES)
def _stumpff(table, found, like):
    for i in range(len(table)):
        c0, c1, c2, c3 = kepler_lanes.stumpff(take(table, i, like))
        put(found, 4 * i, c0, like)
        put(found, 4 * i + 1, c1, like)
        put(found, 4 * i + 2, c2, like)
        put(found, 4 * i + 3, c3, like)


def test_the_series_coefficients_are_exact():
    for k, (first, second, more) in {2: kepler_lanes._series(2), 3: kepler_lanes._series(3)}.items():
        for n, c in enumerate((first, second, *more)):
            assert int(c) * factorial(2 * n + k) == factorial(2 * kepler_lanes.TERMS + k)
