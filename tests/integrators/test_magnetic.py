"""Charged particles: H recognized, E and B, and the methods beside an implementation that shares nothing with them."""

from __future__ import annotations

from functools import cache

import mpmath
import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.measure.battery import MAGNETIC, SYSTEMS, relativistic_particle
from phasebench.benchmarks.measure.step_map import jacobian, symplecticity_defect, volume
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, integrate, integrate_ensemble
from phasebench.integrators.compile import codegen
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.registry import METHODS, method
from phasebench.integrators.stepping.kernel import prepare
from phasebench.integrators.systems import magnetic
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from support.solutions import end, last

IDS = [m.id for m in METHODS if m.family == "magnetic"]


def plane(H: str) -> Hamiltonian:
    return Hamiltonian(q="x y", p="u v", H=H)


def space(H: str) -> Hamiltonian:
    return Hamiltonian(q="x y z", p="u v w", H=H)


# -- what is recognized -----------------------------------------------------------------------------------------------

#: H -> (kind, E, B), by hand.
FIELDS = {
    "((u + y/2)**2 + (v - x/2)**2)/2 - x": ("classical", ("1", "0"), ("1", "0")),
    "u**2/2 + v**2/2 + u*y/2 - v*x/2 + x**2/8 + y**2/8": ("classical", ("0", "0"), ("1", "0")),
    "(u**2 + v**2)/2 + y*u - x*v - 1/sqrt(x**2 + y**2)": (
        "classical",
        ("x - x/(x**2 + y**2)**(3/2)", "y - y/(x**2 + y**2)**(3/2)"),
        ("2", "0"),
    ),
    "((u + x*y)**2 + (v - x**3)**2)/6 + x*y**2": ("classical", ("-y**2/3", "-2*x*y/3"), ("x**2 + x/3", "0")),
    "sqrt(1 + (u + y)**2 + v**2) + y**2": ("relativistic", ("0", "-2*y"), ("1", "0")),
}


@pytest.mark.parametrize("H", FIELDS)
def test_the_fields_of_a_formula_in_the_plane(H):
    system = plane(H)
    kind, E, B = FIELDS[H]
    found = magnetic.particle(system)
    assert system.traits["magnetic"] == magnetic.kind(system) == found.kind == kind
    for mine, given in zip((*found.E, *found.B), (*E, *B), strict=True):
        wanted = sp.sympify(given, {str(s): s for s in system.q})
        assert sp.simplify(mine - wanted) == 0, (mine, given)


#: Systems in space, in all of which every component of B and E varies.
TILTED = "(u + y*(1 + z**2)/2)**2 + (v - x*(1 + z**2)/2 - z**2/4)**2 + (w - x*y/3)**2"
POTENTIAL = "x**2*y/4 - y*z/3 + z**4/8"
OF_SPACE = {
    "unit": f"({TILTED})/2 + {POTENTIAL}",
    "heavy": f"({TILTED})/6 + {POTENTIAL}",
    "relativistic": f"3*sqrt(4 + {TILTED}) + {POTENTIAL}",
    "relativistic, expanded": f"sqrt(expanded) + {POTENTIAL}",
}


@cache
def particle_in_space(name: str) -> Hamiltonian:
    H = OF_SPACE[name]
    return space(H.replace("expanded", str(sp.expand(sp.sympify(f"7 + 2*({TILTED})")))))


EVERY = {name: (lambda name=name: SYSTEMS[name]()[0]) for name in MAGNETIC} | {
    name: (lambda name=name: particle_in_space(name)) for name in OF_SPACE
}


