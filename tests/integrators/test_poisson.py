"""Poisson systems: their structure matrix, Poisson maps, and the collocation methods of Cohen & Hairer."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
import sympy as sp
from scipy.integrate import quad_vec
from scipy.optimize import fsolve

from phasebench.benchmarks.measure.step_map import jacobian
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.coefficients.quadrature import gauss_legendre
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families import poisson
from phasebench.integrators.registry import method
from phasebench.integrators.stepping.kernel import prepare
from phasebench.integrators.systems.poisson import PoissonSystem, jacobi_defects
from support.solutions import end, last

LV = problem("lotka-volterra:4-2")
ROUND_OFF = 1e-13
VARIABLES = sp.symbols("y1:5", real=True)


def expression(text):
    """The formula in y1, ..., y4 as an expression."""
    return sp.sympify(text, locals={str(y): y for y in VARIABLES})


def three(v, H, **more):
    """y' = v(y) x grad H for y1, y2, y3 and a constant y4; a Poisson system if v . curl v = 0, as for a gradient v."""
    v = [expression(e) for e in v]
    B = sp.zeros(4, 4)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        B[i, j], B[j, i] = -v[k], v[k]
    return PoissonSystem(q=VARIABLES[:2], p=VARIABLES[2:], B=B, H=H, **more)


#: H of a rigid body with a quartic term; its Casimir is |y|^2 / 2 (rotation group) or one that is not quadratic.
BODY = "y1**2/2 + y2**2/3 + y3**2/5 + y1**4/20 + y2*y3/4"
SPHERE = three(["y1", "y2", "y3"], BODY)
OTHER = three(["y1**3", "y2", "y3"], BODY)
CASIMIRS = {
    "quadratic": (SPHERE, expression("y1**2 + y2**2 + y3**2")),
    "quartic": (OTHER, expression("y1**4/2 + y2**2 + y3**2")),
}
START = {"q0": (0.8, -0.5), "p0": (0.6, 1.0)}


def structure(system, y):
    """B(y), array (2 d, 2 d), by the compiled function."""
    d = system.d
    f = system.structure()
    columns = [np.concatenate(f(*(tuple(x) for x in (y[:d], y[d:], e[:d], e[d:])))) for e in np.eye(2 * d)]
    return np.array(columns).T


# -- the systems -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("system", [LV.system, SPHERE, OTHER], ids=["lotka-volterra", "sphere", "other"])
def test_the_structure_is_skew_and_satisfies_jacobi(system):
    y = (*system.q, *system.p)
    assert sp.simplify(system.B + system.B.T) == sp.zeros(len(y), len(y))
    assert all(e == 0 for e in jacobi_defects(system.B, y))
    assert system.traits["Poisson structure"]
    assert not system.traits["canonical"]


def test_control_a_structure_without_the_jacobi_identity():
    """B(y) from v = (y2, 0, 1), which has v . curl v = -1, violates the Jacobi identity."""
    system = three(["y2", "0", "1"], BODY)
    assert any(e != 0 for e in jacobi_defects(system.B, (*system.q, *system.p)))


def test_invalid_poisson_systems_are_refused():
    u, v = sp.symbols("u v", real=True)
    with pytest.raises(InvalidInput, match="not skew"):
        PoissonSystem(q=[u], p=[v], B=[[0, u], [u, 0]], H=u + v)
    with pytest.raises(InvalidInput, match=r"shape \(1, 1\); for d = 1 it is \(2, 2\)"):
        PoissonSystem(q=[u], p=[v], B=[[0]], H=u + v)
    with pytest.raises(InvalidInput, match="not B grad H"):
        PoissonSystem(q=[u], p=[v], B=[[0, -u * v], [u * v, 0]], H="u + v", dq=[u * v], dp=[u * v])


