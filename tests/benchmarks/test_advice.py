"""`advise`: the search finds the widest sufficient step, candidates are run, and unanswerable questions are refused."""

from __future__ import annotations

import json
import re
import shlex
import time
from dataclasses import replace
from math import inf
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import phasebench as pb
from phasebench.benchmarks.advice import portfolio as portfolios
from phasebench.benchmarks.advice import prior, words
from phasebench.benchmarks.advice.advise import advise, tied
from phasebench.benchmarks.advice.ask import Ask, ask
from phasebench.benchmarks.advice.bench_stored import competition
from phasebench.benchmarks.advice.hunt import Candidate, Search
from phasebench.benchmarks.advice.known import true_value
from phasebench.benchmarks.cli.advise import _roles
from phasebench.benchmarks.ladder import search
from phasebench.benchmarks.ladder.exact import REMARK
from phasebench.benchmarks.ladder.rung import Rung, Task
from phasebench.benchmarks.ladder.trial import Trial
from phasebench.benchmarks.measure import conservation_claims, truths
from phasebench.benchmarks.measure.global_error import with_start
from phasebench.benchmarks.measure.integrator import OURS, integrator
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.measure.quantities import Truth
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.user import from_formula
from phasebench.integrators.driver import DIVERGED, OK, TIMEOUT
from phasebench.integrators.errors import InvalidInput
from support.commands import call
from support.portfolios import only

FEW = ("heyoka", "stormer-verlet", "blanes-moan-srkn11b", "rk4", "rebound-leapfrog-8")


SPHERE = "schwarzschild:photon-sphere"


#: Seconds of a search that is to try every member of its portfolio, however slow the machine.
PATIENT = 120.0


def question(name="pendulum", t_end=10.0, accuracy=1e-5, limit=PATIENT, **more):
    return ask(problem(name), t_end=t_end, accuracy=accuracy, limit=limit, **more)


# -- the search on known laws of error and time ----------------------------------------------------------------------


def trial(law, id="rk4", accuracy=1e-6, uncertainty=0.0) -> Trial:
    """An integrator's search for its best size whose runs are fabricated.

    ``law`` maps the number of steps (or the tolerance) to (error, seconds), to None where the run diverges, or to
    `TIMEOUT`.
    """

    class Law(Task):
        def measure(self, c, *, steps=None, tol=None, **limits):
            found = law(tol or steps)
            if found == TIMEOUT:
                return Rung(steps, tol, TIMEOUT, inf, 1.0, reason="it takes too long")
            if found is None:
                return Rung(steps, tol, DIVERGED, inf, 0.0, reason="it breaks")
            return Rung(steps, tol, OK, *found, steps or 100)

    asked = question(accuracy=accuracy)
    task = Law(asked.problem, asked.t_end, asked.quantity, Truth(np.ones(2), uncertainty, "a law"))
    return Trial(integrator(id), task, inf)


@pytest.mark.parametrize("order", [1, 2, 4, 8])
@pytest.mark.parametrize("start", [3, 100, 40_000])
def test_widest_sufficient_step_of_a_power_law(order, start):
    made = trial(lambda n: ((20 / n) ** order, 1e-6 * n), accuracy=1e-6)
    least = 20 * 1e6 ** (1 / order)
    found = search.search(made, 1e-6, start)
    if least > 1e7:
        assert found.rung is None
        return
    assert least <= found.rung.steps <= 1.1 * least + 1


def test_shorter_step_wins_where_wide_steps_iterate_more():
    """Runs of fewer than 1000 steps take 40 times as long per step; 200 steps would meet the accuracy."""
    made = trial(lambda n: ((20 / n) ** 6, 1e-6 * n * (40 if n < 1000 else 1)))
    found = search.search(made, 1e-6, 1500)
    assert any(n < 1000 and made.meets(p, 1e-6) for n, p in made.rungs.items()), "a wider step was tried"
    assert found.rung.steps == 1500


def test_diverging_step_is_replaced_by_a_shorter_one():
    found = search.search(trial(lambda n: None if n < 500 else ((20 / n) ** 4, 1e-6 * n)), 1e-3, 8)
    assert 500 <= found.rung.steps <= 560


def test_error_floor_is_reported():
    found = search.search(trial(lambda n: (max((20 / n) ** 4, 3e-9), 1e-6 * n)), 1e-10, 100)
    assert found.rung is None
    assert "falls no longer: 3e-09" in found.why


