"""Poisson systems and the collocation methods of Cohen & Hairer; discrete gradients, whose H they conserve alike."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, precision
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families import averaged, poisson
from phasebench.integrators.registry import method
from phasebench.integrators.stepping.kernel import prepare
from phasebench.integrators.systems.poisson import PoissonSystem, jacobi_defects
from support.solutions import end, energy_errors, last
from support.systems import general

LV = problem("lotka-volterra:4-2")
ROUND_OFF = 1e-13
VARIABLES = sp.symbols("y1:5", real=True)


def expression(text):
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


# -- the systems -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("system", [LV.system, SPHERE, OTHER], ids=["lotka-volterra", "sphere", "other"])
def test_the_structure_is_skew_and_satisfies_jacobi(system):
    y = (*system.q, *system.p)
    assert sp.simplify(system.B + system.B.T) == sp.zeros(len(y), len(y))
    assert all(e == 0 for e in jacobi_defects(system.B, y))
    wrong = three(["y2", "0", "1"], BODY)  # v = (y2, 0, 1) has v . curl v = -1
    assert any(e != 0 for e in jacobi_defects(wrong.B, (*wrong.q, *wrong.p)))
    assert system.traits["Poisson structure"]
    assert not system.traits["canonical"]


# -- Cohen & Hairer ----------------------------------------------------------------------------------------------------


def as_poisson(system):
    d = system.d
    B = sp.Matrix(sp.BlockMatrix([[sp.zeros(d), sp.eye(d)], [-sp.eye(d), sp.zeros(d)]]))
    return PoissonSystem(q=system.q, p=system.p, B=B, H=system.H)


def test_its_formulas_may_be_text():
    system = PoissonSystem(
        q="u", p="v", B=[["0", "u*v"], ["-u*v", 0]], H="u - log(u) + v - log(v**2)", dq=["u*(v - 2)"], dp=["v*(1 - u)"]
    )
    u, v = *system.q, *system.p
    assert sp.Matrix([[0, u * v], [-u * v, 0]]) == system.B
    assert system.dq == (u * (v - 2),)
    for wrong in ("w", "__import__('os')"):
        with pytest.raises(InvalidInput, match="cannot be used"):
            PoissonSystem(q="u", p="v", B=[["0", wrong], ["0", "0"]], H="u")


def test_on_canonical_systems_it_is_a_known_method():
    made, ours, theirs = problem("henon-heiles"), "cohen-hairer-1", "avf"
    system, start = as_poisson(made.system), {"q0": made.q0, "p0": made.p0}
    assert prepare(method(ours), system).run is poisson.run is not prepare(method(ours), made.system).run
    a, b, c = (integrate(x, m, h=0.1, steps=20, **start) for x, m in ((system, ours), (made, theirs), (made, ours)))
    assert np.abs([a.q - b.q, a.p - b.p]).max() < ROUND_OFF
    assert np.abs([a.q - c.q, a.p - c.p]).max() < ROUND_OFF


def greatest_change(system, expression, solution):
    value = system.observe(expression, solution.q, solution.p)
    return np.abs(value - value[0]).max()


@pytest.mark.parametrize("s", [1, 2])
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


# -- discrete gradients ------------------------------------------------------------------------------------------------


#: Separable H with quadratic T, for which the kick is the unknown; the masses distinguish M^-1 from 1.
MASSES = "p1**2/2 + p2**2/6 + p1*p2/5 - cos(q1) - cos(q2) + sin(q1*q2)/10"


def of(H):
    return Hamiltonian(q="q1 q2", p="p1 p2", H=H)


def run(system, id, h=0.1, steps=50):
    s = integrate(system, id, h=h, steps=steps, q0=[0.7, 0.5], p0=[0.2, -0.3])
    return end(s), s.counts


@pytest.mark.processor
def test_systems_without_lanes_take_nodes_one_by_one(monkeypatch):
    names = [[f"{x}{i}" for i in range(21)] for x in "qp"]
    many = Hamiltonian(q=names[0], p=names[1], H="cos(q0) + " + " + ".join(f"p{i}**2/2 + q{i}**2" for i in range(21)))
    for system in (of("p1**2/2 + p2**2/2 + q1**4 + q1*q2"), problem("klein-gordon").system, many):
        assert prepare(method("avf"), system).step.like is None
    with precision(30):
        assert prepare(method("avf"), of(MASSES), MULTIPRECISION).step.like is None
    monkeypatch.setattr(averaged, "compiles_in_lanes", lambda system: True)
    served = [averaged.serves(of(f"p1**2/2 + p2**2/2 + q1**{n} + q1*q2"), DOUBLE) for n in (2, 4, 5, 6)]
    assert served == [False, False, True, True], "two nodes are exact for a polynomial of degree 4"


def test_round_off_of_large_coordinates_ends_a_step():
    """If two rules differ by the round-off of large coordinates the step ends instead of trying ever larger rules."""
    made, away = of("p1**2/2 + p2**2/2 - cos(q1) - cos(q2)"), 20 * np.pi
    start = {"h": 0.1, "steps": 40, "p0": [0.2, -0.3]}
    near, far = (integrate(made, "avf", q0=[0.7 + x, 0.5], **start) for x in (0.0, away))
    assert np.abs(last(far) - last(near) - [away, 0, 0, 0]).max() < 1e-13
    assert far.counts["fallbacks"] == near.counts["fallbacks"] == 0
    assert far.counts["gradient"] < 1.25 * near.counts["gradient"]


def test_the_kick_as_unknown_saves_evaluations():
    made = of(MASSES)
    (kicks, n), (both, m) = run(made, "avf"), run(general(made), "avf")
    assert np.abs(kicks - both).max() < 3e-14
    assert n["gradient"] < 0.75 * m["gradient"]
    assert run(made, "avf", 1e-3, 16)[1]["gradient"] < 10 * 16, "two nodes, confirmed by three"


# -- Gonzalez' discrete gradient --------------------------------------------------------------------------------------


def test_round_off_of_the_quotient_does_not_reach_the_state():
    """(H(y + x) - H(y)) / (x . x) has an error of eps / h^2."""
    system, q, p = SYSTEMS["pendulum"]()
    a, b = (
        integrate(system, id, h=1e-6, steps=4000, q0=q, p0=p, save_every=0) for id in ("gonzalez", "implicit-midpoint")
    )
    assert abs(energy_errors(a)[-1]) < 2e-15
    assert np.abs(last(a) - last(b)).max() < 5e-15
    assert a.counts["newton"] == 0


def test_a_step_that_misses_the_energy_is_counted_once():
    s = integrate(problem("pendulum").system, "gonzalez", h=2.0, steps=6, q0=[0.0], p0=[2.5])
    missed = np.sum(np.abs(energy_errors(s)) > 1e-9)
    assert 2 <= missed <= s.counts["fallbacks"] <= 6
    assert s.status == "no-root"
