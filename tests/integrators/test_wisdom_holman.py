"""Wisdom-Holman splittings and flow-composed Runge-Kutta methods: Kepler's flow, its parts, bodies in lanes."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.problems import problem
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families import planet_pairs
from phasebench.integrators.families.wisdom_holman import KeplerPart, corrector, jacobi
from phasebench.integrators.stepping import kepler_flow, kepler_tangent
from phasebench.integrators.stepping.kernel import array
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from support.solutions import end

PLANETS = "outer-solar-system"


def elsewhere(system, q, p, t):
    """State of a system at time t from (q, p), by SciPy's DOP853."""
    from scipy.integrate import solve_ivp

    return solve_ivp(system.vector_field(), (0, t), [*q, *p], method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]


def test_correctors_equal_the_published_ones():
    """Wisdom (2006), table 1: alpha = sqrt(7/40), beta = 1/(48 alpha); beta/2 for order 3, 5/6 and 1/6 beta for 5."""
    alpha = mpmath.sqrt(mpmath.mpf(7) / 40)
    beta = 1 / (48 * alpha)
    found = {n: {float(round(t / alpha)): b / beta for t, b in corrector(n)} for n in (3, 5)}
    assert found[3][1] == pytest.approx(-1 / 2, rel=1e-15, abs=0)
    assert found[5][1] == pytest.approx(-5 / 6, rel=1e-15, abs=0)
    assert found[5][2] == pytest.approx(1 / 6, rel=1e-15, abs=0)
    for n in (3, 17):
        kicks = corrector(n)
        assert kicks == kicks[::-1], "backwards in time it is itself"
        pairs = [(float(t), float(b)) for t, b in kicks]
        assert sorted(pairs) == sorted((-t, -b) for t, b in pairs)


@pytest.mark.parametrize("id", ["wisdom-holman", "wisdom-holman-corrector", "wisdom-holman-aba-8-6-4", "fcirk"])
def test_kepler_is_solved_exactly(id):
    from phasebench.reference.solvers.exact import exact

    made = problem("kepler", e=0.6)
    Q, P = exact(made, [30.0])
    wanted = np.array([float(x) for x in (*Q[0], *P[0])])
    for steps in (10, 200):
        found = end(integrate(made, id, h=30.0 / steps, steps=steps))
        assert np.abs(found - wanted).max() < 1e-12
    other = end(integrate(problem("perturbed-kepler"), id, h=0.15, steps=200))
    assert np.abs(other - wanted).max() > 1e-3


def planar(part):
    q, p = sp.symbols("x1 x2 y1 y2", real=True), sp.symbols("u1 u2 v1 v2", real=True)
    r = sp.sqrt((q[2] - q[0]) ** 2 + (q[3] - q[1]) ** 2)
    H = (p[0] ** 2 + p[1] ** 2) / 2 + (p[2] ** 2 + p[3] ** 2) / sp.Rational(1, 2) - 1 / (4 * r)
    return Hamiltonian(q=q, p=p, H=H, singular=[r], kepler=part)


def test_two_bodies_in_the_plane_are_solved_exactly():
    """The centre of mass moves freely and the relative motion is Kepler's, so one long step equals many short ones."""
    system = planar(jacobi([1, sp.Rational(1, 4)], 1, dimension=2))
    state = {"q0": [0.1, 0.2, 1.0, 0.1], "p0": [0.3, -0.1, 0.05, 0.25]}
    one, many = (end(integrate(system, "wisdom-holman", h=7.0 / n, steps=n, **state)) for n in (1, 64))
    assert np.abs(one - many).max() < 1e-13
    assert np.abs(one - elsewhere(system, state["q0"], state["p0"], 7.0)).max() < 1e-10
    assert system.kepler.interaction(system)((0.1, 0.2, 1.0, 0.1)) == (0, 0, 0, 0)


@pytest.mark.parametrize(
    "part",
    [
        KeplerPart(2, (1, 1), (0, 1)),
        KeplerPart(2, (1, sp.Rational(1, 2)), (1, 1)),
        KeplerPart(3, (1,), (1,)),
        jacobi([1, 2], 1, dimension=2),
    ],
)
def test_a_kepler_part_must_match_the_kinetic_energy(part):
    with pytest.raises(InvalidInput, match="Kepler part"):
        integrate(planar(part), "wisdom-holman", h=0.1, steps=1, q0=[0, 0, 1, 0], p0=[0, 0, 0, 1])