def test_candidate_that_cannot_win_is_abandoned():
    made = trial(lambda n: ((20 / n) ** 2, 1e-6 * n))
    found = search.search(made, 1e-9, 1000, cheapest=1e-4)
    assert found.rung is None
    assert "too slow" in found.why
    assert len(made.rungs) <= 3


def test_candidate_that_always_diverges_is_abandoned():
    made = trial(lambda n: None)
    found = search.search(made, 1e-3, 8)
    assert found.rung is None
    assert len(made.rungs) <= search.FAILURES
    assert "it breaks" in found.why


@pytest.mark.parametrize("start", [8, 100, 2000])
def test_timeout_at_a_fine_step_leads_to_wider_steps(start):
    """The accuracy needs 640 steps; runs of more than 900 time out."""
    found = search.search(trial(lambda n: TIMEOUT if n > 900 else ((20 / n) ** 4, 1e-6 * n)), 1e-6, start)
    assert 640 <= found.rung.steps <= 900


def test_control_sufficient_steps_that_all_time_out():
    """The accuracy needs 640 steps; runs of more than 500 time out."""
    made = trial(lambda n: TIMEOUT if n > 500 else ((20 / n) ** 4, 1e-6 * n))
    assert search.search(made, 1e-6, 100).rung is None
    assert any(rung.status == TIMEOUT for rung in made.rungs.values())


def test_errors_as_large_as_the_quantity_are_not_extrapolated():
    """The error is as large as the quantity below 400 steps; extrapolation of two such runs would never reach 1e-6."""
    found = search.search(trial(lambda n: (min(1.0, (400 / n) ** 8), 1e-6 * n)), 1e-6, 10, cheapest=2e-3)
    assert found.rung is not None
    assert found.rung.error <= 1e-6


def test_expensive_fine_run_does_not_end_the_search():
    """100 steps diverge and 1600 cost three times the cheapest candidate; about 400 are sufficient and cheaper."""
    law = trial(lambda n: None if n < 300 else (1e-9 * (1600 / n) ** 4, 1e-6 * n))
    for size in (100, 1600):
        law.at(size)
    found = search.search(law, 1e-6, 1600, cheapest=5e-4)
    assert found.rung is not None
    assert found.rung.steps < 500


def test_error_above_asymptotic_range_is_not_extrapolated():
    """At wide steps the error is constant and small, as for a splitting about a good approximation."""
    made = trial(lambda n: (min(1e-4, (40 / n) ** 8), 1e-6 * n))
    found = search.search(made, 1e-7, 10, cheapest=1e-4)
    assert found.rung is not None


def test_time_scale_is_measured_without_heyoka_as_candidate():
    asked = question("pendulum", 1000.0)
    made = Search(asked, Truth(np.ones(2), 0.0, "a law"))
    assert made.start(Trial(integrator("stormer-verlet"), made.task(), inf), 1e-5) > 200


def test_search_begins_at_the_widest_step():
    asked = question()
    made = Search(asked, Truth(np.ones(2), 0.0, "a law"))
    made.pace = 400
    for id in ("stormer-verlet", "gauss-8"):
        assert made.start(Trial(integrator(id), made.task(), inf), 1e-12) == 100


def test_uncertainty_of_the_reference_counts():
    law = trial(lambda n: ((20 / n) ** 4, 1e-6 * n), uncertainty=5e-7)
    found = search.search(law, 1e-6, 100)
    assert found.rung.error <= 5e-7


def test_tolerance_is_loosened_as_far_as_possible():
    found = search.search(trial(lambda tol: (10 * tol, 1e-3 * tol**-0.1), id="heyoka"), 1e-6, 1e-9)
    assert 2.5e-8 <= found.rung.tol <= 1e-7


def test_most_accurate_run_within_a_time_budget():
    made = trial(lambda n: ((20 / n) ** 4, 1e-6 * n))
    found = search.best_within(made, 0.01, 100)
    assert 7000 <= found.rung.steps <= 10_000
    assert search.best_within(trial(lambda n: (1.0, 1.0)), 0.01, 100).rung is None


# -- exact methods --------------------------------------------------------------------------------------------------


def test_exact_methods_are_tried_first():
    members, _ = portfolios.portfolio(question("kepler"), 1e-5)
    first, *tried = [i.id for i, _ in members]
    assert first == portfolios.FIRST
    assert set(tried[:2]) == {"wisdom-holman", "rebound-whfast"}
    assert {i.id for i, expected in members if expected == 0.0} >= {"wisdom-holman-saba-2", "rebound-saba-1"}
    for inexact in ("perturbed-kepler", "pendulum"):
        assert all(expected > 0.0 for _, expected in portfolios.portfolio(question(inexact), 1e-5)[0])


