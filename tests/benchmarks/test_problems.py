"""Every registered problem: its entry, derivatives, invariants, and what the literature says of it."""

from __future__ import annotations

import cmath
import importlib
from fractions import Fraction
from functools import partial
from itertools import pairwise
from math import cosh, pi, sqrt

import mpmath
import numpy as np
import pytest
import sympy as sp
from mpmath import mpf
from scipy.integrate import solve_ivp

from phasebench.benchmarks.measure.every_problem import SMALL
from phasebench.benchmarks.measure.multiprecision import retraction
from phasebench.benchmarks.problems import (
    PROBLEMS,
    butane,
    duffing,
    four_points,
    klein_gordon,
    lennard_jones,
    nls,
    problem,
    three_body,
    toda,
)
from phasebench.benchmarks.problems.scenes import SCENES
from phasebench.integrators.compile.codegen import MULTIPRECISION, compiled, precision, to_number, value_kind, vector
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from phasebench.integrators.systems.hand import uncompiled_loop
from phasebench.reference.solvers import taylor
from phasebench.reference.solvers.gauss import share_subexpressions
from phasebench.reference.solvers.taylor import reference

DIGITS = 40

# -- the contract of every problem -------------------------------------------------------------------------------------


def state(made, seed=0):
    """A random point near the initial state, in rationals, so that expressions can be evaluated to any precision."""
    rng = np.random.default_rng(seed)
    values = [*made.q0, *made.p0]
    values = [sp.Rational(round(v * 10**6 + int(rng.integers(-5000, 5000)) + 0.5), 10**6) for v in values]
    return on_manifold(made.system, values) if made.system.constrained else values


def on_manifold(system, values):
    """The state near a state where all constraints vanish, as rationals."""
    with precision(2 * DIGITS):
        y = retraction(system)(vector([Fraction(v.p, v.q) for v in values]))
        return [sp.Rational(int(x * 10 ** (2 * DIGITS)), 10 ** (2 * DIGITS)) for x in y]


def function(made, expressions):
    """The expressions, which may refer to the system's definitions, as a function of a point, in multiprecision."""
    given = {x: sp.Dummy() for x in (*made.system.q, *made.system.p)}  # cse's own symbols are x0, x1, ...
    shared = partial(share_subexpressions, [(x, e.xreplace(given)) for x, e in made.system.definitions])
    f = sp.lambdify(
        [[*given.values()]], [e.xreplace(given) for e in map(sp.sympify, expressions)], "mpmath", cse=shared
    )
    return lambda values: f([mpmath.mpf(v.p) / v.q for v in values])


@pytest.mark.parametrize("name", PROBLEMS)
def test_entry_orbits_scenes_and_time_scales(name):
    """Over its span an orbit moves by a good part of its size, over a step by much less."""
    module_name, line, names = PROBLEMS[name]
    module = importlib.import_module(f"phasebench.benchmarks.problems.{module_name}")
    made = problem(name)
    assert (made.id, tuple(o.name for o in made.orbits), {*made.parameters}) == (name, names, {*module.PARAMETERS})
    assert all((line, made.source, made.name))
    assert problem(name).start.name == names[0]
    for orbit in names:
        start = problem(f"{name}:{orbit}")
        assert start.start.name == orbit
        assert len(start.q0) == len(start.p0) == start.system.d
        assert all(type(x) is float for x in (*start.q0, *start.p0))
        assert np.isfinite(energy(start))
    stated = getattr(module, "SCENES", ())
    assert [s for s in SCENES if s.problem.partition(":")[0] == name] == sorted(stated, key=SCENES.index)
    assert [s.problem for s in stated] == [problem(s.problem).label for s in stated], "an only orbit is not named"
    small = problem(name, **SMALL.get(name, {}))
    start = np.array([*small.q0, *small.p0])
    step, far = taylor.states(small.system, float, small.q0, small.p0, [small.pace.step, small.pace.span])
    size = np.abs([start, step, far]).max()
    assert np.abs(step - start).max() < size / 2
    assert np.abs(far - start).max() > size / 20


