"""The place on fronts of the trade: what is stored, what a step needs, and what is said of it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.certificate import fronts, place
from phasebench.benchmarks.certificate.battery import Entry
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.certificate.verdicts import Tables
from phasebench.benchmarks.problems import problem
from phasebench.integrators.registry import BY_ID as METHODS
from phasebench.reference.peers import BY_ID as PEERS


@pytest.mark.parametrize(
    ("runs", "wanted", "expected"),
    [
        ([(10, 1e-1), (100, 1e-3)], 1e-2, 10**1.5),
        ([(100, 1e-3), (10, 1e-1)], 1e-3, 100),
        ([(10, 1e-1), (100, 1e-3)], 1e-4, None),
        ([(10, 1e-3)], 1e-2, 10),
        ([(10, 1e-5), (20, 1e-1), (200, 1e-3)], 1e-2, 20 * 10**0.5),  # the first was lucky
        ([(10, 1e-5), (20, 1e-1)], 1e-2, None),
        ([(10, 1e-8), (20, 1e-11), (40, 2e-10), (80, 4e-10)], 1e-10, 10 * 2 ** (2 / 3)),  # then round-off
        ([(10, 1e-1), (20, float("inf")), (40, 1e-3)], 1e-2, 20),
        ([(10, 1e-1), (20, 0.0)], 1e-2, 10 * 2 ** (1 / 299)),
        ([], 1e-2, None),
    ],
)
def test_the_evaluations_that_an_error_needs(runs, wanted, expected):
    assert fronts.needed(runs, wanted) == (expected if expected is None else pytest.approx(expected))


def run_of(integrator, evaluations, error, scene="kepler-orbit", status="ok"):
    row = {"scene": scene, "integrator": integrator, "id": integrator.partition("(")[0]}
    return row | {"evaluations": evaluations, "error": error, "status": status}


def test_a_front_is_of_those_whose_work_is_evaluations_of_the_gradient():
    rows = [run_of("rk4", 100, 1e-2), run_of("rk4", 1000, 1e-6), run_of("stormer-verlet", 300, 1e-3)]
    others = [
        run_of("heyoka", 0, 1e-9),
        run_of("wisdom-holman", 2, 1e-9),
        run_of("pefrl", 3, 1e-9, status="diverged"),
        run_of("pefrl", 3, 1e-9, scene="nls"),
    ]
    lines = fronts.made([*rows, *others])
    assert [(x["error"], x["integrator"], x["evaluations"]) for x in lines] == [
        (1e-2, "rk4", 100),
        (1e-4, "rk4", 316),
        (1e-6, "rk4", 1000),
    ]
    assert fronts.made([*rows, run_of("pefrl", 50, 1e-4)])[1]["integrator"] == "pefrl"


def test_what_is_stored_is_of_every_scene_and_rises_as_the_error_falls():
    assert list(fronts.stored()) == list(fronts.SCENES)
    for by in fronts.stored().values():
        assert tuple(by) == fronts.ERRORS
        counts = [best.evaluations for best in by.values()]
        assert counts == sorted(counts)
        assert {best.integrator.partition("(")[0] for best in by.values()} <= METHODS.keys() | PEERS.keys()


def test_kept_is_what_was_made(tmp_path, monkeypatch):
    before = fronts.stored()
    lines = [{"scene": s, "error": e, **b._asdict()} for s, by in before.items() for e, b in by.items()]
    monkeypatch.setattr(fronts, "PATH", tmp_path / "fronts.csv")
    fronts.keep(lines)
    assert fronts.stored() == before
    fronts.stored.cache_clear()


@pytest.mark.parametrize(
    ("errors", "ended"),
    [
        ([0.5], False),
        ([1e-11], True),
        ([1e-10], True),
        ([1e-11, 1.0], False),
        ([1e-3, 1.0], False),
        ([1e-3, 1.0, 1.0], True),
        ([1.0, 1e-3, 1.0, 1.0], True),
        ([1e-2, 1.0, 1.0], False),  # none was small enough to be compared
        ([0.5, 1.0, 1.0, 1.0], False),
        ([1.0, 1.0, 1e-3], False),
    ],
)
def test_a_ladder_ends_at_the_smallest_error_or_where_rungs_bring_nothing(errors, ended):
    assert (fronts.ERRORS[0], fronts.ERRORS[-1]) == (1e-2, 1e-10)
    assert place._ended([(1, e) for e in errors]) == ended


def climbed(monkeypatch, errors, adaptive=False, each=2):
    """The place of an integrator that takes so many evaluations a step, and has these errors; None where it stops."""
    rungs = iter(errors)

    def measured(subject, entry, problem, t_end, size):
        error = next(rungs)
        return each * size, None if error is None else np.array([0.0, -error])

    monkeypatch.setattr(place.truths, "truth", lambda *a: SimpleNamespace(values=np.zeros(2)))
    monkeypatch.setattr(place, "measured", measured)
    return place.place(SimpleNamespace(adaptive=adaptive), "pendulum-short")


def test_a_ladder_is_of_doubled_steps_and_its_factor_is_over_the_cheapest(monkeypatch):
    question = fronts.question("pendulum-short")
    first = round(question.t_end / (4 * question.made().pace.step))
    row = climbed(monkeypatch, [None, float("nan"), 1e-2, 1e-12])
    assert row["sizes"] == [4 * first, 8 * first]
    assert row["curve"] == [[8 * first, 1e-2], [16 * first, 1e-12]]
    best = fronts.stored()["pendulum-short"][1e-2]
    line = row["errors"][0]
    assert line["factor"] == pytest.approx(8 * first / best.evaluations)
    assert (line["cheapest"], line["its evaluations"]) == (best.integrator, best.evaluations)
    assert (row["on"], row["t_end"]) == ("pendulum-short", question.t_end)
    assert climbed(monkeypatch, [0.5, 1e-3, 1.0, 1.0])["errors"][-1]["factor"] is None


@pytest.mark.parametrize("each", [1, 100])
def test_no_run_takes_more_evaluations_than_the_most(monkeypatch, each):
    """None is begun of which the steps or the evaluations would be more."""
    sizes = climbed(monkeypatch, [1.0] * 40, each=each)["sizes"]
    assert each * sizes[-1] <= place.MOST < 2 * each * sizes[-1]
    tried = climbed(monkeypatch, [1.0] * 12, adaptive=True, each=1)["sizes"]
    assert tried == pytest.approx([10.0**-k for k in range(2, 14)])


@pytest.mark.parametrize(
    ("integrator", "adaptive", "run"),
    [(None, False, "own"), (None, True, "_tolerance"), ("a", False, "_registered"), ("a", True, "_registered")],
)
def test_who_runs_it(monkeypatch, integrator, adaptive, run):
    for name in ("own", "_tolerance", "_registered"):
        monkeypatch.setattr(place, name, lambda *a, name=name: name)
    assert place.measured(SimpleNamespace(integrator=integrator, adaptive=adaptive), None, None, 1.0, 1) == run


def test_evaluations_are_of_the_gradient_that_is_asked_for_more_often():
    made = problem("harmonic-oscillator")
    entry = Entry("here", made.system, (1.0, 0.0))
    evaluations, end = place.own(subject(leapfrog, {}, ("separable",)), entry, None, 1.0, 100)
    assert evaluations == 200
    assert end == pytest.approx([np.cos(1), -np.sin(1)], abs=1e-5)

    def run(system, q, p, t_end, tol):
        return leapfrog(system, q, p, t_end)

    evaluations, end = place._tolerance(subject(run, {}, ("separable",)), entry, None, 0.01, 1e-3)
    assert evaluations == 2
    assert end == pytest.approx([np.cos(0.01), -np.sin(0.01)], abs=1e-6)


def leapfrog(system, q, p, h, wasted=0):
    for _ in range(wasted):
        system.dH_dq(q, p)
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    return q, p - h / 2 * system.dH_dq(q, p)


def wasteful(system, q, p, h):
    return leapfrog(system, q, p, h, wasted=2)


def test_a_step_takes_the_evaluations_that_it_asks_for(monkeypatch):
    monkeypatch.setattr(place, "MOST", 4000)
    found = [place.place(subject(f, {}, ("separable",)), "pendulum-short") for f in (leapfrog, wasteful)]
    once, twice = ([e["factor"] for e in row["errors"]] for row in found)
    assert once[0] is not None
    assert once[-1] is None, "a leapfrog does not come to 1e-10 in so many"
    assert all(b == pytest.approx(2 * a) for a, b in zip(once, twice, strict=True) if a and b)
    first, *_, last = found[0]["curve"]
    ours = place.place(subject("stormer-verlet"), "pendulum-short")
    assert ours["curve"][0] == [first[0] / 2 + 1, pytest.approx(first[1])], "it keeps the last gradient of a step"
    assert first[1] > 1e3 * last[1]


def test_an_adaptive_integrator_has_a_place_too():
    def run(system, q, p, t_end, tol):
        steps = round(t_end * tol**-0.5)
        for _ in range(steps):
            q, p = leapfrog(system, q, p, t_end / steps)
        return q, p

    row = place.place(subject(run, {}, ("separable",)), "pendulum-short")
    assert row["curve"][0][0] == 2 * 10 * 10
    assert [e["factor"] is None for e in row["errors"]] == [False, False, False, True, True]


def test_two_scenes_that_it_can_do():
    assert place.scenes(subject(leapfrog)) == ["kepler-orbit", "double-pendulum-chaotic"]
    assert place.scenes(subject(leapfrog, {}, ("separable",))) == ["kepler-orbit", "pendulum-short"]
    assert place.scenes(subject(leapfrog, {}, ("polynomial degree",))) == ["henon-heiles-chaotic"]
    assert place.scenes(subject("wisdom-holman")) == []


def test_what_is_said_of_a_place():
    def said(*factors):
        errors = [{"error": 10.0 ** (-2 * k), "factor": f} for k, f in enumerate(factors, 1)]
        (line,) = place.placed(Tables({"place": [{"on": "kepler-orbit", "errors": errors}]}))
        return line.removeprefix("evaluations on kepler-orbit: ")

    assert said(None, None) == "none of the errors that are compared is met, from 1e-02 on"
    assert said(2.0, 31.4) == "2 times the fewest stored for an error of 1e-02, 31 times for an error of 1e-04"
    assert said(2.0, None).endswith("2 times the fewest stored for an error of 1e-02; smaller errors are not met")
    assert place.placed(Tables({})) == []
