"""Problems against the literature: closed forms, periods, printed values, the original equations."""

from __future__ import annotations

import importlib

import mpmath
import numpy as np
import pytest
import sympy as sp
from mpmath import mpf
from scipy.integrate import solve_ivp

from phasebench.benchmarks.problems import butane, duffing, four_points, lennard_jones, n_body, three_body, toda
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.reference.solvers.taylor import reference

MODULES = {"figure-eight": "three_body"}


def make_problem(name, **parameters):
    """A problem ``id`` or ``id:orbit`` directly from its module."""
    id, _, orbit = name.partition(":")
    module = importlib.import_module(f"phasebench.benchmarks.problems.{MODULES.get(id, id.replace('-', '_'))}")
    found = module.make(**(module.PARAMETERS | parameters))
    return found.at(orbit) if orbit else found


def energy(problem):
    return float(problem.system.observe(problem.system.H, np.array([problem.q0]), np.array([problem.p0]))[0])


def at(problem, *times, **start):
    """(q, p) of the reference at increasing times, with uncertainties below 1e-14 (1 + size of the state)."""
    found = reference(problem, [float(t) for t in times], **start)
    for uncertainty, q, p in zip(found.uncertainty, found.q, found.p, strict=True):
        assert uncertainty < 1e-14 * (1 + np.abs([q, p]).max())
    return list(zip(found.q, found.p, strict=True))


def rate(system, expression):
    """d/dt of an expression along the flow."""
    return sum(expression.diff(x) * dx for x, dx in zip((*system.q, *system.p), (*system.dq, *system.dp), strict=True))


def vanish(system, expressions):
    """True if the expressions are zero to 30 digits at four random rational points."""
    f = sp.lambdify([[*system.q, *system.p]], expressions, "mpmath")
    rng = np.random.default_rng(1)
    with mpmath.workdps(40):
        for _ in range(4):
            y = [mpf(int(x)) / 1000 for x in rng.integers(200, 900, 2 * system.d)]
            if max(abs(v) for v in f(y)) > mpf(10) ** -30:
                return False
    return True


def test_double_pendulum_mechanics_and_frequencies():
    """H is the energy of two masses on rods, in Cartesian coordinates; Landau & Lifshitz, section 23, problem 2."""
    values = {"m1": 1.5, "m2": 0.75, "l1": 1.25, "l2": 0.5, "g": 9.75}
    s = make_problem("double-pendulum", **values).system
    m1, m2, l1, l2, g = map(sp.Rational, values.values())
    (a, b), (da, db) = s.q, s.dq
    x, y = sp.Matrix([l1 * sp.sin(a), l1 * sp.sin(a) + l2 * sp.sin(b)]), -sp.Matrix([l1 * sp.cos(a), l1 * sp.cos(a)])
    y[1] -= l2 * sp.cos(b)
    speeds = [[z[i].diff(a) * da + z[i].diff(b) * db for z in (x, y)] for i in (0, 1)]
    kinetic = sum(m * (u**2 + v**2) / 2 for m, (u, v) in zip((m1, m2), speeds, strict=True))
    potential = g * (m1 * y[0] + m2 * y[1])
    assert vanish(s, [kinetic + potential - s.H])
    assert not vanish(s, [kinetic - potential - s.H])

    def squares(problem):
        rest = dict.fromkeys((*problem.system.q, *problem.system.p), 0)
        hessian = problem.system.hessian().subs(rest)
        return sorted(float(w) for w in (hessian[2:, 2:] * hessian[:2, :2]).eigenvals())

    expected = [2 - 2**0.5, 2 + 2**0.5]
    assert squares(make_problem("double-pendulum", l1=0.5, l2=0.5, g=2.0)) == pytest.approx([4 * w for w in expected])
    assert squares(make_problem("double-pendulum", m2=2.0)) != pytest.approx(expected, rel=0.01)


def test_double_pendulum_chaotic_and_regular_orbits():
    growth = {}
    for orbit in ("chaotic", "regular"):
        problem = make_problem(f"double-pendulum:{orbit}")
        q0 = (problem.q0[0] + 1e-9, problem.q0[1])
        near, far = (reference(problem, [100.0], certify=False, q0=q) for q in (problem.q0, q0))
        growth[orbit] = np.abs([near.q - far.q, near.p - far.p]).max() / 1e-9
    assert growth["chaotic"] > 1e6
    assert growth["regular"] < 100


