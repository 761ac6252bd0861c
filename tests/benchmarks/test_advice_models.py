"""Simplified models in advice: fewer bodies against REBOUND; those of a problem, judged by their stored rows."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.advice import fewer_bodies, models
from phasebench.benchmarks.advice.advise import advise
from phasebench.benchmarks.advice.ask import ask
from phasebench.benchmarks.advice.fewer_bodies import Model, Models
from phasebench.benchmarks.advice.hunt import Candidate, Search
from phasebench.benchmarks.advice.models import Rung, Scene
from phasebench.benchmarks.ladder.trial import Trial
from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.global_error import with_start
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.outer_solar_system import BODIES, G
from phasebench.benchmarks.problems.user import from_formula
from support.commands import call
from support.orbits import true_longitude
from support.portfolios import only

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


def test_error_of_a_massless_planet_agrees_with_rebound():
    expected = abs(longitude(*NAMES, light=("jupiter",)) - longitude(*NAMES))
    found = Models(*question_and_truth())
    assert found.off(Model(light=("jupiter",))) == pytest.approx(expected, rel=1e-3)
    assert found.off(Model(left_out=("jupiter",))) == np.inf


def test_bodies_are_left_out_while_all_of_them_together_do_not_matter():
    off = {"pluto": 1e-9, "neptune": 6e-5, "uranus": 7e-5}
    made_up = SimpleNamespace(
        bodies=system().bodies, off=lambda model: sum(off.get(name, 1.0) for name in (*model.left_out, *model.light))
    )
    for allowed, left_out in ((1e-12, set()), (1e-7, {"pluto"}), (1e-4, {"pluto", "neptune"}), (2e-4, {*off})):
        assert {*fewer_bodies.smallest_model(made_up, allowed)[0].left_out} == left_out


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


# -- other models ------------------------------------------------------------------------------------------------------


KEY = models.fingerprint(problem("pendulum:swinging"))


def scene(t_end=10.0, quantity="end-state", small=1e-2, large=1e-5, price=1e-6, finest=()):
    """Fabricated runs of two simplified models, off by ``small`` and ``large``, and of the full one, at twice the cost.

    ``finest`` are further runs of the least model.
    """
    runs = [(10.0**-k, 10 ** (k / 4)) for k in range(1, 13)]
    lower = tuple((e, price * s / 2) for e, s in runs)
    rungs = (
        Rung("least", False, small, (*lower, *finest)),
        Rung("middle", False, large, tuple((e, 1.1 * s) for e, s in lower)),
        Rung("full", True, 0.0, tuple((e, 1e-6 * s) for e, s in runs)),
    )
    return Scene(KEY, 1, t_end, quantity, rungs)


def lower(monkeypatch, *scenes, accuracy=1e-3, t_end=10.0, name="pendulum:swinging", **more):
    """The simplified model for a question about a registered problem, where these scenes are stored."""
    monkeypatch.setattr(models.TABLE, "load", lambda: scenes)
    return models.lower(ask(problem(name), t_end=t_end, accuracy=accuracy, **more))


@pytest.mark.parametrize(
    ("stored", "accuracy", "model", "saves"),
    [
        ({}, 2e-2, "least", 2.0),
        ({}, 1.05e-2, "middle", 2 / 1.1),  # modelling and integration error add up: 5e-4 would be left to integrate
        ({}, 2e-3, "middle", 2 / 1.1),
        ({}, 9e-6, None, None),
        ({"price": 1e-5}, 2e-2, "least", 0.2),
        ({"small": 1e-13, "finest": ((1e-14, 1.0),)}, 2e-13, "least", None),  # the full one was not run so finely
    ],
)
def test_cheapest_model_that_meets_the_accuracy(monkeypatch, stored, accuracy, model, saves):
    found = lower(monkeypatch, scene(**stored), accuracy=accuracy)
    assert (found["model"], found["t_end"]) == (model, 10.0)
    if model is None:
        assert (found["nearest"], found["off"]) == ("middle", 1e-5)
    elif saves is None:
        assert found["saves"] is None
    else:
        assert found["saves"] == pytest.approx(saves, rel=0.01)
    said = models.summarize(found)
    assert (model or "middle") in said
    assert ("saves no time" in said) is (saves == 0.2)


def test_span_is_answered_by_the_next_longer_ladder(monkeypatch):
    scenes = scene(100.0, large=1e-4), scene(10.0), scene(10.0, quantity="trajectory", small=1e-7)
    ends = {t: lower(monkeypatch, *scenes, t_end=t) for t in (3.0, 10.1, 101.0)}
    assert (ends[3.0]["t_end"], ends[10.1]["t_end"], ends[101.0]) == (10.0, 100.0, None)
    two = scene(small=5e-3), scene(small=1e-1, large=1e-9)
    assert [lower(monkeypatch, *two, accuracy=a)["off"] for a in (1e-8, 2e-2)] == [1e-9, 5e-3], "they are merged"


@pytest.mark.parametrize(
    "more",
    [
        {"quantity_name": "energy"},
        {"name": "pendulum:rotating"},
        {"name": "henon-heiles:box"},
        {"accuracy": None, "budget": 1e-3},
        {"name": "lotka-volterra:4-2"},  # not canonical
    ],
)
def test_questions_without_a_ladder(monkeypatch, more):
    assert lower(monkeypatch, scene(), **more) is None


def test_scene_is_identified_by_h_and_initial_state():
    made = problem("pendulum:swinging")
    q, p = made.q0, made.p0
    assert models.fingerprint(from_formula("p**2/2 - cos(q)", q, p, {})) == KEY
    assert models.fingerprint(with_start(problem("pendulum:rotating"), q, p)) == KEY
    assert models.fingerprint(from_formula("p**2/2 - cos(q)", [q[0] + 1e-15], p, {})) != KEY
    assert models.fingerprint(from_formula("p**2/2 - 2*cos(q)", q, p, {})) != KEY


# -- the stored table --------------------------------------------------------------------------------------------------


def test_lower_model_is_in_the_answer_and_on_the_terminal(monkeypatch):
    monkeypatch.setattr(advise, "__defaults__", ((), only("heyoka")))
    asked = ["--accuracy", "1e-2", "--time-limit", "60"]
    start = ["advise", "pendulum", "--q", "0.5", "--p", "0", "--t-end", "10", *asked]
    found = json.loads(call(*start, "--json").stdout)["lower_model"]
    assert found["model"] in ("harmonic, Lindstedt's frequency", "sin q to q^3"), "two of nearly one price"
    assert "a lower model would do" in call(*start).stdout
    done = call("advise", "pendulum:rotating", "--t-end", "3", *asked, "--json")
    assert json.loads(done.stdout)["lower_model"] is None
