"""Singular and softened distances found in formulas."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families import adaptive
from phasebench.integrators.systems import singularities
from phasebench.integrators.systems.transformed import distance_scale
from support.values import value


def of(V, **options):
    """The system with H = |p|^2 / 2 + V."""
    return Hamiltonian(q="x y", p="u v", H=f"(u**2 + v**2)/2 + {V}", **options)


def same(found, expected, system):
    """Whether two lists of distances are equal as expressions."""
    wanted = [system._formula(e) for e in expected]
    return len(found) == len(wanted) and all(any(sp.simplify(a - b) == 0 for b in wanted) for a in found)


R = "sqrt(x**2 + y**2)"
#: V -> its distances that can vanish.
SINGULAR = {
    f"1/{R}": [R],
    "(x**2 + y**2)**(-1/2)": [R],
    "1/(x**2 + y**2)**0.5": [R],
    "(x**2 + y**2)**-1.5": [R],
    f"3/{R}**3 - x/7": [R],
    "y/(x**2 + y**2)": [R],
    f"exp(-{R})/{R}": [R],
    f"log({R})": [R],
    "log(x**2 + y**2)*y": [R],
    "1/sqrt(x**2 - 2*x + 1 + y**2)": ["sqrt((x - 1)**2 + y**2)"],
    "1/sqrt((x - 1)**2 + y**2) - 2/sqrt((x + 3)**2 + y**2)": ["sqrt((x - 1)**2 + y**2)", "sqrt((x + 3)**2 + y**2)"],
    "1/x + x**2/2 - log(1 + x)": ["x", "x + 1"],
    "(3 - 2*x)**(-2)": ["x - 3/2"],
    "y + 1/(x**3 - x)": ["x", "x - 1", "x + 1"],
    "log(x*y)": ["x", "y"],
    "x**(-1/3) + y**2": ["x"],
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
REGULAR = [
    "x**2*y - y**3/3",
    "exp(-40*x) + y",
    "(1 - exp(-x))**2 + y",
    "cos(x)*cos(y)",
    "y + 1/cosh(x)",
    "x/(2 + cos(y))",
]
REGULAR += ["x**4 + x**2*y**2", R, "log(1 + exp(x)) + y", "y + tanh(x)", "1/(16 - 9*cos(x - y)**2)"]


@pytest.mark.parametrize("V", SINGULAR)
def test_singular_distances_are_found(V):
    system = of(V)
    assert same(system.singular, SINGULAR[V], system), system.singular
    assert not system.softened
    assert system.traits["singular distances"]


@pytest.mark.parametrize("V", SOFTENED)
def test_softened_distances_are_not_singular(V):
    system = of(V)
    assert not system.singular
    assert same(system.softened, SOFTENED[V], system), system.softened
    assert system.singularities == 0
    assert system.traits["singular distances"]


@pytest.mark.parametrize("V", REGULAR)
def test_regular_formulas_have_no_distances(V):
    system = of(V)
    assert system.singular == system.softened == ()
    assert not system.traits["singular distances"]


def test_declared_distances_override_those_found():
    far = of(f"1/{R}", singular=["sqrt((x - 5)**2 + y**2)"])
    assert same(far.singular, ["sqrt((x - 5)**2 + y**2)"], far)
    none = of("1/sqrt(x**2 + y**2 + 1/100)", singular=())
    assert not none.singular
    assert not none.softened
    assert not none.traits["singular distances"]


def test_a_base_with_momenta_is_not_a_distance():
    system = Hamiltonian(q="x", p="u", H="x**2 + u**2 + 1/sqrt(1 + u**2 + x**2)")
    assert system.singular == system.softened == ()


#: Singularities of registered formulas that are not declared: inside the horizon, on the axis, |q| = 0 of a quaternion.
BEYOND = {
    "schwarzschild": {"r"},
    "magnetized-schwarzschild": {"r", "sin(theta)"},
    "kerr": {"r", "sin(theta)"},
    "heavy-top": {"sqrt(q0**2 + q1**2 + q2**2 + q3**2)"},
}


@pytest.mark.parametrize("id", [id for id in PROBLEMS if isinstance(problem(id).system, Hamiltonian)])
def test_registered_problems_declare_their_distances(id):
    system = problem(id).system
    found = singularities.find(system.H, system.q, system.p)
    declared = {sp.simplify(e) for e in system.singular}
    extra = {e for e in map(sp.simplify, found.singular) if str(e) in BEYOND.get(id, ())}
    assert {*map(sp.simplify, found.singular)} - extra == declared
    assert {str(e) for e in extra} == BEYOND.get(id, set())
    assert not found.softened


def test_the_distance_of_an_expanded_formula_is_exact():
    system = of("1/sqrt(x**2 - 2*x + 1 + y**2)")
    assert system.distances([[1 + 1e-9, 0.0]], [[0.0, 0.0]])[0, 0] == pytest.approx(1e-9, rel=1e-6)


def test_the_step_density_handles_signed_distances():
    """The step density is right where the distance is negative: V = 1/(x - 2)**2 at x < 2, a wall."""
    system = of("1/(x - 2)**2")
    monitor = adaptive.monitor(system, DOUBLE)
    q, p, force, dt = np.array([1.5, 0.6]), np.array([0.7, -0.3]), np.array([-16.0, 0.0]), 1e-5
    before, now, after = (monitor(value(*(q + k * dt * p)), value(*(p + k * dt * force))) for k in (-1, 0, 1))
    rate, second = 0.7 / 0.5, 16 / 0.5  # of x - 2, over it
    density = np.sqrt(np.sqrt(0.5**-6 + second**2) + rate**2)
    assert now[0] == pytest.approx(density, rel=1e-14)
    assert now[1] == pytest.approx((np.log(after[0]) - np.log(before[0])) / (2 * dt), rel=1e-7)
    assert float(distance_scale(system).subs(system.q[0], 1.5)) == pytest.approx(0.5**1.5)


@pytest.mark.parametrize("id", ["stormer-verlet-adaptive", "gauss-8-adaptive"])
def test_a_fall_into_a_detected_singularity_is_a_collision(id):
    options = {"h": 0.1, "t_end": 5, "q0": [1.0, 0.0], "p0": [0.0, 0.0]}
    assert integrate(of(f"-1/{R}"), id, **options).status == "collision"


def test_a_fall_through_a_softened_centre_is_no_collision():
    options = {"h": 0.02, "t_end": 12, "q0": [1.0, 0.0], "p0": [0.0, 0.0]}
    soft = integrate(of("-1/sqrt(x**2 + y**2 + 1e-4)"), "gauss-8-adaptive", **options)
    assert soft.status == "ok", soft.reason
    wide = integrate(of("-1/sqrt(x**2 + y**2 + 1e-4)"), "stormer-verlet", **options)
    assert wide.status != "collision", "a step that crosses the core and loses the energy"
    hard = integrate(of(f"-1/{R}"), "stormer-verlet", **options)
    assert hard.status == "collision", "the control"


def test_variable_steps_work_for_a_users_formula():
    H = "(u**2 + v**2)/2 - 1/sqrt((x - 1)**2 + y**2) - 1/sqrt((x + 1)**2 + y**2)"
    centres = Hamiltonian(q="x y", p="u v", H=H)
    errors = []
    for id, h in (("gauss-8-adaptive", 0.3), ("gauss-8", 0.05)):
        s = integrate(centres, id, h=h, t_end=12, q0=[0.1, 0.6], p0=[0.1, 0.02], save_every=0)
        E = centres.energies(s.q, s.p)
        errors.append((abs(E[-1] - E[0]), s.counts["gradient"]))
    assert errors[0][0] < 1e-8
    assert errors[1][0] > 1e3 * errors[0][0]
    assert errors[0][1] < errors[1][1]
    with pytest.raises(InvalidInput, match="singular distances"):
        integrate(of("x**2*y"), "gauss-8-adaptive", h=0.1, steps=1, q0=[0.1, 0.6], p0=[0.1, 0.0])
