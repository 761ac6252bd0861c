"""Simplified models in advice: those of a problem are found by its H and initial state, and judged by their rows."""

from __future__ import annotations

import json
from itertools import pairwise
from math import inf

import pandas as pd
import pytest

from phasebench.benchmarks.advice import bench_stored, models
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


def rungs(small=1e-2, large=1e-5, price=1e-6):
    """Fabricated runs, each (error, seconds), of two simplified models of a problem and of the full one.

    The modelling errors are ``small`` and ``large``; a run of a simplified model costs half as much.
    """
    runs = [(10.0**-k, 10 ** (k / 4)) for k in range(1, 13)]
    lower = tuple((e, price * s / 2) for e, s in runs)
    return (
        Rung("least", False, small, lower),
        Rung("middle", False, large, tuple((e, 1.1 * s) for e, s in lower)),
        Rung("full", True, 0.0, tuple((e, 1e-6 * s) for e, s in runs)),
    )


def replace_ladders(monkeypatch, *scenes):
    """Replace the stored table of simplified models and the costs of their runs by these scenes."""
    monkeypatch.setattr(models.TABLE, "load", lambda: scenes)


def question(accuracy=1e-3, t_end=10.0, name="pendulum:swinging", **more):
    """A question to `advise` about a registered problem."""
    return ask(problem(name), t_end=t_end, accuracy=accuracy, **more)


def scene(t_end=10.0, quantity="end-state", **more):
    return Scene(KEY, 1, t_end, quantity, rungs(**more))


# -- which model -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("accuracy", "model"), [(5e-2, "least"), (1.05e-2, "middle"), (9e-3, "middle"), (1.2e-5, "middle"), (9e-6, None)]
)
def test_cheapest_model_that_meets_the_accuracy(monkeypatch, accuracy, model):
    """Modelling and integration error add up: at accuracy 1.05e-2 the coarsest model leaves 5e-4 to the integration."""
    replace_ladders(monkeypatch, scene())
    found = models.lower(question(accuracy))
    assert found["model"] == model
    assert found["t_end"] == 10.0
    if model is None:
        assert (found["nearest"], found["off"]) == ("middle", 1e-5)


def test_saving_is_computed_at_the_requested_accuracy(monkeypatch):
    replace_ladders(monkeypatch, scene())
    assert models.lower(question(2e-2))["saves"] == pytest.approx(2.0)
    assert models.lower(question(2e-3))["saves"] == pytest.approx(2 / 1.1)
    text = models.summarize(models.lower(question(2e-2)))
    assert text == "a lower model would do: least, off by 0.01 at t = 10, where the full one takes 2 times as long"


def test_model_that_is_no_cheaper_saves_nothing(monkeypatch):
    replace_ladders(monkeypatch, scene(price=1e-5))
    text = models.summarize(models.lower(question(2e-2)))
    assert "but it saves no time: the full one takes 0.2 times as long" in text


def test_nearest_model_is_named_where_none_suffices(monkeypatch):
    replace_ladders(monkeypatch, scene())
    text = models.summarize(models.lower(question(1e-9)))
    assert text == "no lower model would do: the nearest (middle) is off by 1e-05 at t = 10"


def test_no_saving_beyond_the_full_models_accuracy(monkeypatch):
    least, middle, full = rungs(1e-13, 1e-5)
    finer = least._replace(runs=(*least.runs, (1e-14, 1.0)))
    replace_ladders(monkeypatch, Scene(KEY, 1, 10.0, "end-state", (finer, middle, full)))
    found = models.lower(question(2e-13))
    assert found["model"] == "least"
    assert found["saves"] is None
    assert "was not integrated to that accuracy" in models.summarize(found)


# -- the matching scene ------------------------------------------------------------------------------------------------


def test_span_is_answered_by_the_next_longer_ladder(monkeypatch):
    replace_ladders(monkeypatch, scene(100.0, large=1e-4), scene(10.0), scene(10.0, quantity="trajectory", small=1e-7))
    assert models.lower(question(t_end=3.0))["t_end"] == 10.0
    assert models.lower(question(t_end=10.1))["t_end"] == 100.0
    assert models.lower(question(t_end=101.0)) is None


def test_questions_without_a_ladder(monkeypatch):
    replace_ladders(monkeypatch, scene())
    assert models.lower(question()) is not None
    assert models.lower(question(quantity_name="energy")) is None
    assert models.lower(question(name="pendulum:rotating")) is None
    assert models.lower(question(name="harmonic-oscillator")) is None
    assert models.lower(question(name="henon-heiles:box")) is None
    assert models.lower(ask(problem("pendulum:swinging"), t_end=10.0, budget=1e-3)) is None
    assert models.lower(question(name="lotka-volterra:4-2")) is None  # not canonical


def test_two_ladders_of_one_span_are_merged(monkeypatch):
    replace_ladders(monkeypatch, scene(small=5e-3), scene(small=1e-1, large=1e-9))
    assert models.lower(question(1e-8))["off"] == 1e-9
    assert models.lower(question(2e-2))["off"] == 5e-3


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
    head = [
        {"scene": LADDERS[0].id, "rung": k, "model": n, "full": n == names[-1], "modelling error": 10.0**-k}
        | {"integration": 1e-15, "uncertainty": 2e-15}
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
    found = models.TABLE.load()
    assert len(found) == len(LADDERS)
    for one, ladder in zip(found, LADDERS, strict=True):
        assert (one.t_end, one.quantity) == (ladder.t_end, ladder.quantity)
        assert [r.model for r in one.rungs] == [r.name for r in ladder.rungs]
        assert [r.full for r in one.rungs] == [False] * (len(ladder.rungs) - 1) + [True]
        for r in one.rungs:
            assert all(a[0] > b[0] and a[1] < b[1] for a, b in pairwise(r.runs))
            assert r.cost(1e300) < inf


def test_table_is_saved_only_with_complete_updates(monkeypatch):
    saved = []
    monkeypatch.setattr(models.TABLE, "save", lambda *rows: saved.extend(models.build(*rows)))

    class Outcome:
        def rows(self, table):
            return tables()[table == "models_runs"].to_dict("records")

    for complete, update in ((False, True), (True, False)):
        with pytest.raises(pytest.skip.Exception):
            bench_stored.bench_models(Outcome(), lambda table, c=complete: c, update)
    assert not saved
    bench_stored.bench_models(Outcome(), lambda table: True, True)
    assert len(saved) == 10


# -- output ------------------------------------------------------------------------------------------------------------


def test_lower_model_is_in_the_answer_and_on_the_terminal(monkeypatch):
    monkeypatch.setattr(advise, "__defaults__", ((), only("heyoka")))
    made = with_start(problem("pendulum"), (0.5,), (0.0,))
    answer = advise(ask(made, t_end=10.0, accuracy=1e-2, limit=60.0), portfolio_of=only("heyoka"))
    lower = answer["lower_model"]["model"]
    assert lower in ("harmonic, Lindstedt's frequency", "sin q to q^3"), "two of nearly one price"
    few_seconds = ["--accuracy", "1e-2", "--time-limit", "60"]
    done = call("advise", "pendulum", "--q", "0.5", "--p", "0", "--t-end", "10", *few_seconds)
    off = {"sin q to q^3": "0.0008"}.get(lower, "0.0015")
    assert f"a lower model would do: {lower}, off by {off}" in done.stdout
    done = call("advise", "pendulum:rotating", "--t-end", "3", *few_seconds, "--json")
    assert json.loads(done.stdout)["lower_model"] is None