@pytest.mark.parametrize(("name", "remark"), [("kepler", REMARK), ("perturbed-kepler", "")])
def test_exact_method_takes_one_step_and_is_remarked(name, remark):
    found = advise(question(name, 20.0, 1e-3), portfolio_of=only("rebound-whfast-plain"))
    exact = {c["integrator"]: c for c in (found["choice"], *found["alternatives"])}["rebound-whfast-plain"]
    assert (exact["remark"], exact["steps"] == 1) == (remark, bool(remark))
    if remark:
        assert found["verified"]


def test_exactness_needs_a_run_of_one_step():
    """Only a run of one step is remarked on as exact, because an unknown problem may have a known one's name."""
    asked = question("kepler")
    made = Trial(integrator("rebound-whfast-plain"), Search(asked, Truth(np.ones(2), 0.0, "a law")).task(), inf)
    said = [Candidate(made, Rung(n, None, OK, 1e-9, 1.0, n)).row(asked, None)["remark"] for n in (1, 2)]
    assert said == [REMARK, ""]


@pytest.mark.parametrize(("first_use", "tried"), [(10.0, ["rk4", "stormer-verlet", "heyoka"]), (1.0, [])])
def test_promising_members_are_tried_beyond_the_limit(monkeypatch, first_use, tried):
    """Compiling may take longer than the search, so the most promising candidates have until ``first_use`` seconds.

    Control: an explicit time limit holds for them too, so none is tried.
    """
    asked, attempts = replace(question(), limit=1.0, first_use=first_use), []
    hunt = Search(asked, Truth(np.ones(2), 0.0, "a law"))
    monkeypatch.setattr(Ask, "spent", 5.0)
    monkeypatch.setattr(hunt, "attempt", lambda integrator: attempts.append(integrator.id))
    costs = {"rk4": 1.0, "stormer-verlet": 2.4, "gauss-8": 2.6, "heyoka": 3.0, "rebound-ias15": 9.0}
    hunt.try_all([(integrator(id), cost) for id, cost in costs.items()])
    assert attempts == tried


def test_search_for_an_exact_method_ends_at_one_step():
    hunt = Search(question("kepler"), Truth(np.ones(2), 0.0, "a law"))
    exact, other = (Trial(integrator(id), hunt.task(), inf) for id in ("rebound-whfast-plain", "stormer-verlet"))
    assert hunt.start(exact, 1e-5) == 1.0 < hunt.start(other, 1e-5)
    law = trial(lambda n: (1e-12, 1e-6 * n))
    assert search.search(law, 1e-6, 1.0).rung.steps == 1
    assert len(law.rungs) == 1


# -- an answer -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def answer():
    return advise(question(), portfolio_of=only(*FEW))


def test_choice_was_run_and_is_the_cheapest(answer):
    assert answer["verified"]
    assert answer["why"] == ""
    candidates = [answer["choice"], *answer["alternatives"]]
    assert all(c["error"] + c["uncertainty"] <= 1e-5 for c in candidates)
    assert answer["choice"]["seconds"] == min(c["seconds"] for c in candidates)
    assert integrator(answer["own"]["integrator"]).kind == OURS
    assert integrator(answer["peer"]["integrator"]).kind != OURS
    assert answer["next"]["error"] <= 1e-6
    assert answer["next"]["accuracy"] == pytest.approx(1e-6)
    assert {"integrator", "params", "model", "command", "error", "uncertainty", "seconds"} <= set(answer["choice"])


def test_printed_command_reproduces_the_error(answer):
    for role in ("own", "peer", "next"):
        program, *arguments = shlex.split(answer[role]["command"])
        code, text, _ = call(*arguments, "--json")
        assert (program, code) == ("phasebench", 0)
        printed = json.loads(text)
        # Output between two steps changes the round-off of a splitting.
        assert printed["global_error"] == pytest.approx(answer[role]["error"], rel=1e-6, abs=1e-14)
        assert printed["reference"]["uncertainty"] <= 1e-14


