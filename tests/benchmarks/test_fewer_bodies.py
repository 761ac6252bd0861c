"""Which bodies can be left out at a given accuracy, against REBOUND with and without them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.advice import fewer_bodies, models
from phasebench.benchmarks.advice.ask import ask
from phasebench.benchmarks.advice.fewer_bodies import Model, Models
from phasebench.benchmarks.advice.hunt import Candidate, Search
from phasebench.benchmarks.ladder.trial import Trial
from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems.outer_solar_system import BODIES, G
from support.orbits import true_longitude

T = 36525.0
NAMES = ("saturn", "uranus", "neptune", "pluto")


@cache
def system():
    rows = [
        {"name": name, "m": m, **dict(zip(("x", "y", "z", "vx", "vy", "vz"), (*x, *v), strict=True))}
        for name, (m, x, v) in BODIES.items()
    ]
    return pb.planetary_system(rows, frame="heliocentric")


def longitude(*names: str, light: tuple[str, ...] = ()) -> float:
    """True longitude of Jupiter in radians after 100 years, by REBOUND, with the named bodies; ``light``: massless."""
    rebound = pytest.importorskip("rebound")
    sim = rebound.Simulation()
    sim.G = G
    for name in ("sun", "jupiter", *names):
        m, (x, y, z), (vx, vy, vz) = BODIES[name]
        sim.add(m=0.0 if name in light else m, x=x, y=y, z=z, vx=vx, vy=vy, vz=vz)
    sim.integrator = "ias15"
    sim.integrate(T)
    star, planet = sim.particles[0], sim.particles[1]
    return true_longitude(*(np.subtract(getattr(planet, k), getattr(star, k)) for k in ("xyz", "vxyz")))


@cache
def question_and_truth(accuracy=1e-4, quantity="jupiter.longitude", *light: str):
    """(a question to `advise` about the planets, the true value of its quantity); ``light`` bodies are massless."""
    question = ask(system().massless(*light) if light else system(), t_end=T, accuracy=accuracy, quantity_name=quantity)
    return question, truths.truth(question.problem, question.quantity, T)


@pytest.mark.parametrize("body", ["saturn", "pluto"])
def test_error_of_leaving_a_body_out_agrees_with_rebound(body):
    others = [n for n in NAMES if n != body]
    expected = abs(longitude(*others) - longitude(*NAMES))
    assert Models(*question_and_truth()).off(Model(left_out=(body,))) == pytest.approx(expected, rel=1e-3, abs=3e-12)


def test_error_of_a_massless_planet_agrees_with_rebound():
    expected = abs(longitude(*NAMES, light=("jupiter",)) - longitude(*NAMES))
    found = Models(*question_and_truth())
    assert found.off(Model(light=("jupiter",))) == pytest.approx(expected, rel=1e-3)
    assert found.off(Model(left_out=("jupiter",))) == np.inf


def test_more_bodies_are_left_out_at_less_accuracy():
    found = Models(*question_and_truth())
    at = {allowed: fewer_bodies.smallest_model(found, allowed)[0] for allowed in (1e-12, 1e-7, 1e-4, 1.0)}
    assert at[1e-12] == Model()
    assert set(at[1e-7].left_out) == {"pluto"}
    assert set(at[1e-4].left_out) == {"pluto", "neptune"}
    assert set(at[1.0].left_out) == set(NAMES)
    for allowed, model in at.items():
        assert model == Model() or found.off(model) <= allowed


def candidate(question, true, id="wisdom-holman", steps=100):
    trial = Trial(integrator(id), Search(question, true).task(), 5.0)
    return Candidate(trial, trial.at(float(steps)))


def test_answer_names_bodies_error_and_saving():
    question, true = question_and_truth()
    found = fewer_bodies.lower(question, true, candidate(question, true))
    assert set(found["left_out"]) == {"pluto", "neptune"}
    assert found["test_particles"] == []
    expected = abs(longitude("saturn", "uranus") - longitude(*NAMES))
    assert found["off"] == pytest.approx(expected, rel=1e-3)
    assert found["saves"] > 0
    assert set(found["alone"]) == {"jupiter", *NAMES}
    assert found["model"] in models.summarize(found)


def test_energy_keeps_bodies_as_test_particles():
    question, true = question_and_truth(1e-7, "energy")
    found = fewer_bodies.lower(question, true, candidate(question, true))
    assert (found["left_out"], found["test_particles"]) == ([], ["pluto"])
    light = system().massless("pluto")
    run = pb.integrate(light, "heyoka", tol=1e-15, t_end=T, steps=200)
    mass = np.repeat(np.array(system().bodies.masses) / np.array(light.bodies.masses), 3)
    H = system().system.energies(run.q, run.p * mass)
    from phasebench.benchmarks.measure.quantities import scale

    assert found["off"] == pytest.approx(np.abs(H - H[0]).max() / scale(system()), rel=0.2)


def test_reason_where_no_model_can_be_measured(monkeypatch):
    question, true = question_and_truth()
    monkeypatch.setattr(fewer_bodies, "LONGEST", 0.0)
    found = fewer_bodies.lower(question, true, None)
    assert (found["model"], found["off"]) == (None, None)
    assert found["why"] in models.summarize(found)
    monkeypatch.undo()
    found = fewer_bodies.lower(replace(question, accuracy=1e-14), true, None)
    assert found["off"] is None