@pytest.mark.parametrize("name", PROBLEMS)
def test_derivatives_against_differences_of_H(name):
    """The compiled field against differences of H in multiprecision, without symbolic differentiation."""
    made = problem(name)
    system, d = made.system, made.system.d
    values = state(made)
    with mpmath.workdps(DIGITS):
        f = sp.lambdify([[*system.q, *system.p]], system.H, "mpmath")
        y = [mpmath.mpf(v.p) / v.q for v in values]
        delta = mpmath.mpf(10) ** -12
        slopes = []
        for i in range(2 * d):
            plus, minus = (y[:i] + [y[i] + s * delta] + y[i + 1 :] for s in (1, -1))
            slopes.append((f(plus) - f(minus)) / (2 * delta))
    q, p = np.array([float(v) for v in values]).reshape(2, d)
    if compiled() and value_kind(d) == "tuple":
        q, p = tuple(q), tuple(p)
    dq, dp = (np.array(x, float) for x in system.field()(q, p, 0.0, 0.0))
    dH = np.array([float(s) for s in slopes])
    force, velocity = np.abs(dH[:d]).max(), np.abs(dH[d:]).max()
    if system.canonical:
        assert np.abs(dq - dH[d:]).max() < 1e-13 * velocity
        assert np.abs(dp + dH[:d]).max() < 1e-13 * force
        assert np.abs(dp - dH[:d]).max() > 1e-3 * force, "the control: the sign"
    else:
        size = max(force, velocity) * np.abs([*dq, *dp]).max()
        assert abs(dH[:d] @ dq + dH[d:] @ dp) < 1e-13 * size, "dI/dt along the flow"


def rate(system, expression):
    """d/dt of an expression along the flow, {I, H} for a canonical system, in terms of the system's definitions."""
    return sum(expression.diff(x) * dx for x, dx in zip((*system.q, *system.p), system.sides, strict=True))


@pytest.mark.parametrize("name", PROBLEMS)
def test_rates_of_invariants_vanish(name):
    """{I, H} is formed symbolically and vanishes to 40 digits at random rational points."""
    made = problem(name, **SMALL.get(name, {}))
    for which, expression in {"energy": made.system.H, **made.invariants}.items():
        slopes = [expression.diff(x) for x in (*made.system.q, *made.system.p)]
        evaluate = function(made, [rate(made.system, expression), *slopes])
        with mpmath.workdps(DIGITS):
            for seed in range(3):
                value, *slopes = evaluate(state(made, seed))
                assert any(s != 0 for s in slopes), f"a constant is no invariant worth the name: {which}"
                assert abs(value) < mpf(10) ** (6 - DIGITS) * (1 + max(abs(s) for s in slopes)), which


def test_control_rate_of_a_noninvariant():
    made, kepler = problem("perturbed-kepler"), problem("kepler")
    with mpmath.workdps(DIGITS):
        for which in ("laplace-runge-lenz-1", "laplace-runge-lenz-2"):
            (value,) = function(made, [rate(made.system, kepler.invariants[which])])(state(made))
            assert abs(value) > 1e-6


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("kepler", {"e": float("nan")}),
        ("kepler", {"e": "0.5"}),
        ("kepler", {"e": True}),
        ("harmonic-oscillator", {"omega": Fraction(10**400, 3)}),
    ],
)
def test_parameters_that_are_no_finite_numbers_are_refused(name, parameters):
    """Others are in `bad_input.txt`."""
    with pytest.raises(InvalidInput, match="finite"):
        problem(name, **parameters)


# -- the literature ----------------------------------------------------------------------------------------------------


def energy(made):
    return float(made.system.observe(made.system.H, np.array([made.q0]), np.array([made.p0]))[0])


