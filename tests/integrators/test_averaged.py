"""Averaged vector field kernels against each other: nodes in SIMD lanes or not, kick or both increments as unknowns."""

from __future__ import annotations

from functools import partial

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, precision
from phasebench.integrators.families import averaged
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.registry import method
from phasebench.integrators.stepping.kernel import prepare
from phasebench.integrators.stepping.orbit_lanes import LANES, twin
from phasebench.integrators.values.lanes import Lanes
from support import two_degrees
from support.systems import general
from support.two_degrees import of, run
from support.values import value

#: Separable H with quadratic T, for which the kick is the unknown; the masses distinguish M^-1 from 1.
KICKS = {
    "masses": "p1**2/2 + p2**2/6 + p1*p2/5 - cos(q1) - cos(q2) + sin(q1*q2)/10",
    "powers": "p1**2/2 + p2**2/2 + (1 + q1**2 + q2**2)**(3/2) + 1/sqrt(2 + q1**2) + q2**2/5",
    "logarithm": "p1**2/2 + p2**2/2 + log(1 + q1**2) + (1 + q2**2)**(1/3) + tan(q1*q2/9)",
    "degree 6": "p1**2/2 + p2**2/2 + q1**6 + q1**2*q2**2/3 + q2**4",
}
#: H for which both increments are the unknowns.
FIELDS = {
    "angles": "(p1**2 + 2*p2**2 - 2*p1*p2*cos(q1 - q2))/(2 + 2*sin(q1 - q2)**2) - 2*cos(q1) - cos(q2)",
    "exponentials": "exp(p1) - 2*p1 + exp(q1) - q1 + exp(p2/2) + q2**2",
}
#: Methods with one block, with four, and with two substeps of four.
PATHS = ("avf", "pavf-p", "itoh-abe-c")


#: Runs a method with its quadrature nodes evaluated one after the other, not in SIMD lanes.
one_by_one = partial(two_degrees.one_by_one, averaged)


# -- nodes in lanes ---------------------------------------------------------------------------------------------------


@pytest.mark.processor
@pytest.mark.parametrize(
    ("name", "id"),
    [
        *((name, "avf") for name in list(KICKS)[:2]),
        *(pytest.param(name, "avf", marks=pytest.mark.thorough) for name in list(KICKS)[2:]),
        *(("angles", id) for id in PATHS),
        *(pytest.param("exponentials", id, marks=pytest.mark.thorough) for id in PATHS),
    ],
)
def test_lanes_reach_the_state_of_single_nodes(name, id):
    """Up to the round-off of fifty steps: lanes sum in another order and use their own sin, cos and exp."""
    made = of((KICKS | FIELDS)[name])
    assert averaged.serves(made, DOUBLE)
    (lanes, n), (nodes, m) = run(made, id), one_by_one(made, id)
    assert np.abs(lanes - nodes).max() < 3e-14
    assert abs(n["gradient"] - m["gradient"]) <= 0.05 * m["gradient"]
    assert n["fallbacks"] == m["fallbacks"] == 0