@pytest.mark.parametrize("name", EVERY)
def test_hamiltons_equations_are_those_of_the_fields(name):
    """u' = E + x' x B along the flow, with u from p by the formula; a sign changed in B does not pass."""
    system = EVERY[name]()
    found = magnetic.particle(system)
    x, p, dx, dp = system.q, system.p, system.dq, system.dp
    u = [(b - a) / found.mass for a, b in zip(found.A, p, strict=True)]
    rates = [sum(sp.diff(c, s) * r for s, r in zip((*x, *p), (*dx, *dp), strict=True)) for c in u]

    def force(B):
        if system.d == 2:
            return [dx[1] * B[0], -dx[0] * B[0]]
        return list(sp.Matrix(dx).cross(sp.Matrix(B)))

    at = dict(zip((*x, *p), map(sp.Rational, ("0.3", "-0.7", "0.4", "0.2", "0.9", "-0.6")), strict=False))
    for sign in (1, -1):
        right = [e + f for e, f in zip(found.E, force([sign * b for b in found.B]), strict=True)]
        apart = max(abs(sp.N((a - b).subs(at), 30)) for a, b in zip(rates, right, strict=True))
        assert (apart < 1e-25) == (sign == 1), apart
    speeds = [
        sp.N((a * sp.sqrt(1 + found.slowness * sum(c**2 for c in u)) - b).subs(at), 30)
        for a, b in zip(dx, u, strict=True)
    ]
    assert max(map(abs, speeds)) < 1e-25


def test_mass_and_speed_of_light():
    assert magnetic.constants(particle_in_space("heavy")) == (3, 0)
    mass, slowness = magnetic.constants(particle_in_space("relativistic"))  # 3 sqrt(4 + ...): c = 3, m c = 2
    assert (float(mass), float(slowness)) == pytest.approx((2 / 3, 1 / 9), rel=1e-15)
    mass, slowness = magnetic.constants(particle_in_space("relativistic, expanded"))  # c^2 = 2, m c^2 = sqrt(7)
    assert (float(mass), float(slowness)) == pytest.approx((7**0.5 / 2, 1 / 2), rel=1e-15)


def test_a_gradient_in_A_changes_no_field():
    gauge = "u - y/2 - x**2*y", "v + x/2 - x**3/3"
    a, b = plane("((u - y/2)**2 + (v + x/2)**2)/2 + x"), plane(f"(({gauge[0]})**2 + ({gauge[1]})**2)/2 + x")
    a, b = magnetic.particle(a), magnetic.particle(b)
    assert (a.E, a.B) == (b.E, b.B)
    assert a.A != b.A


@pytest.mark.parametrize(
    "H",
    [
        "(u**2 + v**2)/2 - x*y**2",  # no field
        "((u + y)**2 + (v + x)**2)/2",  # curl A = 0
        "((u + y)**2 + 2*v**2)/2",  # two masses
        "((u + y)**2 + v**2)*(1 + x**2)/2",  # a mass that varies
        "((u + y)**2 + v**2 + u*v)/2",  # momenta that are coupled
        "-((u + y)**2 + v**2)/2",  # no mass
        "((u + y)**2 + v**2)**2/2",  # another power
        "sqrt(1 + x**2 + (u + y)**2 + v**2)",  # a rest energy that varies
        "-sqrt(1 + (u + y)**2 + v**2)",
        "sqrt(1 + (u + y)**2 + v**2) + u",
        "sqrt(1 + (u + y)**2 + v**2)*x",
        "sqrt((u + y)**2 + v**2)",  # no mass at all
    ],
)
def test_what_is_not_magnetic(H):
    assert plane(H).traits["magnetic"] == ""
    with pytest.raises(InvalidInput, match="'boris' requires a system with the trait 'magnetic', which this one lacks"):
        integrate(plane(H), "boris", h=0.1, steps=1, q0=[1.0, 0.5], p0=[0.2, 0.1])


def test_one_and_four_degrees_of_freedom_are_not_magnetic():
    assert Hamiltonian(q="x", p="u", H="(u + x**2)**2/2").traits["magnetic"] == ""
    four = "((a - y)**2 + b**2 + c**2 + e**2)/2"
    assert Hamiltonian(q="x y z t", p="a b c e", H=four).traits["magnetic"] == ""
    bare = PartitionedSystem(q="x y", p="u v", dq=["u", "v"], dp=["v", "-u"], energy="u**2 + v**2")
    assert bare.traits["magnetic"] == ""


# -- one step and fifty, beside another implementation ----------------------------------------------------------------


