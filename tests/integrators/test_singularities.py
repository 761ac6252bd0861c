"""Singular and softened distances found in formulas."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families import adaptive
from phasebench.integrators.systems import singularities
from phasebench.integrators.systems.transformed import TransformedHamiltonian, distance_scale


def of(V, **options):
    return Hamiltonian(q="x y", p="u v", H=f"(u**2 + v**2)/2 + {V}", **options)


def same(found, expected, system):
    wanted = [system._formula(e) for e in expected]
    return len(found) == len(wanted) and all(any(sp.simplify(a - b) == 0 for b in wanted) for a in found)


R = "sqrt(x**2 + y**2)"
#: V -> its distances that can vanish.
SINGULAR = {
    f"1/{R}": [R],
    "(x**2 + y**2)**(-1/2)": [R],
    f"3/{R}**3 - x/7": [R],
    f"exp(-{R})/{R}": [R],
    "log(x**2 + y**2)*y": [R],
    "1/sqrt((x - 1)**2 + y**2) - 2/sqrt((x + 3)**2 + y**2)": ["sqrt((x - 1)**2 + y**2)", "sqrt((x + 3)**2 + y**2)"],
    "1/x + x**2/2 - log(1 + x)": ["x", "x + 1"],
    "y + 1/(x**3 - x)": ["x", "x - 1", "x + 1"],
    "log(x*y)": ["x", "y"],
    "sin(x)**-2 + y": ["sin(x)"],
    "tan(x)**2 + y": ["cos(x)"],
    "1/(1 - cos(x)) + y": ["sqrt(1 - cos(x))"],
    "log(1 - x**2 - y**2)": ["x**2 + y**2 - 1"],
    f"1/(1 - 2/{R})": [R, f"{R} - 2"],
    "1/(x**4 + y**4)": ["(x**4 + y**4)**(1/4)"],
}
#: V -> its softened distances, which cannot vanish.
SOFTENED = {
    "-1/sqrt(x**2 + y**2 + 1/100)": ["sqrt(x**2 + y**2 + 1/100)"],
    "log(x**2 + 4*y**2 + 4/10000)/2": ["sqrt(x**2/4 + y**2 + 1/10000)"],
    "-1/((x - 1)**2 + y**2 + 1e-12)": [f"sqrt((x - 1)**2 + y**2 + {sp.Rational(1e-12)})"],
    "-1/(1 + x**2 + x*y + y**2)": ["sqrt(1 + x**2 + x*y + y**2)"],
    "y + 1/(1 + x**4)": ["(1 + x**4)**(1/4)"],
}
REGULAR = ["x**2*y - y**3/3", "exp(-40*x) + y", "y + 1/cosh(x)", "x/(2 + cos(y))", R, "log(1 + exp(x)) + y"]
REGULAR += ["1/(16 - 9*cos(x - y)**2)"]


@pytest.mark.parametrize("V", SINGULAR)
def test_singular_distances_are_found(V):
    system = of(V)
    assert same(system.singular, SINGULAR[V], system), system.singular
    assert not system.softened
    assert system.traits["singular distances"]


def test_softened_distances_are_not_singular():
    for V, distances in SOFTENED.items():
        system = of(V)
        assert not system.singular, V
        assert same(system.softened, distances, system), V
        assert system.singularities == 0, V
        assert system.traits["singular distances"], V


def test_regular_formulas_have_no_distances():
    with_momenta = Hamiltonian(q="x", p="u", H="x**2 + u**2 + 1/sqrt(1 + u**2 + x**2)")
    for system in (*map(of, REGULAR), with_momenta):
        assert system.singular == system.softened == ()
        assert not system.traits["singular distances"]


def test_declared_distances_override_those_found_which_are_exact():
    assert of("1/sqrt(x**2 - 2*x + 1 + y**2)").distances([[1 + 1e-9, 0.0]], [[0.0, 0.0]])[0, 0] == pytest.approx(
        1e-9, rel=1e-6
    )
    far = of(f"1/{R}", singular=["sqrt((x - 5)**2 + y**2)"])
    assert same(far.singular, ["sqrt((x - 5)**2 + y**2)"], far)
    none = of("1/sqrt(x**2 + y**2 + 1/100)", singular=())
    assert not none.singular
    assert not none.softened
    assert not none.traits["singular distances"]


#: Singularities of registered formulas that are not declared: inside the horizon, on the axis, |q| = 0 of a quaternion.
BEYOND = {
    "schwarzschild": {"r"},
    "magnetized-schwarzschild": {"r", "sin(theta)"},
    "kerr": {"r", "sin(theta)"},
    "heavy-top": {"sqrt(q0**2 + q1**2 + q2**2 + q3**2)"},
}


@pytest.mark.parametrize("id", [*BEYOND, "kepler", "henon-heiles", "outer-solar-system"])
def test_registered_problems_declare_their_distances(id):
    system = problem(id).system
    found = singularities.find(system.H, system.q, system.p)
    declared = {sp.simplify(e) for e in system.singular}
    extra = {e for e in map(sp.simplify, found.singular) if str(e) in BEYOND.get(id, ())}
    assert {*map(sp.simplify, found.singular)} - extra == declared
    assert {str(e) for e in extra} == BEYOND.get(id, set())
    assert not found.softened


def test_the_step_density_handles_signed_distances():
    system = of("1/(x - 2)**2")
    monitor = adaptive.monitor(system, DOUBLE)
    q, p, force, dt = np.array([1.5, 0.6]), np.array([0.7, -0.3]), np.array([-16.0, 0.0]), 1e-5
    before, now, after = (monitor(tuple(q + k * dt * p), tuple(p + k * dt * force)) for k in (-1, 0, 1))
    rate, second = 0.7 / 0.5, 16 / 0.5  # of x - 2, over it
    density = np.sqrt(np.sqrt(0.5**-6 + second**2) + rate**2)
    assert now[0] == pytest.approx(density, rel=1e-14)
    assert now[1] == pytest.approx((np.log(after[0]) - np.log(before[0])) / (2 * dt), rel=1e-7)
    assert float(distance_scale(system).subs(system.q[0], 1.5)) == pytest.approx(0.5**1.5)


def test_a_fall_through_a_softened_centre_is_no_collision():
    options = {"h": 0.02, "t_end": 12, "q0": [1.0, 0.0], "p0": [0.0, 0.0]}
    soft = integrate(of("-1/sqrt(x**2 + y**2 + 1e-4)"), "gauss-8-adaptive", **options)
    assert soft.status == "ok", soft.reason
    wide = integrate(of("-1/sqrt(x**2 + y**2 + 1e-4)"), "stormer-verlet", **options)
    assert wide.status != "collision", "a step that crosses the core and loses the energy"
    hard = integrate(of(f"-1/{R}"), "stormer-verlet", **options)
    assert hard.status == "collision", "the control"


# -- Poincare's time transformation ------------------------------------------------------------------------------------


ORBIT = problem("kepler", e=0.9)
SYSTEM = TransformedHamiltonian(ORBIT.system)
Q0, P0 = SYSTEM.start(ORBIT.q0, ORBIT.p0)


def test_the_field_is_the_scaled_original_field():
    r = np.linalg.norm(ORBIT.q0)
    new, old = SYSTEM.vector_field()(0, np.append(Q0, P0)), ORBIT.system.vector_field()(0, [*ORBIT.q0, *ORBIT.p0])
    assert np.allclose(new, r**1.5 * np.array([old[0], old[1], 1, old[2], old[3], 0]), rtol=1e-12, atol=1e-12)
    doubled = TransformedHamiltonian(ORBIT.system, scale=f"2*{ORBIT.system.q[0]}")
    assert np.isclose(doubled.vector_field()(0, np.append(Q0, P0))[2], 2 * ORBIT.q0[0])


def test_systems_without_distances_are_refused():
    with pytest.raises(InvalidInput, match="no distances"):
        TransformedHamiltonian(problem("henon-heiles").system)
    with pytest.raises(InvalidInput, match="no distances"):
        distance_scale(
            SimpleNamespace(singular=(ORBIT.system.q[0], np.hypot), softened=())
        )  # one of them is not a formula
    with pytest.raises(InvalidInput, match="coordinates alone"):
        TransformedHamiltonian(ORBIT.system, scale=f"1 + {ORBIT.system.p[0]}**2")
    with pytest.raises(InvalidInput, match="canonical"):
        TransformedHamiltonian(problem("lotka-volterra").system, scale=1)
