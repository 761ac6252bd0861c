"""`advise`: the search finds the widest sufficient step, candidates are run, and unanswerable questions are refused."""

from __future__ import annotations

import json
import re
import shlex
import time
from math import inf

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.advice import portfolio as portfolios
from phasebench.benchmarks.advice import prior, words
from phasebench.benchmarks.advice import table as tables
from phasebench.benchmarks.advice.advise import advise, tied
from phasebench.benchmarks.advice.ask import ask
from phasebench.benchmarks.advice.hunt import Candidate, Search
from phasebench.benchmarks.advice.known import true_value
from phasebench.benchmarks.cli.advise import _roles
from phasebench.benchmarks.ladder import search
from phasebench.benchmarks.ladder.rung import Rung, Task
from phasebench.benchmarks.ladder.trial import REMARK, Trial
from phasebench.benchmarks.measure import conservation_claims, truths
from phasebench.benchmarks.measure.global_error import with_start
from phasebench.benchmarks.measure.integrator import OURS, integrator
from phasebench.benchmarks.measure.quantities import Truth
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import DIVERGED, OK, TIMEOUT
from support.commands import call
from support.portfolios import only

#: Seconds of a search that is to try every member of its portfolio, however slow the machine.
PATIENT = 120.0


def question(name="pendulum", t_end=10.0, accuracy=1e-5, limit=PATIENT, **more):
    return ask(problem(name), t_end=t_end, accuracy=accuracy, limit=limit, **more)


def hunt(asked) -> Search:
    return Search(asked, Truth(np.ones(2), 0.0, "a law"))


# -- the search on known laws of error and time ----------------------------------------------------------------------


def trial(law, id="rk4", uncertainty=0.0) -> Trial:
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

    asked = question()
    task = Law(asked.problem, asked.t_end, asked.quantity, Truth(np.ones(2), uncertainty, "a law"))
    return Trial(integrator(id), task, inf)


def power(order, scale=20.0, floor=0.0, ceiling=inf, price=1e-6):
    """The law of an error (scale / n)^order, at least the floor and at most the ceiling; a step costs the price."""
    return lambda n: (max(min(ceiling, (scale / n) ** order), floor), price * n)


#: (law, accuracy, first size, cost of the cheapest, least and most steps found or None, most runs).
SEARCHES = {
    "order 2": (power(2), 1e-6, 3, inf, (20_000, 22_001), inf),
    "order 8": (power(8), 1e-6, 40_000, inf, (112, 125), inf),
    "too many steps": (power(1), 1e-6, 100, inf, None, inf),
    "dear wide steps": (lambda n: power(6, price=4e-5 if n < 1000 else 1e-6)(n), 1e-6, 1500, inf, (1500, 1500), inf),
    "wide steps diverge": (lambda n: None if n < 500 else power(4)(n), 1e-3, 8, inf, (500, 560), inf),
    "all diverge": (lambda n: None, 1e-3, 8, inf, None, search.FAILURES),
    "an error floor": (power(4, floor=3e-9), 1e-10, 100, inf, None, inf),
    "cannot win": (power(2), 1e-9, 1000, 1e-4, None, 3),
    "fine steps time out": (lambda n: TIMEOUT if n > 900 else power(4)(n), 1e-6, 2000, inf, (640, 900), inf),
    "all that meet it time out": (lambda n: TIMEOUT if n > 500 else power(4)(n), 1e-6, 100, inf, None, inf),
    "errors as large as the quantity": (power(8, 400, ceiling=1.0), 1e-6, 10, 2e-3, (2249, inf), inf),
    "errors above the asymptotic range": (power(8, 40, ceiling=1e-4), 1e-7, 10, 1e-4, (300, inf), inf),
}


@pytest.mark.parametrize("name", SEARCHES)
def test_search_on_a_known_law(name):
    law, accuracy, start, cheapest, steps, runs = SEARCHES[name]
    made = trial(law)
    found = search.search(made, accuracy, start, cheapest=cheapest)
    assert (found.rung is None) is (steps is None)
    assert steps is None or steps[0] <= found.rung.steps <= steps[1]
    assert steps is not None or found.why
    assert len(made.rungs) <= runs


def test_uncertainty_tolerances_and_budgets():
    assert search.search(trial(power(4), uncertainty=5e-7), 1e-6, 100).rung.error <= 5e-7
    found = search.search(trial(lambda tol: (10 * tol, 1e-3 * tol**-0.1), id="heyoka"), 1e-6, 1e-9)
    assert 2.5e-8 <= found.rung.tol <= 1e-7
    assert 7000 <= search.best_within(trial(power(4)), 0.01, 100).rung.steps <= 10_000
    assert search.best_within(trial(lambda n: (1.0, 1.0)), 0.01, 100).rung is None


