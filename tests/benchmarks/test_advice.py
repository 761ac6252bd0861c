"""Advice: the search finds the widest step that does, what is named was run, and what cannot be told is not advised."""

from __future__ import annotations

import json
import re
import shlex
from math import inf

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import phasebench as pb
from phasebench.benchmarks.advice import kept, prior, search, words
from phasebench.benchmarks.advice import portfolio as portfolios
from phasebench.benchmarks.advice.advise import advise
from phasebench.benchmarks.advice.ask import ask
from phasebench.benchmarks.advice.exact import REMARK
from phasebench.benchmarks.advice.hunt import Candidate, Search
from phasebench.benchmarks.advice.known import known
from phasebench.benchmarks.advice.trial import Point, Trial
from phasebench.benchmarks.cli import app
from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.integrator import OURS, integrator
from phasebench.benchmarks.measure.quantities import Truth
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import DIVERGED
from phasebench.integrators.errors import InvalidInput

FEW = ("heyoka", "stormer-verlet", "blanes-moan-srkn11b", "rk4", "rebound-leapfrog-8")


def of(*ids):
    """A portfolio of a few, by which a search costs little."""
    return lambda asked, accuracy: ([(integrator(id), 1.0) for id in ids], [])


SPHERE = "schwarzschild:photon-sphere"


def question(name="pendulum", t_end=10.0, accuracy=1e-5, **more):
    return ask(problem(name), t_end=t_end, accuracy=accuracy, **more)


def call(*arguments):
    done = CliRunner().invoke(app, list(arguments))
    return done.exit_code, done.stdout, done.stderr


# -- the search, on laws that are known ------------------------------------------------------------------------------


def trial(law, id="rk4", accuracy=1e-6, uncertainty=0.0) -> Trial:
    """A trial whose runs follow a law: size -> (error, seconds), or None where it breaks."""
    made = Trial(integrator(id), question(accuracy=accuracy), Truth(np.ones(2), uncertainty, "a law"), inf)

    def run(size):
        found = law(next(iter(size.values())))
        steps = size.get("steps", 100)
        return Point(size, inf, 0.0, 0, DIVERGED, "it breaks") if found is None else Point(size, *found, steps)

    made._run = run
    return made


@pytest.mark.parametrize("order", [1, 2, 4, 8])
@pytest.mark.parametrize("start", [3, 100, 40_000])
def test_the_widest_step_of_a_power_law_is_found(order, start):
    made = trial(lambda n: ((20 / n) ** order, 1e-6 * n), accuracy=1e-6)
    least = 20 * 1e6 ** (1 / order)
    found = search.search(made, 1e-6, start)
    if least > 1e7:
        assert found.point is None
        return
    assert least <= found.point.size["steps"] <= 1.1 * least + 1


def test_where_wide_steps_take_ever_more_sweeps_a_shorter_step_is_the_cheapest():
    """Below 1000 steps each one takes forty times as long; 200 meet the accuracy."""
    made = trial(lambda n: ((20 / n) ** 6, 1e-6 * n * (40 if n < 1000 else 1)))
    found = search.search(made, 1e-6, 1500)
    assert any(n < 1000 and made.meets(p, 1e-6) for n, p in made.points.items()), "a wider step was tried"
    assert found.point.size["steps"] == 1500


def test_a_step_that_breaks_is_left_for_a_shorter_one():
    found = search.search(trial(lambda n: None if n < 500 else ((20 / n) ** 4, 1e-6 * n)), 1e-3, 8)
    assert 500 <= found.point.size["steps"] <= 560


def test_an_error_that_falls_no_longer_is_told():
    found = search.search(trial(lambda n: (max((20 / n) ** 4, 3e-9), 1e-6 * n)), 1e-10, 100)
    assert found.point is None
    assert "falls no longer: 3e-09" in found.why


def test_a_candidate_that_cannot_win_is_given_up():
    made = trial(lambda n: ((20 / n) ** 2, 1e-6 * n))
    found = search.search(made, 1e-9, 1000, cheapest=1e-4)
    assert found.point is None
    assert "too slow" in found.why
    assert len(made.points) <= 3


def test_one_that_breaks_everywhere_is_given_up():
    made = trial(lambda n: None)
    found = search.search(made, 1e-3, 8)
    assert found.point is None
    assert len(made.points) <= search.FAILURES
    assert "it breaks" in found.why


def test_the_uncertainty_of_what_is_true_counts():
    law = trial(lambda n: ((20 / n) ** 4, 1e-6 * n), uncertainty=5e-7)
    found = search.search(law, 1e-6, 100)
    assert found.point.error <= 5e-7