def small(masses, extra=0):
    """Bodies with these masses in space, G = 1, and an additional potential extra * q_1."""
    n = len(masses)
    q, p = sp.symbols(f"q:{3 * n}", real=True), sp.symbols(f"p:{3 * n}", real=True)
    pairs = [(i, j) for j in range(n) for i in range(j)]
    r = [sp.sqrt(sum((q[3 * j + k] - q[3 * i + k]) ** 2 for k in range(3))) for i, j in pairs]
    H = sum(x**2 / (2 * masses[k // 3]) for k, x in enumerate(p)) + extra * q[0]
    H -= sum(masses[i] * masses[j] / x for (i, j), x in zip(pairs, r, strict=True))
    return Hamiltonian(q=q, p=p, H=H, singular=r, kepler=jacobi(masses, 1))


def test_bodies_with_another_potential_are_not_in_lanes():
    extra, bodies = sp.Rational(1, 1000), 3
    masses = [sp.Integer(1), *(sp.Rational(1, 1000 * k) for k in range(1, bodies))]
    system, alone = small(masses, extra), small(masses)
    assert planet_pairs.distances(system.potential, system.q) is None
    assert len(planet_pairs.distances(alone.potential, alone.q)) == bodies
    q, v = np.array([[0, 0, 0], [1, 0, 0.1], [0, 2, -0.1]]), np.array([[0, 0, 0], [0, 1, 0], [-0.7, 0, 0.0]])
    state = {"q0": q.ravel(), "p0": (v * np.array(masses, float)[:, None]).ravel()}
    found = end(integrate(system, "wisdom-holman-aba-10-6-4", h=0.1, steps=30, **state))
    assert np.abs(found - elsewhere(system, state["q0"], state["p0"], 3.0)).max() < 1e-9


@pytest.fixture(scope="module")
def fine():
    made = problem(PLANETS)
    return elsewhere(made.system, made.q0, made.p0, 5000.0)


#: Errors of positions after 5000 days with h = 50, and of the energy on the way: of the reference and of round-off, or
#: of the corrector's method.
ERRORS = {
    "wisdom-holman-corrector": (2e-7, 4e-10),
    "wisdom-holman-aba-10-6-4": (4e-11, 4e-14),
    "fcirk": (4e-11, 4e-14),
}


@pytest.mark.parametrize("id", ERRORS)
def test_errors_of_the_planets(fine, id):
    made = problem(PLANETS)
    s = integrate(made, id, h=50.0, steps=100)
    E = made.system.observe(made.system.H, s.q, s.p)
    found = np.abs(end(s) - fine)[:18].max(), np.abs(E / E[0] - 1).max()
    assert all(np.less(found, ERRORS[id])), found
    for name, expression in made.invariants.items():
        kept = made.system.observe(expression, s.q, s.p)
        assert np.abs(kept - kept[0]).max() < 1e-18, name


# -- flow-composed Runge-Kutta methods --------------------------------------------------------------------------------

#: The speed of a parabola from the start below, where v^2 = 2 / r; the velocity is this times (0.1, 1, 0.05).
PARABOLIC = (2 / 1.05**0.5 / 1.0125) ** 0.5


@pytest.mark.parametrize(
    ("speed", "h"),
    [(1.1, -0.7), (0.9, 40.0), (PARABOLIC, 0.8), (1.9, -3.0)],
)
def test_a_kick_is_transported_back_as_differences_say(speed, h):
    table = array(kepler_flow.constants(DOUBLE), DOUBLE)
    X, spans = np.zeros((4, 3)), np.zeros(3)
    X[0], X[1] = (1.0, 0.1, -0.2), (0.1 * 0.3, speed * 0.3, 0.05 * 0.3)
    mass, eps, kick, there = 0.3, 2.0**-52, np.array([0.02, -0.03, 0.01]), X.copy()
    kepler_tangent.move(X, 0, 3, mass, 1.0, h, eps, table, spans, 0, 1)
    kepler_flow.advance(there, 0, 3, mass, 1.0, h, eps, table)
    assert np.abs(X[:2] - there[:2]).max() < 1e-12
    kepler_tangent.kick_back(X, 0, 3, mass, 1.0, h, eps, table, spans, 0, 1, kick, 2)
    ends, d = [], 1e-4
    for sign in (2, 1, -1, -2):
        Y = np.zeros((4, 3))
        Y[:2] = X[:2]
        Y[1] += sign * d * kick
        kepler_flow.advance(Y, 0, 3, mass, 1.0, -h, eps, table)
        ends.append(Y[:2].copy())
    expected = (8 * (ends[1] - ends[2]) - (ends[0] - ends[3])) / (12 * d)
    assert np.abs(X[2:4] - expected).max() < 1e-9 * np.abs(expected).max()
    assert np.abs(X[2:4]).max() > 1e-2