def test_control_wrong_reference_is_detected(monkeypatch):
    """No run agrees with a wrong reference, so nothing is advised."""
    right = truths.truth
    moved = lambda *of: right(*of)._replace(values=right(*of).values + 1e-3)  # noqa: E731
    monkeypatch.setattr(truths, "truth", moved)
    found = advise(question(), portfolio_of=only(*FEW))
    assert (found["choice"], found["verified"]) == (None, False)
    assert "nothing that was tried meets 1e-05" in found["why"]


@pytest.mark.parametrize(
    ("name", "t_end", "accuracy", "why"),
    [
        ("henon-heiles:chaotic", 1000.0, 1e-3, "past its horizon"),
        ("pendulum", 10.0, 1e-17, "the reference itself is known to"),
        ("pendulum", 10.0, 5.0, "anything meets it"),
        ("pendulum", 1000.0, 3e-15, "nothing that was tried meets"),
    ],
)
def test_unanswerable_question_is_refused(name, t_end, accuracy, why):
    found = advise(question(name, t_end, accuracy), portfolio_of=only("heyoka", "rk4"))
    assert found["choice"] is None
    assert not found["verified"]
    assert why in found["why"]


def test_an_accurate_run_that_keeps_too_little_is_named():
    """No symplectic step keeps the energy too; the peer's package states only the first."""
    asked = question("kepler", 3.0, 1e-2, conserve=("symplectic", "energy"))
    why = advise(asked, portfolio_of=only("rebound-leapfrog"))["why"]
    assert "meets 0.01 and keeps symplectic, energy: rebound-leapfrog has an error of" in why
    assert "but its run does not keep energy" in why
    assert "no method does both" in why


def advised_until(name: str, t_end: float, accuracy: float, **more) -> float:
    """The time up to which the quantity is known, as the refusal to answer a question with a longer span states it."""
    true, why = true_value(question(name, t_end, accuracy, **more))
    assert true is not None
    return float(re.search(r"known to t = ([0-9.e+]+):", why)[1])


@pytest.mark.parametrize(
    ("name", "t_end", "accuracy"),
    [("henon-heiles:chaotic", 1000.0, 1e-4), ("henon-heiles:chaotic", 391.0, 1e-7), (SPHERE, 60.0, 1e-5)],
)
def test_refusal_names_the_longest_answerable_span(name, t_end, accuracy):
    """The question is answered up to that time and refused a fifth later: the distance of nearby orbits fluctuates."""
    until = advised_until(name, t_end, accuracy)
    assert 0 < until < t_end
    assert true_value(question(name, until, accuracy))[1] == ""
    assert "past its horizon" in true_value(question(name, 1.2 * until, accuracy))[1]