def test_a_tolerance_is_loosened_until_it_does():
    found = search.search(trial(lambda tol: (10 * tol, 1e-3 * tol**-0.1), id="heyoka"), 1e-6, 1e-9)
    assert 2.5e-8 <= found.point.size["tol"] <= 1e-7


def test_the_best_within_a_time():
    made = trial(lambda n: ((20 / n) ** 4, 1e-6 * n))
    found = search.best_within(made, 0.01, 100)
    assert 7000 <= found.point.size["steps"] <= 10_000
    assert search.best_within(trial(lambda n: (1.0, 1.0)), 0.01, 100).point is None


# -- who is exact ---------------------------------------------------------------------------------------------------


def test_who_is_exact_is_tried_before_who_was_cheap_and_the_kinds_take_turns():
    members, _ = portfolios.portfolio(question("kepler"), 1e-5)
    first, *tried = [i.id for i, _ in members]
    assert first == portfolios.FIRST
    assert set(tried[:2]) == {"wisdom-holman", "rebound-whfast"}
    assert {i.id for i, expected in members if expected == 0.0} >= {"wisdom-holman-saba-2", "rebound-saba-1"}
    for inexact in ("perturbed-kepler", "pendulum"):
        assert all(expected > 0.0 for _, expected in portfolios.portfolio(question(inexact), 1e-5)[0])


@pytest.mark.parametrize(("name", "remark"), [("kepler", REMARK), ("perturbed-kepler", "")])
def test_what_is_exact_is_offered_at_one_step_and_said_to_be(name, remark):
    found = advise(question(name, 20.0, 1e-3), portfolio_of=of("heyoka", "rebound-whfast-plain"))
    exact = {c["integrator"]: c for c in (found["choice"], *found["alternatives"])}["rebound-whfast-plain"]
    assert (exact["remark"], exact["steps"] == 1) == (remark, bool(remark))
    if remark:
        assert found["choice"]["integrator"] == "rebound-whfast-plain"
        assert found["verified"]
        assert found["alternatives"][0]["remark"] == "", "heyoka is not"


def test_a_run_of_more_steps_than_it_needs_is_no_proof_of_exactness():
    """Another's problem may bear the name of one that is known."""
    made = Trial(integrator("rebound-whfast-plain"), question("kepler"), Truth(np.ones(2), 0.0, "a law"), inf)
    said = [Candidate(made, Point({"steps": n}, 1e-9, 1.0, n)).row(made.ask, None)["remark"] for n in (1, 2)]
    assert said == [REMARK, ""]


def test_the_search_for_one_that_is_exact_begins_at_one_step_and_ends_there():
    hunt = Search(question("kepler"), Truth(np.ones(2), 0.0, "a law"), 0.0)
    exact, other = (
        Trial(integrator(id), hunt.ask, hunt.true, inf) for id in ("rebound-whfast-plain", "stormer-verlet")
    )
    assert hunt.start(exact, 1e-5) == 1.0 < hunt.start(other, 1e-5)
    law = trial(lambda n: (1e-12, 1e-6 * n))
    assert search.search(law, 1e-6, 1.0).point.size == {"steps": 1}
    assert len(law.points) == 1


# -- an answer -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def answer():
    return advise(question(), portfolio_of=of(*FEW))


def test_the_choice_was_run_and_is_the_cheapest(answer):
    assert answer["verified"]
    assert answer["why"] == ""
    candidates = [answer["choice"], *answer["alternatives"]]
    assert all(c["error"] + c["uncertainty"] <= 1e-5 for c in candidates)
    assert answer["choice"]["seconds"] == min(c["seconds"] for c in candidates)
    assert integrator(answer["own"]["integrator"]).kind == OURS
    assert integrator(answer["peer"]["integrator"]).kind != OURS
    assert answer["next"]["error"] <= 1e-6
    assert {"integrator", "params", "model", "command", "error", "uncertainty", "seconds"} <= set(answer["choice"])


def test_the_command_runs_as_it_stands(answer):
    for role in ("own", "peer", "next"):
        program, *arguments = shlex.split(answer[role]["command"])
        code, text, _ = call(*arguments, "--json")
        assert (program, code) == ("phasebench", 0)
        printed = json.loads(text)
        # Of a splitting a row between two steps rounds otherwise than none.
        assert printed["global_error"] == pytest.approx(answer[role]["error"], rel=1e-6, abs=1e-14)
        assert printed["reference"]["uncertainty"] <= 1e-14


def test_a_wrong_reference_is_seen(monkeypatch):
    """Control: where what is true is something else, nothing meets it and nothing is advised."""
    right = truths.truth
    moved = lambda *of: right(*of)._replace(values=right(*of).values + 1e-3)  # noqa: E731
    monkeypatch.setattr(truths, "truth", moved)
    found = advise(question(), portfolio_of=of(*FEW))
    assert (found["choice"], found["verified"]) == (None, False)
    assert "nothing that was tried meets 1e-05" in found["why"]