# -- exact methods --------------------------------------------------------------------------------------------------


def test_exact_methods_are_tried_first_with_one_step():
    members, _ = portfolios.portfolio(question("kepler"), 1e-5)
    first, *tried = [i.id for i, _ in members]
    assert first == portfolios.FIRST
    assert set(tried[:2]) == {"wisdom-holman", "rebound-whfast"}
    assert {i.id for i, expected in members if expected == 0.0} >= {"wisdom-holman-saba-2", "rebound-saba-1"}
    for inexact in ("perturbed-kepler", "pendulum"):
        assert all(expected > 0.0 for _, expected in portfolios.portfolio(question(inexact), 1e-5)[0])
    made = hunt(question("kepler"))
    exact, other = (Trial(integrator(id), made.task(), inf) for id in ("rebound-whfast-plain", "stormer-verlet"))
    assert made.start(exact, 1e-5) == 1.0 < made.start(other, 1e-5)
    law = trial(lambda n: (1e-12, 1e-6 * n))
    assert (search.search(law, 1e-6, 1.0).rung.steps, len(law.rungs)) == (1, 1)
    # A problem of one's own may have a known one's name.
    said = [Candidate(exact, Rung(n, None, OK, 1e-9, 1.0, n)).row(made.ask, None)["remark"] for n in (1, 2)]
    assert said == [REMARK, ""]


# -- an answer -----------------------------------------------------------------------------------------------------

FEW = ("heyoka", "stormer-verlet", "blanes-moan-srkn11b", "rk4", "rebound-leapfrog-8")


@pytest.fixture(scope="module")
def answer():
    return advise(question(), portfolio_of=only(*FEW))


def test_choice_was_run_and_is_the_cheapest(answer):
    assert (answer["verified"], answer["why"], answer["notes"], answer["incomplete"]) == (True, "", [], False)
    candidates = [answer["choice"], *answer["alternatives"]]
    assert all(c["error"] + c["uncertainty"] <= 1e-5 for c in candidates)
    assert answer["choice"]["seconds"] == min(c["seconds"] for c in candidates)
    assert integrator(answer["own"]["integrator"]).kind == OURS != integrator(answer["peer"]["integrator"]).kind
    assert answer["next"]["error"] <= answer["next"]["accuracy"] == pytest.approx(1e-6)
    assert {"integrator", "params", "model", "command", "error", "uncertainty", "seconds"} <= set(answer["choice"])
    assert answer["choice"]["end_state_error"] is None, "it is the error itself"


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
    right = truths.truth
    moved = lambda *of: right(*of)._replace(values=right(*of).values + 1e-3)  # noqa: E731
    monkeypatch.setattr(truths, "truth", moved)
    found = advise(question(), portfolio_of=only("heyoka", "rk4"))
    assert (found["choice"], found["verified"]) == (None, False)


@pytest.mark.parametrize(
    ("name", "t_end", "accuracy", "why"),
    [
        ("pendulum", 10.0, 1e-17, "the reference itself is known to"),
        ("pendulum", 10.0, 5.0, "anything meets it"),
        ("pendulum", 1000.0, 3e-15, "nothing that was tried meets"),
    ],
)
def test_unanswerable_question_is_refused(name, t_end, accuracy, why):
    found = advise(question(name, t_end, accuracy), portfolio_of=only("heyoka", "rk4"))
    assert (found["choice"], found["verified"]) == (None, False)
    assert why in found["why"]


@pytest.mark.parametrize(
    ("name", "t_end", "accuracy"), [("henon-heiles:chaotic", 1000.0, 1e-4), ("schwarzschild:photon-sphere", 60.0, 1e-5)]
)
def test_refusal_names_the_longest_answerable_span(name, t_end, accuracy):
    """The question is answered up to that time and refused a fifth later: the distance of nearby orbits fluctuates."""
    true, why = true_value(question(name, t_end, accuracy))
    assert true is not None
    until = float(re.search(r"known to t = ([0-9.e+]+):", why)[1])
    assert 0 < until < t_end
    assert true_value(question(name, until, accuracy))[1] == ""
    assert "past its horizon" in true_value(question(name, 1.2 * until, accuracy))[1]


def test_energy_advice_reports_the_end_state_error():
    """Steps of half a radian preserve the energy by construction while the orbit is wrong."""
    asked = question("henon-heiles:box", 1000.0, 1e-8, quantity_name="energy")
    wide, fine = (advise(asked, portfolio_of=only(id)) for id in ("scheme-v", "heyoka"))
    assert wide["choice"]["error"] <= 1e-8 < 0.01 < wide["choice"]["end_state_error"]
    assert fine["choice"]["end_state_error"] < 1e-6
    ends = [
        pb.integrate("henon-heiles:box", id, t_end=1000.0, save_every=0, **size)
        for id, size in (("scheme-v", {"steps": wide["choice"]["steps"]}), ("heyoka", {}))
    ]
    apart = max(np.abs(getattr(ends[0], x)[-1] - getattr(ends[1], x)[-1]).max() for x in "qp")
    assert wide["choice"]["end_state_error"] == pytest.approx(apart, rel=1e-6)
    assert [len(found["notes"]) for found in (wide, fine)] == [1, 0]