def test_energy_is_advised_beyond_the_orbits_horizon():
    found = advise(
        question("henon-heiles:chaotic", 500.0, 1e-6, quantity_name="energy"), portfolio_of=only("heyoka", "pefrl")
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
def test_invalid_question_raises(more, message):
    with pytest.raises(InvalidInput, match=message):
        question(**more)


# -- conserved properties --------------------------------------------------------------------------------------------


def test_declared_properties_select_the_candidates():
    assert "symplectic" in conservation_claims.refusal(integrator("rk4"), ["symplectic"])
    assert conservation_claims.refusal(integrator("stormer-verlet"), ["symplectic"]) is None
    assert conservation_claims.refusal(integrator("stormer-verlet"), ["energy"])
    assert "its package does not state" in conservation_claims.refusal(integrator("scipy-dop853"), ["symplectic"])
    members, dropped = portfolios.portfolio(question(conserve=("symplectic",)), 1e-5)
    ids = [i.id for i, _ in members]
    assert "pefrl" in ids
    assert "rk4" not in ids
    assert {"rk4", "heyoka-batch", "gautschi"} <= {d.integrator for d in dropped}


def test_conserved_properties_are_measured():
    asked = question("henon-heiles:box", conserve=("symplectic", "energy"))
    assert "energy" in conservation_claims.broken(integrator("stormer-verlet"), asked, {"steps": 100})
    asked = question("henon-heiles:box", conserve=("symplectic",))
    assert conservation_claims.broken(integrator("stormer-verlet"), asked, {"steps": 100}) is None
    assert "not symplectic" in conservation_claims.broken(integrator("rk4"), asked, {"steps": 20})
    asked = question("pendulum:rotating", conserve=("symplectic",))  # it starts at q = 0
    assert conservation_claims.broken(integrator("stormer-verlet"), asked, {"steps": 30}) is None
    assert "not symplectic" in conservation_claims.broken(integrator("rk4"), asked, {"steps": 30})
    # A step too wide for finite differences gives no verdict.
    assert conservation_claims.symplecticity_defect(integrator("stormer-verlet"), problem("kepler"), 6.0) == 0.0
    asked = question("kepler", conserve=("momentum",))
    assert "angular-momentum" in conservation_claims.broken(integrator("rk4"), asked, {"steps": 200})
    assert conservation_claims.broken(integrator("gauss-4"), asked, {"steps": 200}) is None


# -- the order in which candidates are tried -------------------------------------------------------------------------


def test_prior_is_built_from_trade_off_rows():
    row = {"scene": "pendulum-long", "status": "ok", "error": 1e-7}
    found = [row | {"id": "gauss-4", "seconds": 1.0}, row | {"id": "heyoka", "seconds": 3.0}]
    found += [row | {"id": id, "seconds": 0.1} for id in ("heyoka-batch", "no-name-of-the-registry")]
    found += [row | {"id": "pefrl", "seconds": 0.1, "status": "diverged"}]
    lines = {(x["problem"], x["decade"], x["integrator"]): x["factor"] for x in prior.build(*competition(found))}
    assert lines["pendulum", -7, "heyoka"] == 3.0
    assert {id for problem, _, id in lines if problem != prior.ANY} == {"gauss-4", "heyoka"}
    assert {"pefrl", "gauss-4"} <= {id for problem, _, id in lines if problem == prior.ANY}


def test_prior_factors_are_computed_from_rows():
    rows = pd.DataFrame(
        {
            "scene": ["a1", "a1", "a1", "b1", "c1", "c1", "c2"],
            "problem": ["a", "a", "a", "b", "c", "c", "c"],
            "id": ["x", "y", "x", "y", "x", "y", "x"],
            "error": [1e-7, 1e-5, 1e-4, 1e-9, 1e-9, 1e-9, 1e-9],
            "seconds": [4.0, 1.0, 0.5, 1.0, 4.0, 1.0, 9.0],
        }
    )
    lines = {(r["problem"], r["decade"], r["integrator"]): r["factor"] for r in prior.build(rows)}
    assert lines["a", -4, "x"] == 1.0
    assert lines["a", -4, "y"] == 2.0
    assert lines["a", -5, "x"] == 4.0
    assert ("a", -6, "y") not in lines
    assert lines["b", -9, "y"] == 1.0
    assert ("b", -10, "y") not in lines
    assert lines["c", -9, "x"] == 2.0  # 4 times the cheapest in one scene, the cheapest in the other
    assert lines["c", -9, "y"] == pytest.approx(prior.LARGEST**0.5, abs=0.01)  # absent in the other scene
    every = prior.build(rows, ["x", "dear"])
    assert [r["integrator"] for r in every if r["problem"] == prior.ANY] == ["dear", "x"]
    assert [r for r in every if r["problem"] != prior.ANY] == prior.build(rows)


def test_factors_of_an_unknown_problem_are_averages(monkeypatch):
    tables = {"a": {-6: {"x": 1.0, "y": 4.0}, -3: {"z": 2.0}}, "b": {-6: {"x": 4.0}}}
    monkeypatch.setattr(prior.TABLE, "load", lambda: prior.Prior(tables, frozenset("xyz")))
    assert prior.factors("a", 2e-6, ["x", "y", "z"]) == {"x": 1.0, "y": 4.0, "z": prior.LARGEST}
    assert prior.factors("new", 2e-6, ["x", "y", "z"]) == pytest.approx({"x": 2.0, "y": 4.0, "z": prior.LARGEST})
    assert prior.factors("a", 2e-6, ["nobody"]) == prior.factors("new", 2e-6, ["nobody"]) == {"nobody": prior.NEW}
    assert prior.factors("new", 1e-9, ["x"]) == {"x": prior.UNKNOWN}


def test_without_a_stored_prior_all_factors_are_unknown(monkeypatch, tmp_path):
    monkeypatch.setattr(prior.TABLE, "path", tmp_path / "none.csv")
    assert prior.factors("new", 1e-6, ["heyoka"]) == {"heyoka": prior.UNKNOWN}


def test_factors_of_new_and_of_slow_integrators():
    assert {"heyoka", "explicit-euler", "scheme-ii"} <= prior.TABLE.load().competitors
    assert prior.factors("new", 1e-6, ["explicit-euler", "nobody"]) == {
        "explicit-euler": prior.LARGEST,
        "nobody": prior.NEW,
    }


def test_stored_prior_names_registered_integrators():
    ids = {id for table in prior.TABLE.load().factors.values() for row in table.values() for id in row}
    assert len(ids) > 50
    assert all(integrator(id) for id in ids)


def test_hope_is_told_beside_each_side_by_itself(monkeypatch):
    """Whether a candidate is too expensive to try depends on the cheapest of its own side, our methods or the peers.

    A peer expected to cost 8 times our cheapest is tried; our own method at 7 times is dropped, as is a peer at ten
    times the cheapest peer.
    """
    tried = []
    search_ = Search(question(), None)
    monkeypatch.setattr(Ask, "spent", 0.0)

    def attempt(self, integrator):
        tried.append(integrator.id)
        self.found.append(SimpleNamespace(integrator=integrator))

    monkeypatch.setattr(Search, "attempt", attempt)
    hopes = {"rk4": 1.0, "scheme-v": 7.0, "rebound-whfast": 3.0, "rebound-leapfrog": 8.0, "rebound-ias15": 29.5}
    members = [(integrator("rebound-leapfrog-4"), 3.0), *((integrator(id), x) for id, x in hopes.items())]
    search_.try_all(members)
    assert tried == ["rebound-leapfrog-4", "rk4", "rebound-whfast", "rebound-leapfrog"]
    assert [d.integrator for d in search_.dropped] == ["scheme-v", "rebound-ias15"]


# -- in Python, and on the terminal ----------------------------------------------------------------------------------


@pytest.mark.usefixtures("few")
def test_advice_for_a_hamiltonian_of_the_user():
    system = pb.Hamiltonian(q="x", p="y", H="y**2/2 + x**4/4")
    found = pb.advise(system, t_end=3.0, accuracy=1e-3, q0=[1.0], p0=[-0.5], time_limit=PATIENT)
    table = found.to_frame()
    assert found.verified is table.attrs["verified"] is True
    assert found.choice.command == table["command"].iloc[0]
    assert found.choice.error <= found.accuracy == 1e-3
    assert found.plot().axes[0].get_xlabel() == "error of the end-state"
    assert table["role"].iloc[0] == "choice"
    command = table["command"].iloc[0]
    assert "--hamiltonian 'p**2/2 + q**4/4' --q 1.0 --p=-0.5" in command
    code, text, _ = call(*shlex.split(command)[1:], "--json")
    assert code == 0
    # To round-off: the command stores rows, at which a processed method takes its processor back.
    assert json.loads(text)["global_error"] == pytest.approx(table["error"].iloc[0], rel=1e-11)


def test_reference_is_confirmed_by_another_kind_of_method(monkeypatch):
    monkeypatch.setattr("phasebench.benchmarks.advice.advise.FINAL", PATIENT)
    asked = {"problem": "pendulum", "t_end": 10.0, "accuracy": 1e-5}
    found = advise(question(asked.pop("problem"), **asked), portfolio_of=only("heyoka"))
    assert found["verified"]
    assert found["reference"]["second"] == "scipy-dop853"


def test_unconfirmed_reference_is_not_verified(monkeypatch):
    monkeypatch.setattr("phasebench.benchmarks.advice.advise.FINAL", 0.0)
    assert not advise(question(), portfolio_of=only("heyoka"))["verified"]


def test_choice_that_misses_when_it_is_run_again_is_not_verified(monkeypatch):
    monkeypatch.setattr(Trial, "repeat", lambda trial, rung: 2e-5)
    found = advise(question(), portfolio_of=only("heyoka", "rk4"))
    assert (found["choice"]["error"], found["reference"]["confirmed"], found["verified"]) == (2e-5, True, False)


@pytest.mark.parametrize("keep", ["symplectic", "energy"])
def test_constraint_never_lowers_the_cost(monkeypatch, keep):
    """Cost counts gradient evaluations, so the test does not depend on timing."""

    def cost(task, c, size):
        return 1e-7 * task.run(c, size, bare=True).counts["gradient"]

    def by_cost(found):
        return sorted(found.found, key=lambda c: c.seconds)

    monkeypatch.setattr(Task, "seconds", cost)
    monkeypatch.setattr(Task, "beaten", lambda *given: False)
    monkeypatch.setattr("phasebench.benchmarks.advice.advise.finals", by_cost)
    asked = {"t_end": 20.0, "accuracy": 1e-6, "quantity_name": "energy"}
    ids = only("rk4", "scheme-v", "stormer-verlet", "kahan-li-8")
    free, bound = (advise(question(**asked, conserve=k), portfolio_of=ids)["choice"] for k in ((), (keep,)))
    assert free["seconds"] <= 1.05 * bound["seconds"]


def test_command_contains_the_parameters():
    assert words.problem_arguments(problem("kepler", e=0.2)) == ["kepler", "--set", "e=0.2"]
    assert words.problem_arguments(problem("kepler")) == ["kepler"]
    assert words.problem_arguments(problem("henon-heiles:box")) == ["henon-heiles:box"]


def test_energy_advice_reports_the_end_state_error():
    """Steps of half a radian preserve the energy by construction while the orbit is wrong."""
    asked = {"t_end": 1000.0, "accuracy": 1e-8, "quantity_name": "energy"}
    wide = advise(question("henon-heiles:box", **asked), portfolio_of=only("scheme-v"))
    assert wide["choice"]["error"] <= 1e-8
    assert wide["choice"]["end_state_error"] > 0.01
    assert "the end state is off by" in wide["notes"][0]
    fine = advise(question("henon-heiles:box", **asked), portfolio_of=only("heyoka"))
    assert fine["choice"]["end_state_error"] < 1e-6
    assert fine["notes"] == []


def test_state_advice_has_no_second_error(answer):
    assert answer["choice"]["end_state_error"] is None
    assert answer["notes"] == []


def test_note_on_a_denominator_that_may_be_a_distance():
    terms = " + ".join(f"(x - {k})**2/{k + 3}" for k in range(12))
    for H, told in ((f"y**2/2 + x**2/2 + 1/({terms} + 1)", 1), ("y**2/2 + x**2/2 + 1/(x**2 + 1)", 0)):
        made = with_start(pb.Hamiltonian(q="x", p="y", H=H), [1.0], [0.0])
        found = advise(ask(made, t_end=1.0, accuracy=1e-2), portfolio_of=only("heyoka", "rk4"))
        assert found["choice"] is not None
        assert len(found["notes"]) == told


def test_overlapping_times_are_ties():
    def one(low, high):
        task = Search(question(), Truth(np.ones(2), 0.0, "")).task()
        made = Candidate(Trial(integrator("rk4"), task, inf), Rung(1, None, OK, 0.0, low, 1))
        made.interval = (low, high)
        return made

    assert tied(one(1.0, 1.2), one(1.1, 1.3))
    assert not tied(one(1.0, 1.2), one(1.21, 1.3))
    unmeasured = one(1.0, 1.2)
    unmeasured.interval = None
    assert not tied(one(1.0, 1.2), unmeasured)


def test_terminal_output_of_an_answer():
    row = {"params": {}, "error": 1e-9, "uncertainty": 0.0, "command": "run", "remark": "", "end_state_error": None}
    rows = [row | {"integrator": id, "h": 0.1, "seconds": s} for id, s in (("a", 1.0), ("b", 3.0), ("c", 2.0))]
    answer = {"choice": rows[0], "own": rows[1], "peer": rows[0], "runner_up": rows[2], "alternatives": rows[1:]}
    answer |= {"next": None, "budget": None}
    rows[2]["tie"] = True
    shown = _roles(answer)
    assert [c["integrator"] for _, c in shown] == ["a", "c", "b"]
    assert shown[1][0] == "runner up, tie with the choice"
    asked = ("advise", "pendulum", "--t-end", "5", "--accuracy", "1e-3", "--time-limit", "1")
    text, every = (call(*asked, *more)[1] for more in ((), ("--why",)))
    assert "--why lists them all" in text
    fell = [line for line in every.splitlines() if line.startswith("  ")]
    assert len([line for line in fell if "heyoka-batch: it integrates many orbits" in line]) == 1
    assert len(fell) > 50


@pytest.fixture
def few(monkeypatch):
    """`advise` of the command and of the Python interface tries these integrators alone."""
    monkeypatch.setattr(advise, "__defaults__", ((), only("heyoka", "rk4")))


@pytest.mark.usefixtures("few")
def test_time_dependent_hamiltonian_gets_a_hint():
    asked = ("--hamiltonian", "p**2/2 - q*cos(t)", "--q", "1", "--p", "0", "--t-end", "1", "--accuracy", "1e-3")
    code, text, said = call("advise", *asked)
    assert code == 2
    assert "write q2 for t and add p2 to H" in text + said
    with pytest.raises(InvalidInput, match="write q2 for t"):
        pb.Hamiltonian(q="x", p="y", H="y**2/2 + x*cos(t)")
    driven = ("--hamiltonian", "p1**2/2 - q1*cos(q2) + p2", "--q", "1,0", "--p", "0,0", "--t-end", "1")
    assert call("advise", *driven, "--accuracy", "1e-3", "--time-limit", "60")[0] == 0


@pytest.mark.usefixtures("few")
def test_exit_code_of_the_command():
    code, text, _ = call("advise", "pendulum", "--t-end", "5", "--accuracy", "1e-3", "--time-limit", "60")
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
def test_invalid_arguments_exit_with_2(arguments, message):
    code, text, said = call("advise", *arguments)
    assert code == 2
    assert message in text + said


@pytest.mark.parametrize("limit", [2.0, 60.0])
def test_time_limit_is_kept(limit, monkeypatch):
    """A run that takes 20 s does not go on for longer than the limit; what was found by then is named as incomplete."""
    attempt = Search.attempt
    monkeypatch.setattr(
        Search, "attempt", lambda self, i: time.sleep(20) if i.id == "rk4" and limit < 20 else attempt(self, i)
    )
    began = time.perf_counter()
    asked = ask(problem("pendulum"), t_end=10.0, accuracy=1e-5, limit=limit, since=began)
    found = advise(asked, portfolio_of=only("heyoka", "rk4"))
    assert time.perf_counter() - began < limit + 1
    assert found["incomplete"] == (limit < 20)
    if limit < 20:
        assert found["choice"] is None or found["choice"]["integrator"] == "heyoka"
        assert "rk4" in found["notes"][0] if found["choice"] else True


def test_reference_that_takes_too_long_ends_the_search(monkeypatch):
    monkeypatch.setattr(truths, "truth", lambda *of: time.sleep(20))
    began = time.perf_counter()
    found = advise(ask(problem("pendulum"), t_end=10.0, accuracy=1e-5, limit=0.5, since=began))
    assert time.perf_counter() - began < 3
    assert (found["choice"], found["verified"], found["incomplete"]) == (None, False, True)
    assert "reference" in found["why"]


@pytest.mark.parametrize("quantity", ["end-state", "trajectory", "energy"])
def test_advice_back_in_time(quantity):
    """Of the pendulum it is that forward from the reversed momentum."""
    few = only("heyoka", "rk4", "scipy-dop853")
    made = [with_start(problem("pendulum"), [1.0], [p]) for p in (0.5, -0.5)]
    asked = [
        ask(m, t_end=t, accuracy=1e-6, limit=PATIENT, quantity_name=quantity)
        for m, t in zip(made, (-20.0, 20.0), strict=True)
    ]
    back, ahead = (advise(a, ("pendulum",), portfolio_of=few) for a in asked)
    assert (back["verified"], ahead["verified"]) == (True, True)
    assert back["own"]["steps"] == pytest.approx(ahead["own"]["steps"], rel=0.1)
    assert back["own"]["h"] < 0 < ahead["own"]["h"]
    assert "--t-end=-20.0" in back["choice"]["command"]
    assert back["lower_model"] is None
    for t in (0.0, float("nan"), float("inf")):
        with pytest.raises(InvalidInput, match="t_end"):
            ask(made[0], t_end=t, accuracy=1e-6)


def test_kinked_formula_is_advised():
    made = from_formula("p**2/2 + abs(q)**3/3", [1.0], [0.0], {})
    asked = ask(made, t_end=20.0, accuracy=1e-8, limit=PATIENT)
    found = advise(asked, portfolio_of=only("gauss-4", "scipy-dop853"))
    assert found["verified"]
    assert found["reference"]["uncertainty"] < 1e-13
    assert "heyoka" in [d.integrator for d in portfolios.portfolio(asked, 1e-8)[1] if "no function Abs" in d.why]
    energy = replace(asked, quantity=quantity(made, "energy"))
    assert advise(energy, portfolio_of=only("gauss-4", "scipy-dop853"))["verified"]
    true, _ = true_value(asked)
    assert true.values == pytest.approx([0.82600573, 0.53939985], abs=1e-8)


def test_search_without_time_says_so():
    nobody = advise(ask(problem("pendulum"), t_end=10.0, accuracy=1e-2, limit=1e-9))
    assert "no integrator was tried" in nobody["why"]
    assert "--time-limit" in nobody["why"]