def hat(B):
    """The matrix of v -> v x B."""
    return mpmath.matrix([[0, B[2], -B[1]], [-B[2], 0, B[0]], [B[1], -B[0], 0]])


def norm2(v):
    return sum(x * x for x in v)


class Mirror:
    """A charged particle in a magnetic mirror, written by hand: E(x), B(x), vector potential A(x), mass.

    E and B are divided by the mass; ``slowness`` is 1/c^2, or 0 if the particle is not relativistic.
    """

    mass, slowness = mpmath.mpf(1), mpmath.mpf(0)

    def E(self, x):
        return mpmath.matrix(3, 1)

    def B(self, x):
        return mpmath.matrix([-x[0] * x[2] / 100, -x[1] * x[2] / 100, 1 + x[2] ** 2 / 100])

    def A(self, x):
        half = (1 + x[2] ** 2 / 100) / 2
        return mpmath.matrix([-half * x[1], half * x[0], 0])


class Planar(Mirror):
    """The charged particle in the plane, written by hand: E(x), B(x), vector potential A(x)."""

    def E(self, x):
        R = mpmath.sqrt(norm2(x))
        return mpmath.mpf(0.01) * x / R**3

    def B(self, x):
        return mpmath.matrix([0, 0, mpmath.sqrt(norm2(x))])

    def A(self, x):
        R = mpmath.sqrt(norm2(x))
        return mpmath.matrix([-R * x[1] / 3, R * x[0] / 3, 0])


class Relativistic(Mirror):
    """`battery.relativistic_particle` by hand: H = 2 sqrt(1 + |p - A|^2) + phi."""

    mass, slowness = mpmath.mpf(1) / 2, mpmath.mpf(1) / 4

    def E(self, x):
        phi = (x[0] * x[1] / 2, x[0] ** 2 / 4 - x[2] / 3, -x[1] / 3 + x[2] ** 3 / 2)
        return -2 * mpmath.matrix(phi)

    def B(self, x):
        return 2 * mpmath.matrix([-x[0] * x[2] / 4, -x[1] * x[2] / 4, 1 + x[2] ** 2 / 4])

    def A(self, x):
        half = (1 + x[2] ** 2 / 4) / 2
        return mpmath.matrix([-half * x[1], half * x[0], 0])


class RelativisticPlane(Mirror):
    """A relativistic particle in the plane by hand: H = sqrt(1 + u^2 + (v - x - x^3 / 3)^2) - 4 x / 5 + y^2 / 2."""

    slowness = mpmath.mpf(1)

    def E(self, x):
        return mpmath.matrix([mpmath.mpf(4) / 5, -x[1], 0])

    def B(self, x):
        return mpmath.matrix([0, 0, 1 + x[0] ** 2])

    def A(self, x):
        return mpmath.matrix([0, x[0] + x[0] ** 3 / 3, 0])


BY_HAND = {
    "charged-particle": Planar(),
    "magnetic-mirror": Mirror(),
    "relativistic-particle": Relativistic(),
    "relativistic plane": RelativisticPlane(),
}


@cache
def case(name: str) -> tuple:
    """(system, q, p): the system of a name in `BY_HAND`, and an initial state."""
    if name in SYSTEMS:
        return SYSTEMS[name]()
    return plane("sqrt(1 + u**2 + (v - x - x**3/3)**2) - 4*x/5 + y**2/2"), (0.3, -0.4), (0.5, 0.9)


def gamma(of, u):
    return mpmath.sqrt(1 + of.slowness * norm2(u))


def turn_boris(of, u, B, h):
    """Boris's rotation of u: solve w - u = (w + u) x B h / (2 gamma(u)) for w."""
    half = hat(B) * (h / 2 / gamma(of, u))
    one = mpmath.eye(3)
    return mpmath.lu_solve(one - half, (one + half) * u)


