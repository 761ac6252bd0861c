"""Discrete gradients: quadrature rules in SIMD lanes or not, the kick as the unknown, energy by Gonzalez."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, precision
from phasebench.integrators.driver import integrate
from phasebench.integrators.families import averaged
from phasebench.integrators.families.averaged import coupled
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.registry import method
from phasebench.integrators.stepping.kernel import prepare
from phasebench.integrators.stepping.orbit_lanes import LANES, twin
from phasebench.integrators.values.lanes import Lanes
from support import two_degrees
from support.solutions import energy_errors, last
from support.systems import general
from support.two_degrees import of, run

#: Separable H with quadratic T, for which the kick is the unknown; the masses distinguish M^-1 from 1.
MASSES = "p1**2/2 + p2**2/6 + p1*p2/5 - cos(q1) - cos(q2) + sin(q1*q2)/10"
POWERS = "p1**2/2 + p2**2/2 + (1 + q1**2 + q2**2)**(3/2) + 1/sqrt(2 + q1**2) + q2**2/5"
#: H for which both increments are the unknowns.
ANGLES = "(p1**2 + 2*p2**2 - 2*p1*p2*cos(q1 - q2))/(2 + 2*sin(q1 - q2)**2) - 2*cos(q1) - cos(q2)"


# -- nodes in lanes ---------------------------------------------------------------------------------------------------


@pytest.mark.processor
@pytest.mark.parametrize(("H", "id"), [(MASSES, "avf"), (POWERS, "avf"), (ANGLES, "pavf-p"), (ANGLES, "itoh-abe-c")])
def test_lanes_reach_the_state_of_single_nodes(H, id):
    """Up to the round-off of fifty steps: lanes sum in another order and use their own sin, cos and exp."""
    made = of(H)
    assert averaged.serves(made, DOUBLE)
    (lanes, n), (nodes, m) = run(made, id), two_degrees.one_by_one(averaged, made, id)
    assert np.abs(lanes - nodes).max() < 3e-14
    assert abs(n["gradient"] - m["gradient"]) <= 0.05 * m["gradient"]
    assert n["fallbacks"] == m["fallbacks"] == 0


@pytest.mark.processor
def test_systems_without_lanes_take_nodes_one_by_one(monkeypatch):
    names = [[f"{x}{i}" for i in range(21)] for x in "qp"]
    many = Hamiltonian(q=names[0], p=names[1], H="cos(q0) + " + " + ".join(f"p{i}**2/2 + q{i}**2" for i in range(21)))
    for system in (of("p1**2/2 + p2**2/2 + q1**4 + q1*q2"), problem("klein-gordon").system, many):
        assert prepare(method("avf"), system).step.like is None
    made = of(MASSES)
    twin(made)  # the version for ensembles differs unless registers have the same width
    assert prepare(method("avf"), made).step.like == (0.0,) * averaged.WIDTH
    assert (twin(made, Lanes(averaged.WIDTH)) is twin(made)) is (LANES.n == averaged.WIDTH)
    assert twin(made, Lanes(2 * LANES.n)) is not twin(made)
    with precision(30):
        assert prepare(method("avf"), made, MULTIPRECISION).step.like is None
    monkeypatch.setattr(averaged, "compiles_in_lanes", lambda system: True)
    served = [averaged.serves(of(f"p1**2/2 + p2**2/2 + q1**{n} + q1*q2"), DOUBLE) for n in (2, 4, 5, 6)]
    assert served == [False, False, True, True], "two nodes are exact for a polynomial of degree 4"


# -- rules and evaluations --------------------------------------------------------------------------------------------


def one_step(run):
    """Take one step of a prepared run and return the index of the quadrature rule with which the next step begins."""
    assert run(np.zeros((1, 2)), np.zeros((1, 2)), np.zeros((1, 1)), 1) == (1, 0)
    return run.counts.rule


@pytest.mark.parametrize(("id", "sweeps"), [("avf", 1), ("pavf", 2), ("pavf-p", 4), ("itoh-abe-c", 8)])
def test_evaluations_of_a_sweep(id, sweeps):
    """A step of length 0 is solved by the first sweep, with the smallest rule, and confirmed by the next rule."""
    run = lay_out(prepare(method(id), of(ANGLES)), 2, 0.0, [0.7, 0.5], [0.2, -0.3], DOUBLE)
    step = run.step
    assert one_step(run) == 0
    assert run.counts.gradient == sweeps * (step.nodes[0] + step.nodes[step.rows[0]])
    assert run.counts.fallbacks == run.counts.newton == 0


def test_round_off_of_large_coordinates_ends_a_step():
    """If two rules differ by the round-off of large coordinates the step ends instead of trying ever larger rules."""
    step, away = prepare(method("avf"), of("p1**2/2 + p2**2/2 - cos(q1) - cos(q2)")), 20 * np.pi
    near, far = (lay_out(step, 2, 0.1, [0.7 + x, 0.5], [0.2, -0.3], DOUBLE) for x in (0.0, away))
    for _ in range(40):
        one_step(near), one_step(far)
    apart = (far.carry.state - near.carry.state)[:2, :2] - [[away, 0], [0, 0]]
    assert np.abs(apart).max() < 1e-13
    assert far.counts.fallbacks == near.counts.fallbacks == 0
    assert far.counts.gradient < 1.25 * near.counts.gradient


def test_the_kick_as_unknown_saves_evaluations():
    made = of(MASSES)
    (kicks, n), (both, m) = run(made, "avf"), run(general(made), "avf")
    assert np.abs(kicks - both).max() < 3e-14
    assert n["gradient"] < 0.75 * m["gradient"]
    assert run(made, "avf", 1e-3, 16)[1]["gradient"] < 10 * 16, "two nodes, confirmed by three"
    stiff = of("p1**2/2 + p2**2/6 + 1250*q1**2 + q2**2/2 + q1*q2 + cos(q1)")
    (kicks, n), (both, m) = run(stiff, "avf", 0.2, 20), run(general(stiff), "avf", 0.2, 20)
    assert n["newton"] >= 20 <= m["newton"]
    assert np.abs(kicks - both).max() < 1e-11


def step(id, name):
    system, q, p = SYSTEMS[name]()
    return last(integrate(system, id, h=0.125, steps=1, q0=q, p0=p))


def test_equivalent_paths_give_the_averaged_vector_field():
    separable, single, mixed = (SYSTEMS[n]()[0] for n in ("henon-heiles", "pendulum", "coupled"))
    assert not coupled("momenta, coordinates", separable)
    assert not coupled("components", single)
    assert coupled("components", separable)
    assert all(coupled(path, mixed) for path in ("momenta, coordinates", "components"))
    assert np.array_equal(step("pavf", "henon-heiles"), step("avf", "henon-heiles"))
    assert np.array_equal(step("itoh-abe", "pendulum"), step("avf", "pendulum"))
    assert np.abs(step("pavf", "coupled") - step("avf", "coupled")).max() > 1e-6, "the control"


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


@pytest.mark.parametrize("name", ["pendulum", "coupled"])
def test_long_steps_conserve_energy_to_the_last_unit(name):
    system, q, p = SYSTEMS[name]()
    s = integrate(system, "gonzalez", h=0.8 if name == "pendulum" else 0.4, steps=40, q0=q, p0=p)
    assert s.counts["fallbacks"] == 0
    assert np.abs(energy_errors(s)).max() < 5e-15


def test_a_step_that_misses_the_energy_is_counted_once():
    s = integrate(problem("pendulum").system, "gonzalez", h=2.0, steps=6, q0=[0.0], p0=[2.5])
    missed = np.sum(np.abs(energy_errors(s)) > 1e-9)
    assert 2 <= missed <= s.counts["fallbacks"] <= 6
    assert s.status == "no-root"


@pytest.mark.parametrize(("id", "most"), [("gonzalez", 27), ("gonzalez-yoshida-4", 94)])
def test_each_step_starts_by_extrapolation(id, most):
    """Increments and multipliers are both extrapolated; with only one of them it takes a quarter more evaluations."""
    s = integrate(problem("pendulum"), id, h=0.1, steps=40)
    assert s.counts["gradient"] <= most * 40