@pytest.mark.parametrize(
    ("orbit", "alpha"), [("one-well", -1.0), ("near-separatrix", -1.0), ("both-wells", -1.0), ("one-well", 1.5)]
)
def test_duffing_is_an_elliptic_function(orbit, alpha):
    """The Duffing oscillator's orbit is the elliptic function of NIST DLMF 22.19(ii)."""
    problem = make_problem(f"duffing:{orbit}", alpha=alpha)
    (a,) = problem.q0
    with mpmath.workdps(30):
        period = duffing.exact(alpha, 1, a, 0)[1]
        for t in (3.0, float(period)):
            ((q, p),) = at(problem, t)
            assert abs(q[0] - duffing.exact(alpha, 1, a, t)[0]) < 1e-15
            assert abs(p[0] - mpmath.diff(lambda x: duffing.exact(alpha, 1, a, x)[0], t)) < 1e-14
        assert abs(duffing.exact(alpha * (1 + 1e-9), 1, a, 3.0)[0] - at(problem, 3.0)[0][0][0]) > 1e-11
        half = float(period / 2)
        assert abs(at(problem, half)[0][0][0] - a) > 0.1, "the period is the least one"


def test_quadrupole_boson_against_its_benchmark():
    """The force as SciMLBenchmarks writes it; H = 120 and 20 at the starts; an equilateral triangle's symmetry."""
    problem = make_problem("quadrupole-boson")
    s = problem.system
    A, B, D = map(sp.Rational, problem.parameters.values())
    (x, y), r2 = s.q, sum(z**2 for z in s.q)
    force = (-A * x - 3 * B / sp.sqrt(2) * (y**2 - x**2) - D * x * r2, -y * (A + 3 * sp.sqrt(2) * B * x + D * r2))
    assert all(sp.expand(a - b) == 0 for a, b in zip(force, s.dp, strict=True))
    assert energy(problem) == pytest.approx(120, rel=1e-15)
    assert energy(make_problem("quadrupole-boson:h20")) == pytest.approx(20, rel=1e-15)
    c, t = sp.Rational(-1, 2), sp.sqrt(3) / 2
    turned = {x: c * x - t * y, y: t * x + c * y}
    potential = s.potential
    assert sp.expand(potential.subs(turned, simultaneous=True) - potential) == 0
    assert sp.expand(potential.subs({x: -x}) - potential) != 0


def test_quadrupole_boson_period_on_its_axis():
    """Along q2 = 0 the period is a quadrature."""
    problem = make_problem("quadrupole-boson")
    s = problem.system
    V = sp.lambdify(s.q[0], s.potential.subs(s.q[1], 0), "mpmath")
    with mpmath.workdps(30):
        low = mpf(-2)
        high = mpmath.findroot(lambda x: V(x) - V(low), (2, 4), solver="anderson")
        middle, half = (low + high) / 2, (high - low) / 2

        def pace(angle):
            x = middle + half * mpmath.sin(angle)
            return half * mpmath.cos(angle) / mpmath.sqrt(2 * (V(low) - V(x)))

        period = 2 * mpmath.quad(pace, [-mpmath.pi / 2, 0, mpmath.pi / 2], method="gauss-legendre")
    (far, _), (q, p) = at(problem, period / 2, period, q0=(-2.0, 0.0), p0=(0.0, 0.0))
    assert np.abs([*(q - (-2.0, 0.0)), *p]).max() < 1e-13
    assert far[0] == pytest.approx(float(high), abs=1e-13)