@pytest.mark.parametrize("width", [1, 4])
@pytest.mark.parametrize("H", ["p1**2/2 + cos(q1)", "p1**2/2 + q1**10"])
def test_the_rows_of_a_rule_are_the_quadrature_rule(width, H):
    """Each rule integrates powers up to degree 2n - 1; unused lanes have weight zero."""
    nodes, rows, c, b = averaged.rules(Hamiltonian(q="q1", p="p1", H=H), width, DOUBLE)
    assert {len(v) for v in (*c, *b)} == {width}
    first = 0
    while first < len(rows):
        part = slice(first, first + rows[first])
        assert rows[first] == -(-nodes[first] // width)
        for power in range(2 * nodes[first]):
            terms = (v * u**power for us, vs in zip(c[part], b[part], strict=True) for u, v in zip(us, vs, strict=True))
            assert abs(mpmath.fsum(terms) - mpmath.mpf(1) / (power + 1)) < 1e-15
        first += rows[first]
    assert first == len(c) == len(b) == len(nodes)


def test_control_a_weight_in_an_unused_lane_is_seen(monkeypatch):
    """A rule of ten nodes leaves two of its lanes unused; a weight there changes the result."""
    made, rules = of(KICKS["masses"]), averaged.rules

    def spoiled(*arguments):
        nodes, rows, c, b = rules(*arguments)
        return nodes, rows, c, tuple((*v[:3], v[3] + 1e-9) for v in b)

    monkeypatch.setattr(averaged, "rules", spoiled)
    lanes = run(made, "avf")[0]
    monkeypatch.undo()
    assert np.abs(lanes - one_by_one(made, "avf")[0]).max() > 1e-10


@pytest.mark.processor
def test_systems_without_lanes_take_nodes_one_by_one():
    quartic, wave = of("p1**2/2 + p2**2/2 + q1**4 + q1*q2"), problem("klein-gordon").system
    names = [[f"{x}{i}" for i in range(21)] for x in "qp"]
    many = Hamiltonian(q=names[0], p=names[1], H="cos(q0) + " + " + ".join(f"p{i}**2/2 + q{i}**2" for i in range(21)))
    for system in (quartic, wave, many):
        assert prepare(method("avf"), system).step.like is None
    made = of(KICKS["masses"])
    twin(made)  # the version for ensembles differs unless registers have the same width
    assert prepare(method("avf"), made).step.like == (0.0,) * averaged.WIDTH
    assert (twin(made, Lanes(averaged.WIDTH)) is twin(made)) is (LANES.n == averaged.WIDTH)
    assert twin(made, Lanes(2 * LANES.n)) is not twin(made)
    with precision(30):
        assert prepare(method("avf"), made, MULTIPRECISION).step.like is None


def test_lanes_serve_from_three_nodes_on(monkeypatch):
    """Two nodes are exact for a polynomial of degree 4, three for degree 6."""
    monkeypatch.setattr(averaged, "compiles_in_lanes", lambda system: True)
    served = [averaged.serves(of(f"p1**2/2 + p2**2/2 + q1**{n} + q1*q2"), DOUBLE) for n in (2, 4, 5, 6)]
    assert served == [False, False, True, True]


@pytest.mark.parametrize("name", ["masses", "logarithm"])
def test_short_steps_use_the_smallest_rules(name):
    """Two nodes, confirmed by three; starting with eight would take four times as many evaluations."""
    assert run(of(KICKS[name]), "avf", 1e-3, 16)[1]["gradient"] < 10 * 16


def test_a_step_on_a_quadratic_energy_is_a_cayley_transform():
    """For quadratic H the averaged vector field method is the implicit midpoint rule."""
    K, h, steps, zero, one = np.array([[2.0, 1.0], [1.0, 3.0]]), 0.1, 50, np.zeros((2, 2)), np.eye(2)
    half = h / 2 * np.block([[zero, one], [-K, zero]])
    exact = np.linalg.matrix_power(np.linalg.solve(np.eye(4) - half, np.eye(4) + half), steps) @ [0.7, 0.5, 0.2, -0.3]
    found, counts = run(of("p1**2/2 + p2**2/2 + q1**2 + q1*q2 + 3*q2**2/2"), "avf", h, steps)
    assert np.abs(found - exact).max() < 1e-14
    assert counts["fallbacks"] == 0


# -- rules and evaluations --------------------------------------------------------------------------------------------


def standing(H, id):
    """A prepared run with steps of length 0.

    Each step is solved by the first fixed-point sweep and confirmed by the next quadrature rule.
    """
    return lay_out(prepare(method(id), of(H)), 2, 0.0, [0.7, 0.5], [0.2, -0.3], DOUBLE)


def one_step(run):
    """Take one step of a prepared run and return the index of the quadrature rule with which the next step begins."""
    assert run(np.zeros((1, 2)), np.zeros((1, 2)), np.zeros((1, 1)), 1) == (1, 0)
    return run.counts.rule


@pytest.mark.parametrize(
    ("id", "sweeps"), [("avf", 1), ("pavf", 2), ("pavf-p", 4), ("pavf-c", 4), ("itoh-abe", 4), ("itoh-abe-c", 8)]
)
def test_evaluations_of_a_sweep(id, sweeps):
    """Two sweeps are made: one with the smallest rule, one with the next."""
    run = standing(FIELDS["angles"], id)
    step = run.step
    assert one_step(run) == 0
    assert run.counts.gradient == sweeps * (step.nodes[0] + step.nodes[step.rows[0]])
    assert run.counts.fallbacks == run.counts.newton == 0


def test_every_sixteenth_step_begins_with_the_smallest_rule():
    """All other steps begin with the rule that was confirmed last."""
    run = standing(KICKS["masses"], "avf")
    second = run.step.rows[0]
    for k in range(50):
        run.counts.rule = second
        assert one_step(run) == (0 if k % 16 == 0 else second)


@pytest.mark.parametrize("turns", [10, -10])
def test_round_off_of_large_coordinates_ends_a_step(turns):
    """If two rules differ by the round-off of large coordinates the step ends instead of trying ever larger rules."""
    step = prepare(method("avf"), of("p1**2/2 + p2**2/2 - cos(q1) - cos(q2)"))
    near, far = (lay_out(step, 2, 0.1, [0.7 + x, 0.5], [0.2, -0.3], DOUBLE) for x in (0.0, 2 * np.pi * turns))
    for _ in range(40):
        one_step(near), one_step(far)
    apart = (far.carry.state - near.carry.state)[:2, :2] - [[2 * np.pi * turns, 0], [0, 0]]
    assert np.abs(apart).max() < 1e-13
    assert far.counts.fallbacks == near.counts.fallbacks == 0
    assert far.counts.gradient < 1.25 * near.counts.gradient


# -- the kick as the unknown ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", KICKS)
def test_the_kick_as_unknown_saves_evaluations(name):
    made = of(KICKS[name])
    assert made.quadratic_kinetic
    (kicks, n), (both, m) = run(made, "avf"), run(general(made), "avf")
    assert np.abs(kicks - both).max() < 3e-14
    assert n["gradient"] < 0.75 * m["gradient"]


@pytest.mark.parametrize("seed", range(3))
def test_a_kick_and_its_drift_form_a_discrete_gradient(seed):
    """For a kick k that solves no equation: mean(H_q) . dq + dq . k / h equals the difference of H over (dq, k)."""
    system, q, p = SYSTEMS["henon-heiles"]()
    step, h = prepare(method("avf"), system).step, 0.5
    k = 0.4 * np.random.default_rng(seed).standard_normal(2)
    e = averaged.Average(step, value(*q), value(*p), value(*p), h, 0, 0)
    dq = np.array(averaged.drift(value(*k), e))
    found = -np.array(averaged.mean(value(*k), e)) @ dq / h + dq @ k / h
    Q, P = np.array([q, q + dq]), np.array([p, p + k])
    before, after = system.observe(system.H, Q, P)
    assert abs(found - (after - before)) < 4e-15
    assert abs(after - before) > 1e-3


def test_newton_takes_over_when_the_kick_does_not_contract():
    stiff = of("p1**2/2 + p2**2/6 + 1250*q1**2 + q2**2/2 + q1*q2 + cos(q1)")
    (kicks, n), (both, m) = run(stiff, "avf", 0.2, 20), run(general(stiff), "avf", 0.2, 20)
    assert n["newton"] >= 20 <= m["newton"]  # at least once per step
    assert np.abs(kicks - both).max() < 1e-11