@pytest.mark.parametrize(
    ("name", "value", "digits"),
    [
        ("henon-heiles:box", 0.02, 1e-15),  # Wang, Bo & Cai (talk), (27)-(30)
        ("henon-heiles:chaotic", 1 / 6, 1e-15),
        ("kepler", -0.5, 1e-14),
        ("perturbed-kepler", -0.5 - 0.0075 / (3 * 0.4**3), 1e-14),  # Hairer, Lubich & Wanner 2006, exercise I.12
        ("pendulum:rotating", 2.125, 1e-15),
        ("quadrupole-boson", 120, 1e-15),
        ("quadrupole-boson:h20", 20, 1e-15),
        ("schwarzschild", -0.5, 1e-14),
        ("schwarzschild:isco", -0.5, 1e-14),
        ("n-body", -769 / 60, 1e-14),  # Szebehely & Peters 1967
        ("lennard-jones", -1260.2 / lennard_jones.EPSILON, 4e-5),  # Hairer, Lubich & Wanner 2006, I.4
    ],
)
def test_energy_of_the_initial_data(name, value, digits):
    assert energy(problem(name)) == pytest.approx(value, rel=digits)


def at(made, *times, **start):
    """(q, p) of the reference at increasing times, with uncertainties below 1e-14 (1 + size of the state)."""
    found = reference(made, [float(t) for t in times], **start)
    for uncertainty, q, p in zip(found.uncertainty, found.q, found.p, strict=True):
        assert uncertainty < 1e-14 * (1 + np.abs([q, p]).max())
    return list(zip(found.q, found.p, strict=True))


def vanish(system, expressions):
    """True if the expressions are zero to 30 digits at four random rational points."""
    f = sp.lambdify([[*system.q, *system.p]], expressions, "mpmath")
    rng = np.random.default_rng(1)
    with mpmath.workdps(40):
        draws = [[mpf(int(x)) / 1000 for x in rng.integers(200, 900, 2 * system.d)] for _ in range(4)]
        return all(abs(v) < mpf(10) ** -30 for y in draws for v in f(y))


def test_double_pendulum_mechanics():
    """H is the energy of two masses on rods, in Cartesian coordinates."""
    values = {"m1": 1.5, "m2": 0.75, "l1": 1.25, "l2": 0.5, "g": 9.75}
    s = problem("double-pendulum", **values).system
    m1, m2, l1, l2, g = map(sp.Rational, values.values())
    (a, b), (da, db) = s.q, s.dq
    x, y = sp.Matrix([l1 * sp.sin(a), l1 * sp.sin(a) + l2 * sp.sin(b)]), -sp.Matrix([l1 * sp.cos(a), l1 * sp.cos(a)])
    y[1] -= l2 * sp.cos(b)
    speeds = [[z[i].diff(a) * da + z[i].diff(b) * db for z in (x, y)] for i in (0, 1)]
    kinetic = sum(m * (u**2 + v**2) / 2 for m, (u, v) in zip((m1, m2), speeds, strict=True))
    potential = g * (m1 * y[0] + m2 * y[1])
    assert vanish(s, [kinetic + potential - s.H])
    assert not vanish(s, [kinetic - potential - s.H])


def test_quadrupole_boson_has_the_force_of_its_benchmark():
    """As SciMLBenchmarks writes it."""
    made = problem("quadrupole-boson")
    s = made.system
    A, B, D = map(sp.Rational, made.parameters.values())
    (x, y), r2 = s.q, sum(z**2 for z in s.q)
    force = (-A * x - 3 * B / sp.sqrt(2) * (y**2 - x**2) - D * x * r2, -y * (A + 3 * sp.sqrt(2) * B * x + D * r2))
    assert all(sp.expand(a - b) == 0 for a, b in zip(force, s.dp, strict=True))