def test_figure_eight_data_and_period():
    """Chenciner & Montgomery 2000: data and period to eight digits; each body takes the next one's place in T/3."""
    problem, T = make_problem("figure-eight"), three_body.PERIOD
    printed = (0.97000436, -0.24308753), (-0.93240737, -0.86473146)
    assert np.abs(np.array([three_body.FIRST, three_body.THIRD]) - printed).max() < 5.1e-9
    assert abs(T - 6.32591398) < 5.1e-9
    (q, p), (end, momenta) = at(problem, T / 3, T)
    assert np.abs([end - problem.q0, momenta - problem.p0]).max() < 5e-15
    found, start = np.hstack([q.reshape(3, 2), p.reshape(3, 2)]), np.array([problem.q0, problem.p0]).reshape(2, 3, 2)
    assert np.abs(np.roll(found, 2, axis=0) - np.hstack(list(start))).max() < 5e-15
    (x, y), (u, v) = printed
    q0, p0 = (x, y, -x, -y, 0.0, 0.0), (-u / 2, -v / 2, -u / 2, -v / 2, u, v)
    ((q, _),) = at(problem, T, q0=q0, p0=p0)
    assert 1e-9 < np.abs(q - q0).max() < 1e-6, "the control: eight digits return to eight digits"


@pytest.mark.parametrize("N", [3, 5])
def test_toda_lattice_spectrum_and_wave(N):
    """Flaschka 1974 (the spectrum), Toda 1967 (the wave): the state at t = 3 against both."""
    problem = make_problem("toda:cnoidal", N=N)
    ((q, p),) = at(problem, 3.0)

    def spectrum(q, p):
        L = np.diag(p)
        for i in range(N):
            a = np.exp((q[i] - q[(i + 1) % N]) / 2)
            L[i, (i + 1) % N] += a
            L[(i + 1) % N, i] += a
        return np.linalg.eigvalsh(L)

    first, last = spectrum(problem.q0, problem.p0), spectrum(q, p)
    assert np.abs(first - last).max() < 1e-13
    assert np.abs(np.array(problem.p0) - p).max() > 0.1
    for k in (1, *range(3, N + 1)):
        expected = (first**k).sum() / k - (2 if k == N else 0)
        kept = problem.invariants["momentum" if k == 1 else f"trace-{k}"]
        assert problem.system.observe(kept, [problem.q0], [problem.p0])[0] == pytest.approx(expected, abs=1e-12)
    with mpmath.workdps(30):
        for m, right in ((toda.MODULUS, True), (toda.MODULUS + 1e-6, False)):
            difference = np.array(toda.cnoidal(N, m, 3.0)) - [q, p]
            assert (abs(difference).max() < 2e-15) == right


def test_rigid_body_has_eulers_equations():
    problem = make_problem("rigid-body", I1=1.5, I2=0.75, I3=2.5, G=1.25)
    s = problem.system
    moments = [sp.Rational(x) for x in (1.5, 0.75, 2.5)]
    across = sp.sqrt(sp.Rational(1.25) ** 2 - s.p[0] ** 2)
    m = sp.Matrix([across * sp.sin(s.q[0]), across * sp.cos(s.q[0]), s.p[0]])
    right = m.cross(sp.Matrix([a / b for a, b in zip(m, moments, strict=True)]))
    assert vanish(s, [rate(s, a) - b for a, b in zip(m, right, strict=True)])
    assert not vanish(s, [rate(s, a) + b for a, b in zip(m, right, strict=True)])


@pytest.mark.parametrize("orbit", ["around-e3", "around-e1", "near-separatrix"])
def test_rigid_body_period(orbit):
    """Landau & Lifshitz, section 37: 4 K over the rate of the elliptic functions."""
    problem = make_problem(f"rigid-body:{orbit}")
    with mpmath.workdps(30):
        A, B, C = (mpf(problem.parameters[k]) for k in ("I1", "I2", "I3"))
        f = sp.lambdify((*problem.system.q, *problem.system.p), problem.system.H, "mpmath")
        E = f(mpf(problem.q0[0]), mpf(problem.p0[0]))
        if 2 * E * B > 1:
            A, C = C, A
        pace = (A - B) * (1 - 2 * E * C) / (A * B * C)
        k2 = (B - C) * (2 * E * A - 1) / ((A - B) * (1 - 2 * E * C))
        period = 4 * mpmath.ellipk(k2) / mpmath.sqrt(pace)
    (middle, momentum), (q, p) = at(problem, period / 2, period)
    turns = (q[0] - problem.q0[0]) / (2 * np.pi)
    assert abs(turns - round(turns)) < 1e-13
    assert abs(round(turns)) == (0 if orbit == "around-e1" else 1)
    assert abs(p[0] - problem.p0[0]) < 1e-13
    apart = abs(np.exp(1j * middle[0]) - np.exp(1j * problem.q0[0])) + abs(momentum[0] - problem.p0[0])
    assert apart > 0.01, "half a period is none"


