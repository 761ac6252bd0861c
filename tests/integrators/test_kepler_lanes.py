"""The Kepler flow of bodies in SIMD lanes against the scalar one, which is tested against 40 digits."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp
from numba import njit

from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.families import planet_lanes, planet_pairs
from phasebench.integrators.stepping import kepler_flow
from phasebench.integrators.stepping.kernel import array
from phasebench.integrators.values.vector import TUPLES

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
    r = np.sqrt((q**2).sum(1))
    return (v**2).sum(1) / 2 - 1 / r, np.linalg.norm(np.cross(q, v), axis=1)


ANOMALIES = np.linspace(-3, 3, LANES)


@pytest.mark.parametrize(
    ("e", "h"), [(0.0, 1e-9), (0.05, 0.3), (0.6, 1e-9), (0.6, -0.3), (0.99, 0.3), (0.2, 6.0), (1.5, 1.2), (1.5, -0.01)]
)
def test_a_lane_equals_the_scalar_solver_to_round_off(e, h):
    """Increments and compensations, up to the effect of a few units of round-off in the state or time."""
    q, v = orbits(e, ANOMALIES)
    found, wanted = flow(q, v, h), alone(q, v, h)
    near = [alone(q * (1 + 4 * EPS), v, h), alone(q, v * (1 + 4 * EPS), h), alone(q, v, h * (1 + 4 * EPS))]
    for i, start in enumerate((q, v)):
        moved = wanted[i] - start
        felt = sum(np.abs(n[i] - wanted[i]).max(1) for n in near) + EPS * np.abs(wanted[i]).max(1)
        error = np.abs(found[i] - wanted[i] + (found[i + 2] - wanted[i + 2])).max(1)
        assert (error <= 8 * (felt + EPS * np.abs(moved).max(1))).all()
    other = flow(q, v, h * (1 + 1e-6))
    assert np.abs(other[0] - wanted[0]).max() > 1e-8 * abs(h), "the control: another time"


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


def test_energy_and_angular_momentum_walk_at_random():
    """200,000 steps: the mean error over the bodies, a trend, is not significant against its spread."""
    e, h, steps = 0.2, 0.31, 200_000
    q, v = orbits(e, ANOMALIES)
    end = flow(q, v, h, steps)
    for before, after in zip(energy_and_momentum(q, v), energy_and_momentum(end[0], end[1]), strict=True):
        error = after / before - 1
        assert abs(error.mean()) < 6 * error.std() / LANES**0.5
        assert np.abs(error).max() < 2 * EPS * steps**0.5