def turn_higuera_cary(of, u, B, h):
    """Higuera and Cary's rotation of u: solve w - u = (w + u) x B h / (2 gamma) for w, gamma at (u + w) / 2."""
    g, one = gamma(of, u), mpmath.eye(3)
    for _ in range(400):
        half = hat(B) * (h / 2 / g)
        w = mpmath.lu_solve(one - half, (one + half) * u)
        last, g = g, gamma(of, (u + w) / 2)
        if abs(g - last) < mpmath.mpf(10) ** -38:
            return w
    raise ArithmeticError("gamma has not converged")


def turn_exactly(of, u, B, h):
    """The exact rotation of u by B over the time h: exp of its matrix, by the Taylor series."""
    M, term, total = hat(B) * (h / gamma(of, u)), mpmath.eye(3), mpmath.eye(3)
    for k in range(1, 60):
        term = term * M / k
        total += term
    return total * u


TURNS = {"boris": turn_boris, "higuera-cary": turn_higuera_cary, "he-splitting-2": turn_exactly}


def plain_step(of, turn, x, u, h):
    """One step (x, u) -> (x, u): half a drift, half a kick by E, the rotation by B, half a kick, half a drift."""
    x = x + h / 2 * u / gamma(of, u)
    E, B = of.E(x), of.B(x)
    u = turn(of, u + h / 2 * E, B, h) + h / 2 * E
    return x + h / 2 * u / gamma(of, u), u


@cache
def plain_run(id: str, name: str, h, steps: int) -> np.ndarray:
    """(q, p) after some steps of the method with this id, written here without the package, in 40 digits."""
    system, q, p = case(name)
    of, d = BY_HAND[name], system.d
    with mpmath.workdps(40):
        x, p = (mpmath.matrix([mpmath.mpf(z) for z in given] + [0] * (3 - d)) for given in (q, p))
        u, h = (p - of.A(x)) / of.mass, mpmath.mpf(h)
        if id == "he-splitting-4":
            root = mpmath.cbrt(2)
            lengths = [h / (2 - root), -root * h / (2 - root), h / (2 - root)]
        else:
            lengths = [h]
        for _ in range(steps):
            for part in lengths:
                x, u = plain_step(of, TURNS.get(id, turn_exactly), x, u, part)
        p = of.mass * u + of.A(x)
        return np.array([float(z) for z in (*x[:d], *p[:d])])


@pytest.mark.parametrize("steps", [1, 50])
@pytest.mark.parametrize("name", BY_HAND)
@pytest.mark.parametrize("id", IDS)
def test_steps_are_those_of_a_plain_implementation(id, name, steps):
    system, q, p = case(name)
    h = 0.125
    s = integrate(system, id, h=h, steps=steps, q0=q, p0=p)
    found = end(s)
    assert s.counts["gradient"] == steps * (3 if id == "he-splitting-4" else 1)
    plain = plain_run(id, name, h, steps)
    assert np.abs(found - plain).max() < 2e-15 * steps**0.5 * max(1, np.abs(plain).max()) * (1 if steps == 1 else 5)
    other = plain_run("he-splitting-2" if id == "boris" else "boris", name, h, steps)
    same = id == "higuera-cary" and not name.startswith("relativistic")
    assert (np.abs(found - other).max() < 1e-13) == same, "another rule is another step"


# -- how the kernel carries a state -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MAGNETIC)
@pytest.mark.parametrize("id", ["boris", "he-splitting-4"])
def test_rows_do_not_change_the_orbit(id, name):
    system, q, p = SYSTEMS[name]()
    often, seldom = (integrate(system, id, h=0.1, steps=60, q0=q, p0=p, save_every=k) for k in (1, 0))
    assert often.status == seldom.status == "ok"
    assert np.abs(often.q[-1] - seldom.q[-1]).max() < 1e-14
    assert np.abs(often.p[-1] - seldom.p[-1]).max() < 1e-14