def test_charged_particle_obeys_the_lorentz_force():
    """He, Sun, Liu & Qin 2015, section 4.1: B = R, E = phi0 q / R^3, q = (0, -1), v = (0.1, 0.01)."""
    problem = make_problem("charged-particle")
    s = problem.system
    (x, y), (u, v) = s.q, s.dq
    R = sp.sqrt(x**2 + y**2)
    E = [sp.Rational(problem.parameters["phi0"]) * z / R**3 for z in s.q]
    assert vanish(s, [rate(s, u) - R * v - E[0], rate(s, v) + R * u - E[1]])
    assert not vanish(s, [rate(s, u) + R * v - E[0], rate(s, v) - R * u - E[1]])
    velocity = [float(s.observe(e, [problem.q0], [problem.p0])[0]) for e in s.dq]
    assert velocity == pytest.approx([0.1, 0.01], abs=1e-16)


def test_charged_particle_gyration_and_drift():
    """After a period of the radius the state is the initial one, rotated by the integral of theta'."""
    problem = make_problem("charged-particle")
    s = problem.system
    with mpmath.workdps(30):
        y0 = [mpf(x) for x in (*problem.q0, *problem.p0)]
        H, L = (sp.lambdify([[*s.q, *s.p]], e, "mpmath")(y0) for e in (s.H, problem.invariants["angular-momentum"]))

        def square(r):  # of the radial velocity
            return 2 * (H - mpf(0.01) / r) - (L / r - r**2 / 3) ** 2

        low, high = (mpmath.findroot(square, x, solver="anderson") for x in ((0.9, 1.05), (1.1, 1.3)))
        middle, half = (low + high) / 2, (high - low) / 2

        def integral(weight):
            def f(angle):
                r = middle + half * mpmath.sin(angle)
                return weight(r) * half * mpmath.cos(angle) / mpmath.sqrt(square(r))

            return 2 * mpmath.quad(f, [-mpmath.pi / 2, 0, mpmath.pi / 2], method="gauss-legendre")

        period, turn = float(integral(lambda r: 1)), float(integral(lambda r: L / r**2 - r / 3))
    (q, p), (later, _) = at(problem, period, 2 * np.pi)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    assert np.abs([q - rotation @ problem.q0, p - rotation @ problem.p0]).max() < 1e-13
    assert period == pytest.approx(2 * np.pi / float(middle), rel=0.01)
    assert abs(turn) > 0.01
    assert abs(np.hypot(*later) - 1) > 1e-6, "the control: not after the gyration in a uniform field"


def test_magnetic_mirror_obeys_the_lorentz_force():
    """v' = v x B with B = (-x z / L^2, -y z / L^2, 1 + z^2 / L^2); and the start."""
    s = make_problem("magnetic-mirror").system
    (x, y, z), v = s.q, sp.Matrix(s.dq)
    B = sp.Matrix([-x * z, -y * z, 100 + z**2]) / 100
    force = v.cross(B)
    assert vanish(s, [rate(s, a) - f for a, f in zip(v, force, strict=True)])
    assert not vanish(s, [rate(s, a) + f for a, f in zip(v, force, strict=True)])
    problem = make_problem("magnetic-mirror")
    assert [float(s.observe(e, [problem.q0], [problem.p0])[0]) for e in s.dq] == pytest.approx([0, 0.3, 0.2], abs=1e-16)


