"""The Kepler solver against closed-form solutions, and in double precision against 40 digits.

At a given anomaly of an ellipse, parabola or hyperbola (a = 1, or pericentre distance 1/2; mu = 1) state and time are
known without solving an equation. ``python test_kepler_flow.py`` prints what a process with NUMBA_DISABLE_JIT=1
measures.
"""

from __future__ import annotations

import json
from fractions import Fraction
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
import sympy as sp
from numba import njit

from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, precision, to_number, vector
from phasebench.integrators.families import planet_lanes, planet_pairs
from phasebench.integrators.stepping import kepler_flow
from phasebench.integrators.stepping.kernel import array
from phasebench.integrators.values.vector import TUPLES

EPS = np.finfo(float).eps
DIGITS = 40
ECCENTRICITIES = (0.0, 0.2, 0.6, 0.9, 0.99, 0.999, 1.0, 1.5, 3.0)
#: Initial anomalies, and changes of the anomaly: tiny, of a step, long, backwards.
ANOMALIES = (0.0, 1.0, -2.5, 3.0)
CHANGES = (1e-9, 1e-3, 0.3, 2.5, 6.0, -1e-4, -4.0)
CASES = [(e, a, d) for e in ECCENTRICITIES for a in ANOMALIES for d in CHANGES]
TABLE = array(kepler_flow.constants(DOUBLE), DOUBLE)


def on_orbit(e, A, mp=mpmath):
    """(q, v, t) in the plane at anomaly A (eccentric, parabolic or hyperbolic) of an orbit with eccentricity e."""
    if e < 1:
        s, c, b, r = mp.sin(A), mp.cos(A), mp.sqrt(1 - e * e), 1 - e * mp.cos(A)
        return [c - e, b * s], [-s / r, b * c / r], A - e * s
    if e == 1:
        r = (1 + A * A) / 2
        return [(1 - A * A) / 2, A], [-A / r, 1 / r], (A + A**3 / 3) / 2
    s, c, b = mp.sinh(A), mp.cosh(A), mp.sqrt(e * e - 1)
    r = e * c - 1
    return [e - c, b * s], [-s / r, b * c / r], e * s - A


def flow(q, v, h, arithmetic=DOUBLE, mu=1, mass=1, spoil=None):
    """The Kepler solver's state after the time h: rows q, p = mass v, and the compensations of both.

    ``spoil`` may change the table of constants (control).
    """
    table = array(kepler_flow.constants(arithmetic), arithmetic)
    if spoil is not None:
        spoil(table)
    X = array([q, [mass * x for x in v], [0] * len(q), [0] * len(q)], arithmetic)
    eps = mpmath.mp.eps if arithmetic == MULTIPRECISION else EPS
    numbers = (to_number(x, arithmetic) for x in (mass, mu, h, eps))
    kepler_flow.advance(X, 0, len(q), *numbers, table)
    return X


def doubles(e, A, change):
    """(q, v, h) rounded to double: the state at anomaly A of an orbit, and the time in which A grows by ``change``."""
    with mpmath.workdps(DIGITS):
        q, v, t = on_orbit(mpmath.mpf(e), mpmath.mpf(A))
        h = on_orbit(mpmath.mpf(e), mpmath.mpf(A) + mpmath.mpf(change))[2] - t
        return [float(x) for x in q], [float(x) for x in v], float(h)


def measured_in_40_digits():
    """For each case: relative error at 40 digits, exact increments from double data, their condition numbers."""
    out = []
    for e, A, change in CASES:
        q, v, t = on_orbit(mpmath.mpf(e), mpmath.mpf(A))
        end, velocity, later = on_orbit(mpmath.mpf(e), mpmath.mpf(A) + mpmath.mpf(change))
        X = flow(q, v, later - t, MULTIPRECISION)
        size = max(abs(x) for x in vector([*end, *velocity, *q, *v]))
        error = max(abs(a - b) for a, b in zip((*X[0], *X[1]), vector([*end, *velocity]), strict=True)) / size

        q, v, h = doubles(e, A, change)
        small = to_number(Fraction(1, 10**20), MULTIPRECISION)
        Y = flow(q, v, h, MULTIPRECISION)
        near = [flow([x * (1 + small) for x in q], v, h, MULTIPRECISION), flow(q, v, h * (1 + small), MULTIPRECISION)]
        near.append(flow(q, [x * (1 + small) for x in v], h, MULTIPRECISION))
        magnified = [max(abs(N[i] - Y[i]).max() for N in near) / small for i in (0, 1)]
        increments = [mpmath.nstr(mpmath.mpf(Y[i, k] - (q, v)[i][k]), 25) for i in (0, 1) for k in (0, 1)]
        out.append([float(error), increments, [float(m) for m in magnified]])
    return out


