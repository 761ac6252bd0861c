"""Charged particles: H recognized, E and B, and the methods beside an implementation that shares nothing with them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.measure.battery import MAGNETIC, SYSTEMS, relativistic_particle
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.registry import METHODS
from phasebench.integrators.systems import magnetic

IDS = [m.id for m in METHODS if m.family == "magnetic"]


def plane(H: str) -> Hamiltonian:
    return Hamiltonian(q="x y", p="u v", H=H)


def space(H: str) -> Hamiltonian:
    return Hamiltonian(q="x y z", p="u v w", H=H)


# -- what is recognized -----------------------------------------------------------------------------------------------

OF_PLANE = (
    "(u**2 + v**2)/2 + y*u - x*v - 1/sqrt(x**2 + y**2)",
    "((u + x*y)**2 + (v - x**3)**2)/6 + x*y**2",
    "sqrt(1 + (u + y)**2 + v**2) + y**2",
)


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
EVERY |= {H: (lambda H=H: plane(H)) for H in OF_PLANE}


@pytest.mark.parametrize("name", EVERY)
def test_hamiltons_equations_are_those_of_the_fields(name):
    """u' = E + x' x B along the flow, with u from p by the formula; a sign changed in B does not pass."""
    system = EVERY[name]()
    found = magnetic.particle(system)
    assert (
        system.traits["magnetic"]
        == found.kind
        == ("relativistic" if "sqrt(1" in name or "rel" in name else "classical")
    )
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


@pytest.mark.parametrize(
    "H",
    [
        "(u**2 + v**2)/2 - x*y**2",  # no field
        "((u + y)**2 + (v + x)**2)/2",  # curl A = 0
        "((u + y)**2 + 2*v**2)/2",  # two masses
        "((u + y)**2 + v**2)*(1 + x**2)/2",  # a mass that varies
        "((u + y)**2 + v**2 + u*v)/2",  # momenta that are coupled
        "((u + y)**2 + v**2)**2/2",  # another power
        "sqrt(1 + x**2 + (u + y)**2 + v**2)",  # a rest energy that varies
        "sqrt(1 + (u + y)**2 + v**2)*x",
    ],
)
def test_what_is_not_magnetic(H):
    assert plane(H).traits["magnetic"] == ""
    with pytest.raises(InvalidInput, match="'boris' requires a system with the trait 'magnetic', which this one lacks"):
        integrate(plane(H), "boris", h=0.1, steps=1, q0=[1.0, 0.5], p0=[0.2, 0.1])


# -- how the kernel carries a state -----------------------------------------------------------------------------------


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


# -- structure --------------------------------------------------------------------------------------------------------


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