# -- conserved properties --------------------------------------------------------------------------------------------


def test_declared_properties_select_the_candidates():
    for id, kept, refused in (
        ("rk4", "symplectic", True),
        ("stormer-verlet", "symplectic", False),
        ("stormer-verlet", "energy", True),
        ("scipy-dop853", "symplectic", True),
    ):
        assert (conservation_claims.refusal(integrator(id), [kept]) is not None) is refused
    members, dropped = portfolios.portfolio(question(conserve=("symplectic",)), 1e-5)
    ids = {i.id for i, _ in members}
    assert ("pefrl" in ids, "rk4" in ids) == (True, False)
    assert {"rk4", "heyoka-batch", "gautschi"} <= {d.integrator for d in dropped}


@pytest.mark.parametrize(
    ("name", "kept", "id", "steps", "broken"),
    [
        ("henon-heiles:box", ("symplectic", "energy"), "stormer-verlet", 100, "energy"),
        ("pendulum:rotating", ("symplectic",), "stormer-verlet", 30, None),  # it starts at q = 0
        ("pendulum:rotating", ("symplectic",), "rk4", 30, "not symplectic"),
        ("kepler", ("momentum",), "rk4", 200, "angular-momentum"),
        ("kepler", ("momentum",), "gauss-4", 200, None),
    ],
)
def test_conserved_properties_are_measured(name, kept, id, steps, broken):
    found = conservation_claims.broken(integrator(id), question(name, conserve=kept), {"steps": steps})
    assert found is None if broken is None else broken in found


# -- the order in which candidates are tried -------------------------------------------------------------------------


def test_factors_of_known_and_unknown_problems(monkeypatch, tmp_path):
    tables = {"a": {-6: {"x": 1.0, "y": 4.0}, -3: {"z": 2.0}}, "b": {-6: {"x": 4.0}}}
    with monkeypatch.context() as patch:
        patch.setattr(prior.TABLE, "load", lambda: prior.Prior(tables, frozenset("xyz")))
        assert prior.factors("a", 2e-6, ["x", "y", "z", "n"]) == {
            "x": 1.0,
            "y": 4.0,
            "z": prior.LARGEST,
            "n": prior.NEW,
        }
        assert prior.factors("new", 2e-6, ["x", "y", "z"]) == pytest.approx({"x": 2.0, "y": 4.0, "z": prior.LARGEST})
        assert prior.factors("new", 1e-9, ["x"]) == {"x": prior.UNKNOWN}
    monkeypatch.setattr(prior.TABLE, "path", tmp_path / "none.csv")
    assert prior.factors("new", 1e-6, ["heyoka"]) == {"heyoka": prior.UNKNOWN}


# -- is it verified, is it complete -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("final", "verified"), [(PATIENT, True), (0.0, False)])
def test_reference_is_confirmed_by_another_kind_of_method(monkeypatch, final, verified):
    monkeypatch.setattr("phasebench.benchmarks.advice.advise.FINAL", final)
    found = advise(question(), portfolio_of=only("heyoka"))
    assert found["verified"] is verified
    assert not verified or found["reference"]["second"] == "scipy-dop853"


def test_choice_that_misses_when_it_is_run_again_is_not_verified(monkeypatch):
    monkeypatch.setattr(Trial, "repeat", lambda trial, rung: 2e-5)
    found = advise(question(), portfolio_of=only("heyoka", "rk4"))
    assert (found["choice"]["error"], found["reference"]["confirmed"], found["verified"]) == (2e-5, True, False)


@pytest.mark.parametrize("late", ["attempt", "truth"])
def test_time_limit_is_kept(late, monkeypatch):
    """What does not end in time is given up; what was found by then is named as incomplete."""
    attempt = Search.attempt
    if late == "truth":
        monkeypatch.setattr(truths, "truth", lambda *of: time.sleep(20))
    else:
        monkeypatch.setattr(Search, "attempt", lambda self, i: time.sleep(20) if i.id == "rk4" else attempt(self, i))
    began = time.perf_counter()
    found = advise(question(limit=0.5, since=began), portfolio_of=only("heyoka", "rk4"))
    assert time.perf_counter() - began < 10
    assert found["incomplete"]
    assert found["choice"] is None or (late, found["choice"]["integrator"]) == ("attempt", "heyoka")
    assert late != "truth" or not found["verified"]


