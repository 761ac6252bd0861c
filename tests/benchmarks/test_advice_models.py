"""Simplified models in advice: those of a problem are found by its H and initial state, and judged by their rows."""

from __future__ import annotations

import json
from itertools import pairwise
from math import inf

import pandas as pd
import pytest

from phasebench.benchmarks.advice import models
from phasebench.benchmarks.advice.advise import advise
from phasebench.benchmarks.advice.ask import ask
from phasebench.benchmarks.advice.models import Rung, Scene
from phasebench.benchmarks.measure.global_error import with_start
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.models.ladders import LADDERS
from phasebench.benchmarks.problems.user import from_formula
from support.commands import call
from support.portfolios import only

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
    assert lower(monkeypatch, scene()) is not None
    assert lower(monkeypatch, scene(), **more) is None


def test_scene_is_identified_by_h_and_initial_state():
    made = problem("pendulum:swinging")
    q, p = made.q0, made.p0
    assert models.fingerprint(from_formula("p**2/2 - cos(q)", q, p, {})) == KEY
    assert models.fingerprint(with_start(problem("pendulum:rotating"), q, p)) == KEY
    assert models.fingerprint(from_formula("p**2/2 - cos(q)", [q[0] + 1e-15], p, {})) != KEY
    assert models.fingerprint(from_formula("p**2/2 - 2*cos(q)", q, p, {})) != KEY


# -- the stored table --------------------------------------------------------------------------------------------------


def tables():
    """The two tables of the models' page for one scene: three runs of each model, one of them dominated."""
    names = [r.name for r in LADDERS[0].rungs]
    known = {"scene": LADDERS[0].id, "integration": 1e-15, "uncertainty": 2e-15}
    head = [
        known | {"rung": k, "model": n, "full": n == names[-1], "modelling error": 10.0**-k}
        for k, n in enumerate(names)
    ]
    run = [
        {"scene": LADDERS[0].id, "rung": k, "error": e, "seconds": s}
        for k in range(len(names))
        for e, s in ((1e-2, 1e-6), (2e-2, 2e-6), (1e-8, 3e-6))
    ]
    return pd.DataFrame(head), pd.DataFrame(run)


def test_stored_table_is_read_back(monkeypatch, tmp_path):
    monkeypatch.setattr(models.TABLE, "path", tmp_path / "models.csv")
    assert models.TABLE.load() == ()
    models.TABLE.save(*tables())
    (found,) = models.TABLE.load()
    assert (found.d, found.t_end, found.quantity) == (1, LADDERS[0].t_end, LADDERS[0].quantity)
    assert [r.full for r in found.rungs] == [False] * 4 + [True]
    assert [r.off for r in found.rungs] == [1.0, 0.1, 0.01, 0.001, 0.0]
    assert all(r.runs == ((1e-2, 1e-6), (1e-8, 3e-6)) for r in found.rungs)
    assert found.key == models.fingerprint(LADDERS[0].rungs[-1].make())


def test_shipped_table_has_every_ladder():
    for one, ladder in zip(models.TABLE.load(), LADDERS, strict=True):
        assert (one.t_end, one.quantity) == (ladder.t_end, ladder.quantity)
        assert [r.model for r in one.rungs] == [r.name for r in ladder.rungs]
        for r in one.rungs:
            assert all(a[0] > b[0] and a[1] < b[1] for a, b in pairwise(r.runs))
            assert r.cost(1e300) < inf


def test_lower_model_is_in_the_answer_and_on_the_terminal(monkeypatch):
    monkeypatch.setattr(advise, "__defaults__", ((), only("heyoka")))
    asked = ["--accuracy", "1e-2", "--time-limit", "60"]
    start = ["advise", "pendulum", "--q", "0.5", "--p", "0", "--t-end", "10", *asked]
    found = json.loads(call(*start, "--json").stdout)["lower_model"]
    assert found["model"] in ("harmonic, Lindstedt's frequency", "sin q to q^3"), "two of nearly one price"
    assert "a lower model would do" in call(*start).stdout
    done = call("advise", "pendulum:rotating", "--t-end", "3", *asked, "--json")
    assert json.loads(done.stdout)["lower_model"] is None