def test_lotka_volterra_equals_the_talk():
    u, v = *LV.system.q, *LV.system.p
    assert LV.system.dq == (u * (v - 2),)
    assert LV.system.dp == (v * (1 - u),)
    bare = PoissonSystem(q=[u], p=[v], B=LV.system.B, H=LV.system.H)
    assert all(sp.simplify(a - b) == 0 for a, b in zip((*bare.dq, *bare.dp), (u * (v - 2), v * (1 - u)), strict=True))


@pytest.mark.parametrize("orbit", ["2-2", "4-8", "4-2", "6-2"])
def test_logarithmic_variables_follow_the_same_orbit(orbit):
    """Up to the error of RK4; H equals -I up to the rounding of the logarithms."""
    own, log = (problem(f"{id}:{orbit}") for id in ("lotka-volterra", "lotka-volterra-log"))
    a, b = (integrate(m, "rk4", h=1 / 512, t_end=4.0, save_every=256) for m in (own, log))
    assert np.abs(np.exp(np.hstack([b.q, b.p])) - np.hstack([a.q, a.p])).max() < 1e-8
    own_energy, H = (m.system.observe(m.system.H, s.q, s.p) for m, s in ((own, a), (log, b)))
    assert np.abs(own_energy + H).max() < 1e-9
    assert np.abs(np.exp(b.q) - a.q[::-1]).max() > 1e-2, "the control: another time"
    assert log.system.separable
    assert not log.system.quadratic_kinetic


# -- Poisson maps -----------------------------------------------------------------------------------------------------


def defect(method, system=LV.system, y=(4.0, 2.0), h=0.1, steps=1):
    """Largest entry of M B(y0) M^T - B(y1), where M is the Jacobian of the map over the time h."""
    d, y = system.d, np.array(y)

    def step(x):
        return end(integrate(system, method, h=h / steps, steps=steps, q0=x[:d], p0=x[d:], save_every=0))

    M = jacobian(step, y)
    return np.abs(M @ structure(system, y) @ M.T - structure(system, step(y))).max()


#: Errors of difference Jacobians are below the first number; defects of other maps exceed the second.
NOTHING, VISIBLE = 1e-9, 1e-5


@pytest.mark.parametrize("method", ["symplectic-euler-p", "symplectic-euler-q", "stormer-verlet"])
def test_symplectic_euler_is_poisson_for_lotka_volterra(method):
    """Hairer, Lubich & Wanner 2006, VII.4, for this B; so are its compositions."""
    assert defect(method) < NOTHING


def test_the_flow_is_a_poisson_map():
    assert defect("rk4", steps=100) < NOTHING


@pytest.mark.parametrize(
    "method",
    ["implicit-midpoint", "rk4", "explicit-euler", pytest.param("cohen-hairer-1", marks=pytest.mark.thorough)],
)
def test_control_other_methods_are_not_poisson_maps(method):
    assert defect(method, h=0.2) > VISIBLE


# -- Cohen & Hairer ----------------------------------------------------------------------------------------------------


def by_the_formula(system, s, y, h):
    """One step from the definition, with Lagrange polynomials, adaptive quadrature and SciPy's equation solver."""
    d = system.d
    c, b = (x / 2 for x in np.polynomial.legendre.leggauss(s))
    c = c + 0.5
    basis = []
    for i in range(s):
        others = np.polynomial.Polynomial(np.polynomial.polynomial.polyfromroots(np.delete(c, i)))
        basis.append(others / others(c[i]))
    integrals = [e.integ() for e in basis]
    gradient = system.gradient()

    def grad(x):
        return np.concatenate(gradient(tuple(x[:d]), tuple(x[d:]), 0.0, 0.0))

    def defect(K):
        K = K.reshape(s, 2 * d)
        Y = lambda t: y + sum(f(t) * k for f, k in zip(integrals, K, strict=True))  # noqa: E731
        G = [
            quad_vec(lambda t, e=e: e(t) * grad(Y(t)), 0, 1, epsabs=1e-14)[0] / w for e, w in zip(basis, b, strict=True)
        ]
        return (K - h * np.array([structure(system, Y(t)) @ g for t, g in zip(c, G, strict=True)])).ravel()

    K = fsolve(defect, np.zeros(2 * d * s), xtol=1e-13).reshape(s, 2 * d)
    return y + b @ K


