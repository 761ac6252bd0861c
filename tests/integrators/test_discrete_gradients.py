"""Discrete gradients: which quadrature nodes are in lanes, the kick as the unknown, energy by Gonzalez."""

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
from phasebench.integrators.registry import method
from phasebench.integrators.stepping.kernel import prepare
from support.solutions import end, energy_errors, last
from support.systems import general

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


def test_equivalent_paths_are_known():
    """Their methods are that of the averaged vector field: test_kernels.py."""
    separable, single, mixed = (SYSTEMS[n]()[0] for n in ("henon-heiles", "pendulum", "coupled"))
    assert not coupled("momenta, coordinates", separable)
    assert not coupled("components", single)
    assert coupled("components", separable)
    assert all(coupled(path, mixed) for path in ("momenta, coordinates", "components"))


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