def test_rigid_body_has_eulers_equations():
    made = problem("rigid-body", I1=1.5, I2=0.75, I3=2.5, G=1.25)
    s = made.system
    moments = [sp.Rational(x) for x in (1.5, 0.75, 2.5)]
    across = sp.sqrt(sp.Rational(1.25) ** 2 - s.p[0] ** 2)
    m = sp.Matrix([across * sp.sin(s.q[0]), across * sp.cos(s.q[0]), s.p[0]])
    right = m.cross(sp.Matrix([a / b for a, b in zip(m, moments, strict=True)]))
    assert vanish(s, [rate(s, a) - b for a, b in zip(m, right, strict=True)])
    assert not vanish(s, [rate(s, a) + b for a, b in zip(m, right, strict=True)])


def test_charged_particle_obeys_the_lorentz_force():
    """He, Sun, Liu & Qin 2015, section 4.1: B = R, E = phi0 q / R^3, q = (0, -1), v = (0.1, 0.01)."""
    made = problem("charged-particle")
    s = made.system
    (x, y), (u, v) = s.q, s.dq
    R = sp.sqrt(x**2 + y**2)
    E = [sp.Rational(made.parameters["phi0"]) * z / R**3 for z in s.q]
    assert vanish(s, [rate(s, u) - R * v - E[0], rate(s, v) + R * u - E[1]])
    assert not vanish(s, [rate(s, u) + R * v - E[0], rate(s, v) - R * u - E[1]])
    velocity = [float(s.observe(e, [made.q0], [made.p0])[0]) for e in s.dq]
    assert velocity == pytest.approx([0.1, 0.01], abs=1e-16)


def test_magnetic_mirror_obeys_the_lorentz_force():
    """v' = v x B with B = (-x z / L^2, -y z / L^2, 1 + z^2 / L^2); and the start."""
    s = problem("magnetic-mirror").system
    (x, y, z), v = s.q, sp.Matrix(s.dq)
    B = sp.Matrix([-x * z, -y * z, 100 + z**2]) / 100
    force = v.cross(B)
    assert vanish(s, [rate(s, a) - f for a, f in zip(v, force, strict=True)])
    assert not vanish(s, [rate(s, a) + f for a, f in zip(v, force, strict=True)])
    made = problem("magnetic-mirror")
    assert [float(s.observe(e, [made.q0], [made.p0])[0]) for e in s.dq] == pytest.approx([0, 0.3, 0.2], abs=1e-16)


def test_spherical_pendulum_is_that_of_its_angles():
    """The certified state beside an integration in spherical angles, by SciPy."""
    made = problem("spherical-pendulum")
    ((q, p),) = at(made, 10.0)
    (x, y, z), (u, v, w) = made.q0, made.p0
    L = x * v - y * u

    def field(_, s):  # theta from the downward vertical, its rate, phi
        return [s[1], L**2 * np.cos(s[0]) / np.sin(s[0]) ** 3 - np.sin(s[0]), L / np.sin(s[0]) ** 2]

    start = [np.arccos(-z), w / np.sin(np.arccos(-z)), np.arctan2(y, x)]
    theta, pace, phi = solve_ivp(field, (0, 10), start, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    expected = [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), -np.cos(theta)]
    assert np.abs(expected - np.array(q)).max() < 1e-10
    assert abs(pace * np.sin(theta) - p[2]) < 1e-10