@pytest.mark.parametrize("s", [1, 2, 3])
def test_a_step_equals_its_definition(s):
    for system, q, p, h in ((LV.system, (4.0,), (2.0,), 0.2), (OTHER, START["q0"], START["p0"], 0.3)):
        expected = by_the_formula(system, s, np.array([*q, *p]), h)
        got = integrate(system, f"cohen-hairer-{s}", h=h, steps=1, q0=q, p0=p)
        assert np.abs(last(got) - expected).max() < 1e-12


def as_poisson(system):
    """A canonical system as a Poisson system with structure J^-1."""
    d = system.d
    B = sp.Matrix(sp.BlockMatrix([[sp.zeros(d), sp.eye(d)], [-sp.eye(d), sp.zeros(d)]]))
    return PoissonSystem(q=system.q, p=system.p, B=B, H=system.H)


@pytest.mark.parametrize("name", ["pendulum", "henon-heiles"])
@pytest.mark.parametrize(
    ("ours", "theirs"), [("cohen-hairer-1", "avf"), pytest.param("cohen-hairer-2", "cpg-2", marks=pytest.mark.thorough)]
)
def test_on_canonical_systems_it_is_a_known_method(name, ours, theirs):
    made = problem(name)
    system, start = as_poisson(made.system), {"q0": made.q0, "p0": made.p0}
    assert prepare(method(ours), system).run is poisson.run is not prepare(method(ours), made.system).run
    a, b, c = (integrate(x, m, h=0.1, steps=20, **start) for x, m in ((system, ours), (made, theirs), (made, ours)))
    assert np.abs([a.q - b.q, a.p - b.p]).max() < ROUND_OFF
    assert np.abs([a.q - c.q, a.p - c.p]).max() < ROUND_OFF


def greatest_change(system, expression, solution):
    """Greatest change of an invariant along a trajectory."""
    value = system.observe(expression, solution.q, solution.p)
    return np.abs(value - value[0]).max()


@pytest.mark.parametrize("s", [1, 2, 3])
@pytest.mark.parametrize(("orbit", "h"), [("2-2", 0.12), ("4-8", 0.06), ("4-2", 0.12)])
def test_the_invariant_of_lotka_volterra_is_conserved(s, orbit, h):
    made = problem(f"lotka-volterra:{orbit}")
    found = integrate(made, f"cohen-hairer-{s}", h=h, steps=5000)
    assert found.status == "ok"
    assert found.counts["fallbacks"] == 0
    assert greatest_change(made.system, made.system.H, found) < ROUND_OFF


def test_control_the_midpoint_rule_does_not_conserve_it():
    assert greatest_change(LV.system, LV.system.H, integrate(LV, "implicit-midpoint", h=0.12, steps=5000)) > 1e-3


@pytest.mark.parametrize("s", [1, 2, 3])
def test_energy_and_quadratic_casimirs_only_are_conserved(s):
    changed = {}
    for kind, (system, C) in CASIMIRS.items():
        assert sp.simplify(sp.Matrix([[sp.diff(C, y) for y in VARIABLES]]) * system.B) == sp.zeros(1, 4)
        found = integrate(system, f"cohen-hairer-{s}", h=0.5, steps=1000, **START)
        assert greatest_change(system, system.H, found) < ROUND_OFF
        assert np.all(found.p[:, 1] == START["p0"][1])
        changed[kind] = greatest_change(system, C, found)
    assert changed["quadratic"] < ROUND_OFF
    assert changed["quartic"] > 1e4 * ROUND_OFF