@pytest.mark.parametrize("L", [10.0, 20.0])
def test_magnetic_mirror_bounces_as_its_magnetic_moment_has_it(L):
    """Northrop 1963: frequency v_perp / L, turning point L v_par / v_perp, up to (radius of gyration / L)^2."""
    period = 2 * np.pi * L / 0.3
    s = integrate(make_problem("magnetic-mirror", L=L), "gauss-6", h=0.1, t_end=1.1 * period)
    z = s.q[:, 2]
    (k,) = np.nonzero((z[:-1] < 0) & (z[1:] >= 0))[0]
    crossing = s.t[k] - z[k] * (s.t[k + 1] - s.t[k]) / (z[k + 1] - z[k])
    assert abs(crossing / period - 1) < 0.15 / L**2
    assert z.max() == pytest.approx(L * 0.2 / 0.3, rel=0.5 / L**2)
    assert z.min() == pytest.approx(-z.max(), rel=1 / L**2)
    B = 1 + z**2 / L**2
    parallel = s.p[:, 2]  # up to the tilt of the field lines
    moment = (0.3**2 + 0.2**2 - parallel**2) / 2 / B
    assert np.ptp(moment) < 0.1 * moment[0]
    assert np.ptp(moment * B) > 0.3 * moment[0], "the control: the energy of gyration is not kept"


@pytest.mark.parametrize(
    ("name", "semilatus", "e", "tolerance"),
    [("precessing", 10.0, 0.5, 1e-12), ("precessing", 1000.0, 0.2, 1e-9), ("zoom-whirl", 7.001, 0.5, 1e-10)],
)
def test_schwarzschild_precession_by_elliptic_integral(name, semilatus, e, tolerance):
    """Cutler, Kennefick & Poisson 1994, section II; in weak fields by 6 pi M / (a (1 - e^2))."""
    values = {} if name == "zoom-whirl" else {"semilatus": semilatus, "e": e}
    problem = make_problem(f"schwarzschild:{name}", **values)
    with mpmath.workdps(30):
        x, e = mpf(semilatus), mpf(e)

        def proper(chi):
            return (
                x**1.5
                * mpmath.sqrt((x - 3 - e**2) / (x - 6 - 2 * e * mpmath.cos(chi)))
                / (1 + e * mpmath.cos(chi)) ** 2
            )

        period = 2 * mpmath.quad(proper, mpmath.linspace(0, mpmath.pi, 9))
        advance = 4 * mpmath.sqrt(x / (x - 6 + 2 * e)) * mpmath.ellipk(4 * e / (x - 6 + 2 * e))
        weak = 2 * mpmath.pi + 6 * mpmath.pi / x
    ((q, p),) = at(problem, period)
    assert abs(q[1] - problem.q0[1]) < tolerance * semilatus
    assert abs(p[1]) < tolerance
    assert abs(q[2] - advance) < tolerance
    assert abs(q[2] - weak) > 1e-6
    assert (abs(advance - weak) < 1e-3) == (semilatus > 100)
    assert energy(problem) == pytest.approx(-0.5, rel=1e-14)


def test_schwarzschild_circular_orbits():
    """The innermost stable circle is neutral; at r = 3M light departs at the rate 1 / sqrt(27) in coordinate time."""
    problem = make_problem("schwarzschild")
    (_, r, _), (pt, pr, pphi), H = problem.system.q, problem.system.p, problem.system.H
    cases = {"isco": (6, sp.sqrt(sp.Rational(8, 9)), sp.sqrt(12)), "photon-sphere": (3, 1, sp.sqrt(27))}
    for name, (radius, E, L) in cases.items():
        here = {r: radius, pt: -E, pr: 0, pphi: L}
        square = sp.simplify((-H.diff(r, 2) * H.diff(pr, 2)).subs(here))
        pace = H.diff(pt).subs(here)
        assert sp.simplify(H.diff(r).subs(here)) == 0
        assert sp.simplify(square / pace**2 - (0 if name == "isco" else sp.Rational(1, 27))) == 0
        assert H.subs(here) == (sp.Rational(-1, 2) if name == "isco" else 0)
        start = problem.at(name)
        assert start.q0 == (0.0, radius, 0.0)
        assert start.p0 == pytest.approx([float(-E), 0.0, float(L)], rel=1e-15)


def test_argon_crystal_energy_and_temperature():
    """Hairer, Lubich & Wanner 2006, I.4: H / k_B near -1260.2 K and 22.72 K; total momentum zero."""
    problem = make_problem("lennard-jones")
    temperature = sum(x**2 for x in problem.p0) / (2 * 7) * lennard_jones.EPSILON
    assert energy(problem) * lennard_jones.EPSILON == pytest.approx(-1260.2, abs=0.05)
    assert temperature == pytest.approx(22.72, abs=0.005)
    assert np.abs(np.reshape(problem.p0, (7, 2)).sum(axis=0)).max() < 1e-15
    distances = sorted(float(problem.system.observe(r, [problem.q0], [problem.p0])[0]) for r in problem.system.singular)
    assert [round(x / 2 ** (1 / 6)) for x in distances[:13]] == [1] * 12 + [2], "one in the middle of six"