def test_what_the_references_own_kind_says_alone_is_not_verified():
    assert not advise(question(), portfolio_of=of("heyoka"))["verified"]


@pytest.mark.parametrize(
    ("name", "t_end", "accuracy", "why"),
    [
        ("henon-heiles:chaotic", 1000.0, 1e-3, "past its horizon"),
        ("pendulum", 10.0, 1e-17, "the reference itself is known to"),
        ("pendulum", 10.0, 5.0, "anything meets it"),
        ("pendulum", 1000.0, 3e-15, "nothing that was tried meets"),
    ],
)
def test_what_cannot_be_told_is_not_advised(name, t_end, accuracy, why):
    found = advise(question(name, t_end, accuracy), portfolio_of=of("heyoka", "rk4"))
    assert found["choice"] is None
    assert not found["verified"]
    assert why in found["why"]


def advised_until(name: str, t_end: float, accuracy: float, **more) -> float:
    """The time to which a refusal says that the quantity is known."""
    true, why = known(question(name, t_end, accuracy, **more))
    assert true is not None
    return float(re.search(r"known to t = ([0-9.e+]+):", why)[1])


@pytest.mark.parametrize(
    ("name", "t_end", "accuracy"),
    [("henon-heiles:chaotic", 1000.0, 1e-4), ("henon-heiles:chaotic", 391.0, 1e-7), (SPHERE, 60.0, 1e-5)],
)
def test_the_span_that_a_refusal_tells_is_the_longest_that_is_not_refused(name, t_end, accuracy):
    """It is advised on to that time, and a fifth later it is not: distances come and go, and grow by 100 in that."""
    until = advised_until(name, t_end, accuracy)
    assert 0 < until < t_end
    assert known(question(name, until, accuracy))[1] == ""
    assert "past its horizon" in known(question(name, 1.2 * until, accuracy))[1]


def test_an_energy_is_advised_where_the_orbit_is_lost():
    found = advise(
        question("henon-heiles:chaotic", 500.0, 1e-6, quantity_name="energy"), portfolio_of=of("heyoka", "pefrl")
    )
    assert found["verified"]
    assert "--quantity energy" in found["choice"]["command"]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"accuracy": None}, "either the accuracy"),
        ({"budget": 1.0}, "either the accuracy"),
        ({"accuracy": -1.0}, "accuracy is -1.0"),
        ({"t_end": inf}, "t_end is inf"),
        ({"quantity_name": "end-sate"}, "end-state"),
        ({"conserve": ["symplektic"]}, "symplectic"),
    ],
)
def test_what_cannot_be_asked(more, message):
    with pytest.raises(InvalidInput, match=message):
        question(**more)


# -- what is kept ----------------------------------------------------------------------------------------------------


def test_what_is_declared_decides_who_is_tried():
    assert "symplectic" in kept.refused(integrator("rk4"), ["symplectic"])
    assert kept.refused(integrator("stormer-verlet"), ["symplectic"]) is None
    assert kept.refused(integrator("stormer-verlet"), ["energy"])
    assert "its package does not state" in kept.refused(integrator("scipy-dop853"), ["symplectic"])
    members, dropped = portfolios.portfolio(question(conserve=("symplectic",)), 1e-5)
    ids = [i.id for i, _ in members]
    assert "pefrl" in ids
    assert "rk4" not in ids
    assert {"rk4", "heyoka-batch", "gautschi"} <= {d.integrator for d in dropped}


def test_what_is_kept_is_measured():
    asked = question("henon-heiles:box", conserve=("symplectic", "energy"))
    assert "energy" in kept.broken(integrator("stormer-verlet"), asked, {"steps": 100})
    asked = question("henon-heiles:box", conserve=("symplectic",))
    assert kept.broken(integrator("stormer-verlet"), asked, {"steps": 100}) is None
    assert "not symplectic" in kept.broken(integrator("rk4"), asked, {"steps": 20})
    asked = question("pendulum:rotating", conserve=("symplectic",))  # it starts at q = 0
    assert kept.broken(integrator("stormer-verlet"), asked, {"steps": 30}) is None
    assert "not symplectic" in kept.broken(integrator("rk4"), asked, {"steps": 30})
    # Of a step so wide that differences cannot tell nothing is said.
    assert kept.symplecticity_defect(integrator("stormer-verlet"), problem("kepler"), 6.0) == 0.0
    asked = question("kepler", conserve=("momentum",))
    assert "angular-momentum" in kept.broken(integrator("rk4"), asked, {"steps": 200})
    assert kept.broken(integrator("gauss-4"), asked, {"steps": 200}) is None