def test_control_rk4_conserves_neither():
    system, C = CASIMIRS["quadratic"]
    found = integrate(system, "rk4", h=0.5, steps=1000, **START)
    assert greatest_change(system, system.H, found) > 1e-6
    assert greatest_change(system, C, found) > 1e-6


@pytest.mark.parametrize("s", [1, 2, 3])
def test_newton_takes_over_when_the_iteration_diverges(s):
    found = integrate(SPHERE, f"cohen-hairer-{s}", h=3.0, steps=50, **START)
    assert found.status == "ok"
    assert found.counts["newton"] > 10
    assert greatest_change(SPHERE, SPHERE.H, found) < ROUND_OFF


@pytest.mark.parametrize(("s", "most"), [(1, 54), (2, 57), (3, 59)])
def test_all_increments_start_by_extrapolation(s, most):
    """Starting from zero, or extrapolating only the first increment, takes 8 to 11 more evaluations per step."""
    counts = integrate(LV, f"cohen-hairer-{s}", h=0.02, steps=40).counts
    assert counts["gradient"] < most * 40
    assert counts["newton"] == 0


@pytest.mark.parametrize("digits", [20, 40])
def test_coefficients_have_the_digits_requested(digits):
    """The integrals of Lagrange polynomials sum to the node, the weights of a force to the weight of the rule."""
    with mpmath.workdps(digits + 10):
        weights = [b for _, b in gauss_legendre(3, digits + 10)]
        _, table = poisson.coefficients(3, (4,), digits)
        for (_, inner, outer), (x, weight) in zip(table, gauss_legendre(4, digits + 10), strict=True):
            assert abs(mpmath.fdot(weights, inner) - x) < mpmath.mpf(10) ** (2 - digits)
            assert abs(mpmath.fsum(outer) - weight) < mpmath.mpf(10) ** (2 - digits)


def test_an_unsolvable_step_ends_with_a_status():
    """Both populations leave the quadrant in which H is defined."""
    ends = [integrate(LV, "cohen-hairer-2", h=h, steps=4) for h in (20.0, 0.1)]
    assert [s.counts["steps"] for s in ends] == [0, 4]
    assert ends[0].status in ("not-converged", "diverged")
    assert ends[1].status == "ok", "the control"


@pytest.mark.parametrize("id", ["avf", "cohen-hairer-1"])
def test_the_quadrature_rule_is_reduced_again(id):
    """Beyond a narrow hill a run costs as much as one that starts there, because the smallest rule is tried again."""
    hill = Hamiltonian(q="q1", p="p1", H="p1**2/2 + 1/(8 + 3200*q1**2)")
    system = as_poisson(hill) if id != "avf" else hill
    whole, over = (integrate(system, id, h=0.1, steps=n, q0=[-0.3], p0=[1.0]) for n in (64, 16))
    beyond = integrate(system, id, h=0.1, steps=48, q0=over.q[-1], p0=over.p[-1])
    rest = whole.counts["gradient"] - over.counts["gradient"]
    assert rest < 1.02 * beyond.counts["gradient"]
    assert over.counts["gradient"] > 5 * beyond.counts["gradient"] / 3, "the control: a third of the steps, on the hill"


@pytest.mark.parametrize("small", [1e-9, 1e9])
def test_newton_scales_momenta_and_coordinates_separately(small):
    """A stiff oscillator with p in other units: difference steps of the size of q would not suit p."""
    system = Hamiltonian(q="q1", p="p1", H=f"{small}*(p1**2/{small}**2 + 400*q1**2 + q1**4)/2")
    s = integrate(as_poisson(system), "cohen-hairer-1", h=0.3, steps=10, q0=[0.5], p0=[1.0 * small])
    assert s.status == "ok", s.reason
    assert s.counts["newton"] >= 10
    assert s.counts["gradient"] < 700, "a few iterations each"
    assert np.ptp(system.energies(s.q, s.p)) < 1e-12 * small