@pytest.fixture(scope="module")
def exact(uncompiled):
    """{(e, anomaly, change of anomaly): [error, exact increments, condition numbers]} at 40 digits."""
    return dict(zip(CASES, uncompiled("integrators/test_kepler_flow.py"), strict=True))


def test_the_solver_is_exact_to_40_digits(exact):
    """Near the pericentre for e = 0.999 speeds change by a factor of 1000, which costs digits of any method."""
    for case, (error, _, _) in exact.items():
        assert error < 1e-33, case


def worst(exact, e, spoil=None):
    """Largest error of increments, in units of the effect of rounded data, over the cases with eccentricity e."""
    ratios = []
    for case in [c for c in CASES if c[0] == e]:
        _, increments, magnified = exact[case]
        q, v, h = doubles(*case)
        X = flow(q, v, h, spoil=spoil)
        with mpmath.workdps(DIGITS):
            wanted = [mpmath.mpf(x) for x in increments]
            found = [mpmath.mpf(X[i, k]) - (q, v)[i][k] + mpmath.mpf(X[i + 2, k]) for i in (0, 1) for k in (0, 1)]
            error = [float(abs(a - b)) for a, b in zip(found, wanted, strict=True)]
        ratios += [max(error[2 * i : 2 * i + 2]) / (EPS * magnified[i]) for i in (0, 1)]
    return max(ratios)


def test_errors_in_doubles_are_those_of_rounded_data(exact):
    """Except that on a hyperbola followed inwards and outwards the terms of Kepler's equation partly cancel."""
    assert all(worst(exact, e) < (8 if e <= 1 else 128) for e in ECCENTRICITIES)

    def spoil(table):
        table[kepler_flow.SERIES_3, 2] *= 1 + 1e-8

    assert all(worst(exact, e, spoil) > 300 for e in (0.0, 0.6, 1.5)), "the control: a coefficient's 8th digit"


@pytest.mark.parametrize(("e", "periods"), [(0.0, 1), (0.6, -1), (0.99, 1000), (0.6, 123456)])
def test_whole_periods_return(e, periods):
    q, v, _ = doubles(e, 0.7, 1.0)
    beta = 2 / np.hypot(*q) - np.dot(v, v)
    h = 2 * np.pi * periods / beta**1.5
    X = flow(q, v, h)
    # h and beta have a relative error eps, so the phase has eps times the number of periods.
    assert np.abs(X[:2] - [q, v]).max() < 8 * EPS * 2 * np.pi * abs(periods) * 5
    assert np.abs(flow(q, v, h * (1 + 1e-3 / periods))[:2] - [q, v]).max() > 1e-4, "the control: another time"


def test_scaling_by_mass_mu_and_rotation():
    q, v, h = doubles(0.6, 1.0, 2.0)
    X = flow(q, v, h)
    heavy = flow(q, [2 * x for x in v], h / 2, mu=4, mass=8)
    assert np.array_equal(heavy[0], X[0])
    assert np.array_equal(heavy[1], 16 * X[1])
    R = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0][:, :2]
    turned = flow(R @ q, R @ v, h)
    assert np.abs(turned[:2] - X[:2] @ R.T).max() < 1e-14
    free = flow(q, v, h, mu=0)
    assert free[0] + free[2] == pytest.approx(np.array(q) + h * np.array(v), rel=1e-15, abs=0)
    assert np.array_equal(free[1], v)


# -- bodies in SIMD lanes ----------------------------------------------------------------------------------------------


LANES = 8


@njit(**TUPLES)
def _advance(step, h, memory):
    at = planet_lanes._add_distances(step, planet_lanes._read_state(memory, step.like).y)
    planet_lanes._save(memory, planet_lanes._drift(step, at, h, memory), step.like)