# -- whom to try first -----------------------------------------------------------------------------------------------


def test_the_prior_is_of_the_rows():
    rows = pd.DataFrame(
        {
            "scene": ["a1", "a1", "a1", "b1", "c1", "c1", "c2"],
            "problem": ["a", "a", "a", "b", "c", "c", "c"],
            "id": ["x", "y", "x", "y", "x", "y", "x"],
            "error": [1e-7, 1e-5, 1e-4, 1e-9, 1e-9, 1e-9, 1e-9],
            "seconds": [4.0, 1.0, 0.5, 1.0, 4.0, 1.0, 9.0],
        }
    )
    lines = {(r["problem"], r["decade"], r["integrator"]): r["factor"] for r in prior.made(rows)}
    assert lines["a", -4, "x"] == 1.0
    assert lines["a", -4, "y"] == 2.0
    assert lines["a", -5, "x"] == 4.0
    assert ("a", -6, "y") not in lines
    assert lines["b", -9, "y"] == 1.0
    assert ("b", -10, "y") not in lines
    assert lines["c", -9, "x"] == 2.0  # 4 times in one scene, the cheapest of the other
    assert lines["c", -9, "y"] == pytest.approx(prior.LARGEST**0.5, abs=0.01)  # not there in the other


def test_factors_are_of_the_problem_or_of_all(monkeypatch):
    tables = {"a": {-6: {"x": 1.0, "y": 4.0}}, "b": {-6: {"x": 4.0}}}
    monkeypatch.setattr(prior, "stored", lambda: tables)
    assert prior.factors("a", 2e-6, ["x", "y", "z"]) == {"x": 1.0, "y": 4.0, "z": prior.LARGEST}
    assert prior.factors("new", 2e-6, ["x", "y", "z"]) == pytest.approx({"x": 2.0, "y": 4.0, "z": prior.LARGEST})
    assert prior.factors("new", 1e-9, ["x"]) == {"x": prior.UNKNOWN}


def test_the_stored_prior_is_of_what_there_is():
    ids = {id for table in prior.stored().values() for row in table.values() for id in row}
    assert len(ids) > 50
    assert all(integrator(id) for id in ids)


# -- in Python, and on the terminal ----------------------------------------------------------------------------------


def test_a_system_of_ones_own_is_advised_with_a_formula():
    system = pb.Hamiltonian(q="x", p="y", H="y**2/2 + x**4/4")
    table = pb.advise(system, t_end=3.0, accuracy=1e-3, q0=[1.0], p0=[-0.5], limit=1.0)
    assert table.attrs["verified"]
    assert table["role"].iloc[0] == "choice"
    command = table["command"].iloc[0]
    assert "--hamiltonian 'p**2/2 + q**4/4' --q 1.0 --p=-0.5" in command
    code, text, _ = call(*shlex.split(command)[1:], "--json")
    assert code == 0
    assert json.loads(text)["global_error"] == table["error"].iloc[0]


def test_parameters_are_in_the_command():
    assert words.named(problem("kepler", e=0.2)) == ["kepler", "--set", "e=0.2"]
    assert words.named(problem("kepler")) == ["kepler"]
    assert words.named(problem("henon-heiles:box")) == ["henon-heiles:box"]


def test_the_command_line_answers_and_its_exit_code_says_so():
    code, text, _ = call("advise", "pendulum", "--t-end", "5", "--accuracy", "1e-3", "--limit", "1")
    assert code == 0
    assert "verified: run against the reference" in text
    assert text.strip().splitlines()[-1].startswith("phasebench integrate pendulum")
    code, text, _ = call("advise", "pendulum", "--t-end", "5", "--accuracy", "1e-17", "--json")
    answer = json.loads(text)
    assert code == 1
    assert answer["choice"] is None
    assert answer["why"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["pendulum", "--accuracy", "1e-3"], "--t-end"),
        (["--t-end", "1", "--accuracy", "1e-3"], "give a problem"),
        (["pendulun", "--t-end", "1", "--accuracy", "1e-3"], "pendulum"),
        (["pendulum", "--t-end", "1"], "either the accuracy"),
    ],
)
def test_a_wrong_question_is_invalid(arguments, message):
    code, text, said = call("advise", *arguments)
    assert code == 2
    assert message in text + said


def test_a_search_that_had_no_time_says_so():
    nobody = advise(ask(problem("pendulum"), t_end=10.0, accuracy=1e-2, limit=1e-9))
    assert "no integrator was tried" in nobody["why"]
    assert "--limit" in nobody["why"]