def test_without_time_nothing_is_tried():
    assert "no integrator was tried" in advise(question(accuracy=1e-2, limit=1e-9))["why"]


def test_advice_back_in_time():
    """Of the pendulum it is that forward from the reversed momentum."""
    few = only("heyoka", "rk4", "scipy-dop853")
    made = [with_start(problem("pendulum"), [1.0], [p]) for p in (0.5, -0.5)]
    more = {"accuracy": 1e-6, "limit": PATIENT}
    asked = [ask(m, t_end=t, **more) for m, t in zip(made, (-20.0, 20.0), strict=True)]
    back, ahead = (advise(a, ("pendulum",), portfolio_of=few) for a in asked)
    assert (back["verified"], ahead["verified"]) == (True, True)
    assert back["own"]["steps"] == pytest.approx(ahead["own"]["steps"], rel=0.1)
    assert back["own"]["h"] < 0 < ahead["own"]["h"]
    assert "--t-end=-20.0" in back["choice"]["command"]


# -- in Python, and on the terminal ----------------------------------------------------------------------------------


@pytest.fixture
def few(monkeypatch):
    """`advise` of the command and of the Python interface tries these integrators alone."""
    monkeypatch.setattr(advise, "__defaults__", ((), only("heyoka", "rk4")))


@pytest.mark.usefixtures("few")
def test_advice_for_a_hamiltonian_of_the_user():
    system = pb.Hamiltonian(q="x", p="y", H="y**2/2 + x**4/4")
    found = pb.advise(system, t_end=3.0, accuracy=1e-3, q0=[1.0], p0=[-0.5], time_limit=PATIENT)
    frame = found.to_frame()
    assert found.verified is frame.attrs["verified"] is True
    assert found.choice.error <= found.accuracy == 1e-3
    (axes,) = found.plot().axes
    assert axes.get_xlabel() == "error of the end-state"
    drawn = next(line for line in axes.lines if line.get_label().startswith("choice"))
    assert (*drawn.get_xdata(), *drawn.get_ydata()) == (found.choice.error, found.choice.seconds)
    assert frame["role"].tolist() == [role for role in tables.ROLES if found.answer[role] is not None]
    assert {"choice", "own", "peer", "next"} <= {*frame["role"]}
    assert found.choice.command == frame["command"].iloc[0]
    assert "--hamiltonian 'p**2/2 + q**4/4' --q 1.0 --p=-0.5" in found.choice.command


@pytest.mark.usefixtures("few")
def test_exit_code_of_the_command():
    code, text, _ = call("advise", "pendulum", "--t-end", "5", "--accuracy", "1e-3", "--time-limit", "60")
    assert code == 0
    assert text.strip().splitlines()[-1].startswith("phasebench integrate pendulum")
    code, text, _ = call("advise", "pendulum", "--t-end", "5", "--accuracy", "1e-17", "--json")
    found = json.loads(text)
    assert (code, found["choice"]) == (1, None)
    assert found["why"]


def test_roles_ties_and_all_that_fell_out():
    row = {"params": {}, "error": 1e-9, "uncertainty": 0.0, "command": "run", "remark": "", "end_state_error": None}
    rows = [row | {"integrator": id, "h": 0.1, "seconds": s} for id, s in (("a", 1.0), ("b", 3.0), ("c", 2.0))]
    rows[2]["tie"] = True
    found = {"choice": rows[0], "own": rows[1], "peer": rows[0], "runner_up": rows[2], "alternatives": rows[1:]}
    shown = _roles(found | {"next": None, "budget": None})
    assert [c["integrator"] for _, c in shown] == ["a", "c", "b"]
    assert shown[1][0] == "runner up, tie with the choice"

    def candidate(interval):
        made = Candidate(Trial(integrator("rk4"), hunt(question()).task(), inf), Rung(1, None, OK, 0.0, 1.0, 1))
        made.interval = interval
        return made

    others = {(1.1, 1.3): True, (1.21, 1.3): False, None: False}
    assert {k: tied(candidate((1.0, 1.2)), candidate(k)) for k in others} == others
    assert words.problem_arguments(problem("kepler", e=0.2)) == ["kepler", "--set", "e=0.2"]
    asked = ("advise", "pendulum", "--t-end", "5", "--accuracy", "1e-3", "--time-limit", "1")
    text, every = (call(*asked, *more)[1] for more in ((), ("--why",)))
    assert "--why lists them all" in text
    fell = [line for line in every.splitlines() if line.startswith("  ")]
    assert len([line for line in fell if "heyoka-batch: it integrates many orbits" in line]) == 1
    assert len(fell) > 50