@pytest.mark.parametrize("name", MAGNETIC)
def test_calls_of_the_kernel_do_not_change_the_orbit(name):
    """p is u + A(x), rounded: 4000 conversions would show if what rounding lost did not go with it."""
    system, q, p = SYSTEMS[name]()
    ends = []
    for pieces in (1, 4000):
        d, h = system.d, 0.001
        run = lay_out(prepare(method("boris"), system), d, h, np.array(q), np.array(p))
        Q, P = np.zeros((1, d)), np.zeros((1, d))
        for _ in range(pieces):
            assert run(Q, P, np.zeros((1, 1)), 4000 // pieces) == (1, 0)
        ends.append(np.concatenate([Q[0], P[0]]))
    assert np.abs(ends[0] - ends[1]).max() < 1e-15
    assert np.abs(ends[0] - np.array([*q, *p])).max() > 1e-2


@pytest.mark.parametrize("name", MAGNETIC)
@pytest.mark.parametrize("id", IDS)
def test_a_run_forth_and_back_returns(id, name):
    system, q, p = SYSTEMS[name]()
    there = integrate(system, id, h=0.1, steps=60, q0=q, p0=p, save_every=0)
    back = integrate(system, id, h=-0.1, steps=60, q0=there.q[-1], p0=there.p[-1], save_every=0)
    assert np.abs(there.q[-1] - q).max() > 1e-2
    assert np.abs(np.concatenate([back.q[-1] - q, back.p[-1] - p])).max() < 1e-13


@pytest.mark.parametrize("name", MAGNETIC)
@pytest.mark.parametrize("id", IDS)
def test_orbits_side_by_side_are_those_one_by_one(id, name):
    system, q, p = SYSTEMS[name]()
    rng = np.random.default_rng(1)
    Q, P = (np.array(x) * (1 + 0.1 * rng.uniform(-1, 1, (19, len(x)))) for x in (q, p))
    many = integrate_ensemble(system, id, Q, P, h=0.1, steps=60)
    assert set(many.status) == {"ok"}
    assert many.in_lanes.all() == codegen.compiled()
    for k in (0, 7, 18):
        one = integrate(system, id, h=0.1, steps=60, q0=Q[k], p0=P[k], save_every=0)
        assert np.abs(np.concatenate([many.q[k] - one.q[-1], many.p[k] - one.p[-1]])).max() < 1e-13


@pytest.mark.parametrize("id", IDS)
def test_a_speed_that_the_fields_keep_is_kept_to_round_off(id):
    """Without E every rotation keeps |v|; over 100,000 steps rounding alone moves it, as Brouwer's law has it."""
    s = integrate(problem("magnetic-mirror"), id, h=0.2, steps=100_000, save_every=1000)
    assert s.status == "ok"
    assert np.abs(s.energy() / s.energy()[0] - 1).max() < 1e-12
    control = integrate(problem("magnetic-mirror"), "rk4", h=0.2, steps=10_000, save_every=0)
    assert abs(control.energy()[-1] / control.energy()[0] - 1) > 1e-3


def test_the_exact_rotation_is_exact_in_a_uniform_field():
    """For any h; Boris's turns by 2 arctan(h B / 2) instead of h B (Birdsall & Langdon 1985, 4-4)."""
    system = plane("((u + y/2)**2 + (v - x/2)**2)/2")
    x, v = np.array([0.3, -0.2]), np.array([0.7, 0.4])
    p = v + np.array([-x[1], x[0]]) / 2

    def velocity(id, h):
        s = integrate(system, id, h=h, steps=1, q0=x, p0=p)
        return s.p[-1] - np.array([-s.q[-1][1], s.q[-1][0]]) / 2

    def turned(angle):  # v' = v x B, B along z
        return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]) @ v

    for h in (0.3, 1.0, 2.5, np.pi, 6.5):
        assert np.abs(velocity("he-splitting-2", h) - turned(h)).max() < 1e-14
        assert np.abs(velocity("boris", h) - turned(2 * np.arctan(h / 2))).max() < 1e-14


def test_where_the_field_vanishes_no_angle_is_divided_by():
    system = plane("((u + y**2/2)**2 + v**2)/2")  # B = y
    for id in IDS:
        s = integrate(system, id, h=0.5, steps=3, q0=[0.0, 0.0], p0=[1.0, 0.0])
        assert s.status == "ok"
        assert s.q[-1] == pytest.approx([1.5, 0.0], abs=1e-15)