def test_pythagorean_problem_by_szebehely_and_peters():
    """Energy -769/60; masses 4 and 5 approach to 4e-4 near t = 15.83; the lightest escapes from a binary."""
    problem = make_problem("n-body")
    assert energy(problem) == pytest.approx(-769 / 60, rel=1e-14)
    grid = np.array([15.829 + i * 2e-5 for i in range(100)])
    found = reference(problem, np.array([*grid, 70.0]), certify=False)
    places, speeds = (x[-1].reshape(3, 3) for x in (found.q, found.p / np.repeat([3, 4, 5], 3)))
    gaps = np.linalg.norm(found.q[:-1, 3:6] - found.q[:-1, 6:], axis=1)
    assert gaps.min() == pytest.approx(4e-4, rel=0.1)
    assert grid[gaps.argmin()] == pytest.approx(15.83, abs=5e-3)

    def two_body(i, j, mass):
        (x, v), (y, w) = i, j
        return np.sum((v - w) ** 2) / 2 - mass / np.linalg.norm(x - y)

    first, second, third = zip(places, speeds, strict=True)
    pair = tuple((4 * a + 5 * b) / 9 for a, b in zip(second, third, strict=True))
    assert two_body(first, pair, 12) > 0.1
    assert two_body(second, third, 9) < -1


def test_n_body_loops_agree_with_the_formula():
    problem = make_problem("n-body", N=7)
    s = problem.system
    q, p = np.array(problem.q0), np.array(problem.p0)
    derived = [[float(s.observe(e, [q], [p])[0]) for e in side] for side in (s.dq, s.dp)]
    assert np.abs(np.array(s.field()(q, p, 0.0, 0.0)) - derived).max() < 1e-14 * np.abs(derived).max()
    assert np.abs(s.grad_V()(q) + derived[1]).max() < 1e-14 * np.abs(derived).max()
    value, size = s.energy()(q, p)
    plain = sp.lambdify([[*s.q, *s.p]], s.H, "math")([*problem.q0, *problem.p0])
    assert value == pytest.approx(plain, rel=1e-13)
    assert size > abs(value)
    run = integrate(problem, "stormer-verlet", h=1e-3, steps=100)
    assert run.status == "ok"
    for kept in problem.invariants.values():
        assert np.abs(np.diff(s.observe(kept, run.q, run.p))).max() < 1e-12
    assert 0 < np.abs(s.observe(s.H, run.q, run.p) - value).max() < 1e-5 * abs(value)


def test_plummer_sphere():
    """Aarseth, Henon & Wielen 1974: half the mass within 1.3 core radii of 3 pi / 16, energy -1/4."""
    where, speed = (np.reshape(z, (128, 3)) for z in n_body.plummer(128))
    assert np.abs([where.sum(0), speed.sum(0)]).max() < 1e-12
    assert np.median(np.linalg.norm(where, axis=1)) == pytest.approx(1.3048 * 3 * np.pi / 16, rel=0.15)
    gaps = np.linalg.norm(where[:, None] - where[None], axis=2)[np.triu_indices(128, 1)]
    kinetic = (speed**2).sum() / 256
    assert kinetic == pytest.approx(0.25, rel=0.15)
    assert kinetic - (1 / gaps).sum() / 128**2 == pytest.approx(-0.25, rel=0.15)