def step_of(mu, mass):
    """The step of the Wisdom-Holman kernel in lanes, without an interaction: bodies with these mu and masses."""
    part = SimpleNamespace(mu=[sp.Rational(x) for x in mu], masses=[sp.Rational(x) for x in mass])
    empty = np.zeros((0, LANES))
    like = (0.0,) * LANES
    parts = array(planet_pairs._of_bodies(part, LANES), DOUBLE)
    return planet_lanes.Planets(empty, empty, like, (0.0,) * len(mu), empty, parts, empty, TABLE, 0.0, EPS)


def in_lanes(q, v, h, mu=None, mass=None):
    """(q, v, compensation of each), arrays (n, 3), of bodies after a step of length h."""
    n = len(q)
    mu, mass = np.ones(n) if mu is None else mu, np.ones(n) if mass is None else mass
    memory = np.zeros((planet_lanes.ROWS, LANES))
    memory[:3, :n], memory[3:6, :n] = q.T, (mass[:, None] * v).T
    _advance(step_of(mu, mass), float(h), memory)
    found = [memory[3 * i : 3 * i + 3, :n].T for i in range(4)]
    assert not memory[:6, n:].any(), "a lane without a body moves"
    return found[0], found[1] / mass[:, None], found[2], found[3] / mass[:, None]


def alone(q, v, h):
    """(q, v, compensation of each), arrays (n, 3), of bodies after a step of length h, by the scalar `kepler_flow`."""
    X = [np.array([a, b, 0 * a, 0 * a]) for a, b in zip(q, v, strict=True)]
    for x in X:
        kepler_flow.advance(x, 0, 3, 1.0, 1.0, h, EPS, TABLE)
    return tuple(np.array([x[i] for x in X]) for i in range(4))


def orbits(e, anomalies):
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0][:, :2]
    states = [on_orbit(e, float(A)) for A in anomalies]
    return (np.array([state[i] for state in states], float) @ turn.T for i in (0, 1))


ALL_ROUND = np.linspace(-3, 3, LANES)


@pytest.mark.parametrize(
    ("e", "h"), [(0.0, 1e-9), (0.05, 0.3), (0.6, 1e-9), (0.6, -0.3), (0.99, 0.3), (0.2, 6.0), (1.5, 1.2), (1.5, -0.01)]
)
def test_a_lane_equals_the_scalar_solver_to_round_off(e, h):
    """Increments and compensations, up to the effect of a few units of round-off in the state or time."""
    q, v = orbits(e, ALL_ROUND)
    found, wanted = in_lanes(q, v, h), alone(q, v, h)
    near = [alone(q * (1 + 4 * EPS), v, h), alone(q, v * (1 + 4 * EPS), h), alone(q, v, h * (1 + 4 * EPS))]
    for i, start in enumerate((q, v)):
        moved = wanted[i] - start
        felt = sum(np.abs(n[i] - wanted[i]).max(1) for n in near) + EPS * np.abs(wanted[i]).max(1)
        error = np.abs(found[i] - wanted[i] + (found[i + 2] - wanted[i + 2])).max(1)
        assert (error <= 8 * (felt + EPS * np.abs(moved).max(1))).all()
    other = in_lanes(q, v, h * (1 + 1e-6))
    assert np.abs(other[0] - wanted[0]).max() > 1e-8 * abs(h), "the control: another time"


def test_free_bodies_and_masses():
    q, v = orbits(0.2, ALL_ROUND[:4])
    mu, mass = np.array([0.0, 1.0, 4.0, 1.0]), np.array([2.0, 1.0, 1.0, 8.0])  # powers of two keep momenta exact
    q[0] = 0  # a body at the origin
    found = in_lanes(q, v, 0.3, mu=mu, mass=mass)
    assert found[0][0] == pytest.approx(0.3 * v[0], rel=1e-15, abs=0)
    assert np.array_equal(found[1][0], v[0])
    wanted = alone(q[1:], v[1:], 0.3)
    assert np.abs(found[0][[1, 3]] - wanted[0][[0, 2]]).max() < 4 * EPS
    assert np.abs(found[0][2] - wanted[0][1]).max() > 1e-3, "the control: another mu"


if __name__ == "__main__":
    with precision(DIGITS):
        print(json.dumps({"result": measured_in_40_digits()}))