# -- structure --------------------------------------------------------------------------------------------------------


def form_of_fields(system, x) -> np.ndarray:
    """The matrix K(x) of the two-form dx ^ m du + B in (x, u), which a symplectic step preserves."""
    found, d = magnetic.particle(system), system.d
    B = [float(b.subs(dict(zip(system.q, x, strict=True)))) * float(found.mass) for b in found.B]
    if d == 2:
        turned = np.array([[0.0, -B[0]], [B[0], 0.0]])
    else:
        turned = np.array([[0, -B[2], B[1]], [B[2], 0, -B[0]], [-B[1], B[0], 0.0]])
    one = float(found.mass) * np.eye(d)
    return np.block([[turned, one], [-one, np.zeros((d, d))]])


def step_in_velocities(system, id, h):
    """One step of a method as a map of (x, u), where u = (p - A(x)) / m."""
    shift, mass, d = magnetic.shift(system), float(magnetic.constants(system)[0]), system.d

    def f(y):
        x, u = y[:d], y[d:]
        s = integrate(system, id, h=h, steps=1, q0=x, p0=mass * (u + np.array(shift(tuple(x)))))
        q = s.q[-1]
        return np.concatenate([q, s.p[-1] / mass - np.array(shift(tuple(q)))])

    return f


@pytest.mark.parametrize("name", MAGNETIC)
@pytest.mark.parametrize("id", ["boris", "higuera-cary", "he-splitting-2", "implicit-midpoint", "gauss-4", "rk4"])
def test_K_symplecticity_is_symplecticity_in_p(id, name):
    """A step with Jacobian M in (x, u) has M^T K(x1) M = K(x0) if and only if it is symplectic in (q, p).

    The methods for charged particles that are not symplectic still preserve the volume of (x, u).
    """
    system, q, p = SYSTEMS[name]()
    h, d = 0.3, system.d
    f = step_in_velocities(system, id, h)
    mass = float(magnetic.constants(system)[0])
    y = np.concatenate([q, np.array(p) / mass - np.array(magnetic.shift(system)(tuple(map(float, q))))])
    M = jacobian(f, y)
    defect = np.abs(M.T @ form_of_fields(system, f(y)[:d]) @ M - form_of_fields(system, y[:d])).max()

    def canonical(z):
        return last(integrate(system, id, h=h, steps=1, q0=z[:d], p0=z[d:]))

    in_p = symplecticity_defect(jacobian(canonical, np.concatenate([q, p])))
    assert (defect < 1e-10) == (in_p < 1e-10) == method(id).symplectic, (defect, in_p)
    if not method(id).symplectic:
        assert min(defect, in_p) > 1e-6
    assert (volume(f, y, 1e-3)[0] < 1e-10) == (id != "rk4")


def test_higuera_and_cary_differ_from_boris_only_where_it_is_relativistic():
    for name in MAGNETIC:
        system, q, p = SYSTEMS[name]()
        a, b = (integrate(system, id, h=0.2, steps=10, q0=q, p0=p) for id in ("boris", "higuera-cary"))
        apart = np.abs(a.q - b.q).max()
        assert (apart > 1e-4) == (name == "relativistic-particle") == (apart != 0), name


def test_higuera_and_cary_find_the_drift_velocity():
    """A particle that drifts with E x B through crossed fields goes straight on, at any h; Boris's does not."""
    E, B = 0.8, 1.0  # v = E / B along y for E along x, B along z: (E x B)_y = -E_x B_z
    system = plane(f"sqrt(1 + u**2 + (v - x)**2) - {E}*x")
    v = np.array([0.0, -E / B])
    u = v / np.sqrt(1 - v @ v)
    for id, straight in (("higuera-cary", True), ("boris", False)):
        s = integrate(system, id, h=2.0, steps=20, q0=[0.0, 0.0], p0=u)
        assert (np.abs(s.q[:, 0]).max() < 1e-12) == straight, id
    assert relativistic_particle().traits["magnetic"] == "relativistic"