@pytest.mark.parametrize(
    ("name", "parameters", "message"),
    [
        ("double-pendulum", {"l1": 0.0}, "positive"),
        ("duffing", {"beta": -1.0}, "positive"),
        ("duffing:both-wells", {"alpha": 1.0}, "no orbit"),
        ("toda", {"N": 2}, "from 3 to"),
        ("toda", {"N": 3.5}, "integer"),
        ("rigid-body", {"I2": -1.0}, "positive"),
        ("charged-particle", {"phi0": -0.1}, "negative"),
        ("magnetic-mirror", {"L": 0.0}, "positive"),
        ("schwarzschild", {"M": 0.0}, "positive"),
        ("schwarzschild", {"e": 1.0}, "eccentricity"),
        ("schwarzschild", {"semilatus": 7.0}, "greater than 6"),
        ("n-body", {"N": 1}, "from 2 to"),
    ],
)
def test_invalid_parameters_are_refused(name, parameters, message):
    with pytest.raises(InvalidInput, match=message):
        make_problem(name, **parameters)


@pytest.mark.parametrize(("orbit", "t", "most"), [("regular", 100.0, 1e-12), ("chaotic", 10.0, 1e-11)])
def test_double_pendulum_is_the_same_in_both_coordinates(orbit, t, most):
    """The certified states of both, in Cartesian coordinates; they start apart by the rounding of sines."""
    angles, points = (
        at(make_problem(f"{id}:{orbit}"), t)[0] for id in ("double-pendulum", "double-pendulum-cartesian")
    )
    (a, b), (pa, pb) = angles
    c = np.cos(a - b)
    da, db = np.linalg.solve(np.array([[2.0, c], [c, 1.0]]), [pa, pb])
    one, two = np.array([np.sin(a), -np.cos(a)]), np.array([np.sin(b), -np.cos(b)])
    u, v = da * np.array([np.cos(a), np.sin(a)]), db * np.array([np.cos(b), np.sin(b)])
    q, p = np.concatenate([one, one + two]), np.concatenate([u, u + v])
    assert np.abs(q - points[0]).max() < most
    assert np.abs(p - points[1]).max() < most
    assert np.abs(q - at(make_problem(f"double-pendulum-cartesian:{orbit}"), 1.0)[0][0]).max() > 1e-3


def test_spherical_pendulum_is_that_of_its_angles():
    """The certified state beside an integration in spherical angles, by SciPy."""
    problem = make_problem("spherical-pendulum")
    ((q, p),) = at(problem, 10.0)
    x, y, z = problem.q0
    u, v, w = problem.p0
    L = x * v - y * u

    def field(_, s):  # theta from the downward vertical, its rate, phi
        theta, rate, _ = s
        return [rate, L**2 * np.cos(theta) / np.sin(theta) ** 3 - np.sin(theta), L / np.sin(theta) ** 2]

    start = [np.arccos(-z), w / np.sin(np.arccos(-z)), np.arctan2(y, x)]
    theta, rate, phi = solve_ivp(field, (0, 10), start, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    expected = [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), -np.cos(theta)]
    assert np.abs(expected - np.array(q)).max() < 1e-10
    assert abs(rate * np.sin(theta) - p[2]) < 1e-10


def test_four_points_move_as_euler_s_equations_have_it():
    """The certified state beside Euler's equations in the body's frame and the rotation matrix, by SciPy."""
    problem = make_problem("four-points")
    ((q, p),) = at(problem, 10.0)
    masses = np.array([problem.parameters[f"m{k}"] for k in range(1, 5)])[:, None]
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
        turned = make_problem("butane", phi=phi)
        value = sum(float(a) * np.cos(phi) ** k for k, a in enumerate(butane.TORSION))
        assert turned.system.energies(np.array([turned.q0]), np.zeros((1, 12)))[0] == pytest.approx(value, abs=1e-12)
    assert abs(sum(butane.TORSION)) < 1e-12, "trans is the valley"
    molecule = make_problem("butane")
    s = integrate(molecule, "rattle", h=0.02, steps=200)
    assert s.status == "ok"
    r = s.q.reshape(-1, 4, 3)
    for k, square in ((1, 1.0), (2, 8 / 3)):
        assert np.abs(((r[:, k:] - r[:, :-k]) ** 2).sum(axis=2) - square).max() < 1e-14
    for name in (f"angular-momentum-{k}" for k in (1, 2, 3)):
        assert np.abs(s.invariants()[name] - s.invariants()[name][0]).max() < 1e-13
    half = integrate(molecule, "rattle", h=0.01, steps=400)
    assert 3.5 < np.ptp(s.energy()) / np.ptp(half.energy()) < 4.5