def test_four_points_move_as_euler_s_equations_have_it():
    """The certified state beside Euler's equations in the body's frame and the rotation matrix, by SciPy."""
    made = problem("four-points")
    ((q, p),) = at(made, 10.0)
    masses = np.array([made.parameters[f"m{k}"] for k in range(1, 5)])[:, None]
    points, turn = np.array(four_points.POINTS, dtype=float), np.array(four_points.TURN)
    middle = (masses * points).sum(axis=0) / masses.sum()
    arms = points - middle
    inertia = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses[:, 0], arms, strict=True))

    def field(_, s):  # the rotation matrix, the angular velocity in the body's frame
        R, w = s[:9].reshape(3, 3), s[9:]
        hat = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        return np.concatenate([(R @ hat).ravel(), np.linalg.solve(inertia, np.cross(inertia @ w, w))])

    end = solve_ivp(field, (0, 10), [*np.eye(3).ravel(), *turn], "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    R, w = end[:9].reshape(3, 3), end[9:]
    assert np.abs((middle + arms @ R.T).ravel() - q).max() < 1e-10
    assert np.abs((masses * (np.cross(w, arms) @ R.T)).ravel() - p).max() < 1e-10
    assert np.abs(np.array(q) - points.ravel()).max() > 0.1


def test_butane_keeps_bonds_and_angles_and_has_the_torsion_s_energy():
    for phi in (0.0, np.pi / 3, np.pi):
        turned = problem("butane", phi=phi)
        value = sum(float(a) * np.cos(phi) ** k for k, a in enumerate(butane.TORSION))
        assert turned.system.energies(np.array([turned.q0]), np.zeros((1, 12)))[0] == pytest.approx(value, abs=1e-12)
    assert abs(sum(butane.TORSION)) < 1e-12, "trans is the valley"
    molecule = problem("butane")
    s = integrate(molecule, "rattle", h=0.02, steps=200)
    assert s.status == "ok"
    r = s.q.reshape(-1, 4, 3)
    for k, square in ((1, 1.0), (2, 8 / 3)):
        assert np.abs(((r[:, k:] - r[:, :-k]) ** 2).sum(axis=2) - square).max() < 1e-14
    for name in (f"angular-momentum-{k}" for k in (1, 2, 3)):
        assert np.abs(s.invariants()[name] - s.invariants()[name][0]).max() < 1e-13
    half = integrate(molecule, "rattle", h=0.01, steps=400)
    assert 3.5 < np.ptp(s.energy()) / np.ptp(half.energy()) < 4.5


@pytest.mark.parametrize(("orbit", "alpha"), [("both-wells", -1.0), ("one-well", 1.5)])
def test_duffing_is_an_elliptic_function(orbit, alpha):
    """The Duffing oscillator's orbit is the elliptic function of NIST DLMF 22.19(ii)."""
    made = problem(f"duffing:{orbit}", alpha=alpha)
    (a,) = made.q0
    with mpmath.workdps(30):
        ((q, p),) = at(made, 3.0)
        assert abs(q[0] - duffing.exact(alpha, 1, a, 3.0)[0]) < 1e-15
        assert abs(p[0] - mpmath.diff(lambda x: duffing.exact(alpha, 1, a, x)[0], 3.0)) < 1e-14
        assert abs(duffing.exact(alpha * (1 + 1e-9), 1, a, 3.0)[0] - q[0]) > 1e-11, "the control"
        period = duffing.exact(alpha, 1, a, 0)[1]
        half, whole = at(made, float(period / 2), float(period))
        assert abs(whole[0][0] - a) < 1e-14 < 0.1 < abs(half[0][0] - a)


def test_figure_eight_data_and_period():
    """Chenciner & Montgomery 2000: data and period to eight digits; each body takes the next one's place in T/3."""
    made, T = problem("figure-eight"), three_body.PERIOD
    printed = (0.97000436, -0.24308753), (-0.93240737, -0.86473146)
    assert np.abs(np.array([three_body.FIRST, three_body.THIRD]) - printed).max() < 5.1e-9
    assert abs(T - 6.32591398) < 5.1e-9
    (q, p), (end, momenta) = at(made, T / 3, T)
    assert np.abs([end - made.q0, momenta - made.p0]).max() < 5e-15
    found, start = np.hstack([q.reshape(3, 2), p.reshape(3, 2)]), np.array([made.q0, made.p0]).reshape(2, 3, 2)
    assert np.abs(np.roll(found, 2, axis=0) - np.hstack(list(start))).max() < 5e-15
    (x, y), (u, v) = printed
    q0, p0 = (x, y, -x, -y, 0.0, 0.0), (-u / 2, -v / 2, -u / 2, -v / 2, u, v)
    ((q, _),) = at(made, T, q0=q0, p0=p0)
    assert 1e-9 < np.abs(q - q0).max() < 1e-6, "the control: eight digits return to eight digits"


@pytest.mark.parametrize("N", [3, 4])
def test_toda_lattice_spectrum_and_wave(N):
    """Flaschka 1974 (the spectrum), Toda 1967 (the wave): the state at t = 3 against both."""
    made = problem("toda:cnoidal", N=N)
    ((q, p),) = at(made, 3.0)

    def spectrum(q, p):
        L = np.diag(p)
        for i in range(N):
            a = np.exp((q[i] - q[(i + 1) % N]) / 2)
            L[i, (i + 1) % N] += a
            L[(i + 1) % N, i] += a
        return np.linalg.eigvalsh(L)

    first, last = spectrum(made.q0, made.p0), spectrum(q, p)
    assert np.abs(first - last).max() < 1e-13
    assert np.abs(np.array(made.p0) - p).max() > 0.1
    for k in (1, *range(3, N + 1)):
        expected = (first**k).sum() / k - (2 if k == N else 0)
        kept = made.invariants["momentum" if k == 1 else f"trace-{k}"]
        assert made.system.observe(kept, [made.q0], [made.p0])[0] == pytest.approx(expected, abs=1e-12)
    with mpmath.workdps(30):
        for m, right in ((toda.MODULUS, True), (toda.MODULUS + 1e-6, False)):
            difference = np.array(toda.cnoidal(N, m, 3.0)) - [q, p]
            assert (abs(difference).max() < 2e-15) == right


@pytest.mark.parametrize(
    ("name", "semilatus", "e", "tolerance"),
    [("precessing", 1000.0, 0.2, 1e-9), ("zoom-whirl", 7.001, 0.5, 1e-10)],
)
def test_schwarzschild_precession_by_elliptic_integral(name, semilatus, e, tolerance):
    """Cutler, Kennefick & Poisson 1994, section II; in weak fields by 6 pi M / (a (1 - e^2))."""
    values = {} if name == "zoom-whirl" else {"semilatus": semilatus, "e": e}
    made = problem(f"schwarzschild:{name}", **values)
    with mpmath.workdps(30):
        x, e = mpf(semilatus), mpf(e)

        def proper(chi):
            c = e * mpmath.cos(chi)
            return x**1.5 * mpmath.sqrt((x - 3 - e**2) / (x - 6 - 2 * c)) / (1 + c) ** 2

        period = 2 * mpmath.quad(proper, mpmath.linspace(0, mpmath.pi, 9))
        advance = 4 * mpmath.sqrt(x / (x - 6 + 2 * e)) * mpmath.ellipk(4 * e / (x - 6 + 2 * e))
        weak = 2 * mpmath.pi + 6 * mpmath.pi / x
    ((q, p),) = at(made, period)
    assert abs(q[1] - made.q0[1]) < tolerance * semilatus
    assert abs(p[1]) < tolerance
    assert abs(q[2] - advance) < tolerance
    assert abs(q[2] - weak) > 1e-6
    assert (abs(advance - weak) < 1e-3) == (semilatus > 100)


@pytest.mark.parametrize(("ratio", "chi1", "chi2"), [(0.5, 0.875, 0.625), (0.25, 1.0, 0.0), (1.0, 0.0, 0.0)])
def test_spinning_binary_on_a_circle_has_the_energy_of_its_frequency(ratio, chi1, chi2):
    """Blanchet 2014, Living Rev. Relativ. 17, 2; Kidder 1995 (spins); the energy without one of the terms is off."""
    eps = mpf(2) ** -16
    s = problem("spinning-binary", ratio=ratio, chi1=chi1, chi2=chi2, eps=float(eps)).system
    H = sp.lambdify([[*s.q, *s.p]], s.H, "mpmath")

    def energy(r, L):
        return mpmath.re(H([r, 0, 0, 0, 0, 0, L / r, 0, *lengths]))

    with mpmath.workdps(60):
        m1 = 1 / (1 + mpf(ratio))
        m2 = 1 - m1
        eta, lengths = m1 * m2, (eps * chi1 * m1 / m2, eps * chi2 * m2 / m1)
        L = mpmath.findroot(lambda L: mpmath.diff(lambda r: energy(r, L), 1), (1, 1 + eps))
        x = eps**2 * mpmath.cbrt(mpmath.diff(lambda L: energy(1, L), L) ** 2)
        orbit = chi1 * (8 * m1**2 / 3 + 2 * eta) + chi2 * (8 * m2**2 / 3 + 2 * eta)
        terms = [-(mpf(3) / 4 + eta / 12) * x, orbit * x**1.5]
        terms += [(-27 + 19 * eta - eta**2 / 3) / 8 * x**2, -((chi1 * m1 + chi2 * m2) ** 2) * x**2]
        off = energy(1, L) + x / (2 * eps**2) * (1 + sum(terms))
        assert abs(off) < 10 * eps**5
        assert all(t == 0 or abs(off - x / (2 * eps**2) * t) > 1e3 * eps**5 for t in terms)


def test_spinning_binary_advances_by_its_weak_field_and_is_kepler_s_without():
    """The pericentre advances by 6 pi eps^2 / (1 - e^2) in a revolution: Damour & Schaefer 1988."""
    made = problem("spinning-binary", ratio=0.25, chi1=0.0, chi2=0.0, eps=1e-4)
    ((q, p),) = at(made, 2 * pi)
    lenz = np.cross(p[:3], np.cross(q[:3], p[:3])) - q[:3] / np.linalg.norm(q[:3])
    assert lenz[1] / lenz[0] == pytest.approx(6 * pi * 1e-8 / (1 - 0.6**2), rel=1e-5)
    s = problem("spinning-binary", eps=0.0).system
    assert vanish(s, [s.H - sum(x**2 for x in s.p[:3]) / 2 + 1 / sp.sqrt(sum(x**2 for x in s.q[:3]))])


def test_n_body_loops_agree_with_the_formula():
    made = problem("n-body", N=7)
    s = made.system
    q, p = np.array(made.q0), np.array(made.p0)
    force = np.array([float(s.observe(e, [q], [p])[0]) for e in s.dp])
    assert np.abs(s.grad_V()(q) + force).max() < 1e-14 * np.abs(force).max()
    value, size = s.energy()(q, p)
    plain = sp.lambdify([[*s.q, *s.p]], s.H, "math")([*made.q0, *made.p0])
    assert value == pytest.approx(plain, rel=1e-13)
    assert size > abs(value)


@pytest.mark.parametrize(("orbit", "t", "most"), [("regular", 100.0, 1e-12), ("chaotic", 10.0, 1e-11)])
def test_double_pendulum_is_the_same_in_both_coordinates(orbit, t, most):
    """The certified states of both, in Cartesian coordinates; they start apart by the rounding of sines."""
    angles, points = (at(problem(f"{id}:{orbit}"), t)[0] for id in ("double-pendulum", "double-pendulum-cartesian"))
    (a, b), (pa, pb) = angles
    c = np.cos(a - b)
    da, db = np.linalg.solve(np.array([[2.0, c], [c, 1.0]]), [pa, pb])
    one, two = np.array([np.sin(a), -np.cos(a)]), np.array([np.sin(b), -np.cos(b)])
    u, v = da * np.array([np.cos(a), np.sin(a)]), db * np.array([np.cos(b), np.sin(b)])
    q, p = np.concatenate([one, one + two]), np.concatenate([u, u + v])
    assert np.abs(q - points[0]).max() < most
    assert np.abs(p - points[1]).max() < most
    assert np.abs(q - at(problem(f"double-pendulum-cartesian:{orbit}"), 1.0)[0][0]).max() > 1e-3


# -- wave equations ----------------------------------------------------------------------------------------------------


MODULES = {"nls": nls, "klein-gordon": klein_gordon}
FEW, LENGTH = 4, 5.0


def loop(name, function, N, arithmetic="double"):
    """A wave problem's handwritten loop of this name, such as "field", for N grid points, not compiled."""
    module = MODULES[name]
    return uncompiled_loop(
        function, getattr(module, function), [to_number(c, arithmetic) for c in module.constants(N, LENGTH)]
    )


def random_state(d, seed=3):
    return np.random.default_rng(seed).normal(size=(2, d))


@pytest.fixture(scope="module", params=MODULES)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def small(name) -> Hamiltonian:
    """The symbolic Hamiltonian on four grid points."""
    made = problem(name, N=FEW, L=LENGTH)
    assert type(made.system) is Hamiltonian
    return made.system


# -- the loops ---------------------------------------------------------------------------------------------------------


def test_loops_run_in_multiprecision(name, small):
    """Against the formula at 40 digits: neither a loop nor its constants contain doubles."""
    with precision(40):
        q, p = (vector(row) / 3 for row in random_state(small.d))
        theirs = small.field(MULTIPRECISION)(q, p, 0, 0)
        ours = loop(name, "field", FEW, MULTIPRECISION)(q, p, 0, 0)
        assert max(abs(a - b) for x, y in zip(ours, theirs, strict=True) for a, b in zip(x, y, strict=True)) < 1e-37
        pairs = loop(name, "energy", FEW, MULTIPRECISION)(q, p), small.energy(MULTIPRECISION)(q, p)
        assert all(abs(a - b) < 1e-37 * abs(b) for a, b in zip(*pairs, strict=True))
        if name == "klein-gordon":
            force = loop(name, "grad_V", FEW, MULTIPRECISION)(q)
            assert max(abs(a + b) for a, b in zip(force, theirs[1], strict=True)) < 1e-37


# -- the equation ------------------------------------------------------------------------------------------------------


def soliton_error(N):
    """Largest error of psi at t = 1/2, from the differences in space; that of RK4 is far smaller."""
    made = problem("nls:soliton", N=N, L=32.0)
    s = integrate(made, "rk4", h=1 / 1024, t_end=0.5, save_every=0)
    k, t, dx = 2 * pi / 32, 0.5, 32 / N
    x = -16 + dx * np.arange(N)
    exact = [cmath.exp(1j * (k * y + (1 - k * k) * t)) / cosh(y - 2 * k * t) for y in x]
    return np.abs((s.q[-1] + 1j * s.p[-1]) / sqrt(dx) - exact).max()


def test_soliton_converges_to_second_order_in_space():
    """Zakharov & Shabat 1972: sech(x - 2 k t) exp(i (k x + (1 - k^2) t)) solves the equation."""
    errors = [soliton_error(N) for N in (128, 256, 512)]
    assert errors[-1] < 1e-3
    ratios = [a / b for a, b in pairwise(errors)]
    assert ratios == pytest.approx([4, 4], rel=0.1)


def test_plane_wave_has_its_discrete_frequency():
    """phi = A exp(i (k x - w t)) with w^2 = 1 + A^2 + k^2, with k of the difference quotient."""
    N, L, A = 64, 10.0, 0.7
    system = problem("klein-gordon", N=N, L=L).system
    dx, k = L / N, 2 * pi / L
    w = sqrt(1 + A**2 + (2 / dx * np.sin(k * dx / 2)) ** 2)
    phi = A * sqrt(dx) * np.exp(1j * k * dx * np.arange(N))
    start = [np.concatenate([z.real, z.imag]) for z in (phi, -1j * w * phi)]
    s = integrate(system, "rk4", h=1 / 512, t_end=1.0, q0=start[0], p0=start[1], save_every=0)
    end = s.q[-1][:N] + 1j * s.q[-1][N:]
    assert np.abs(end - phi * np.exp(-1j * w)).max() < 1e-9
    assert np.abs(end - phi * np.exp(1j * w)).max() > 0.1, "the control: the sign"
