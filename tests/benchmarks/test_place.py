"""Rank of a user's step among stored Pareto fronts of cost and error: the fronts, evaluations, the printed line."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.certificate import fronts, place
from phasebench.benchmarks.certificate.battery import Entry
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.ladder.bracket import evaluations_for
from phasebench.benchmarks.problems import problem
from phasebench.integrators.registry import BY_ID as METHODS
from phasebench.reference.peers import BY_ID as PEERS
from support.steps import leapfrog


@pytest.mark.parametrize(
    ("runs", "wanted", "expected"),
    [
        ([(10, 1e-1), (100, 1e-3)], 1e-2, 10**1.5),
        ([(100, 1e-3), (10, 1e-1)], 1e-3, 100),
        ([(10, 1e-1), (100, 1e-3)], 1e-4, None),
        ([(10, 1e-3)], 1e-2, 10),
        ([(10, 1e-5), (20, 1e-1), (200, 1e-3)], 1e-2, 20 * 10**0.5),  # the first run is accurate by chance
        ([(10, 1e-5), (20, 1e-1)], 1e-2, None),
        ([(10, 1e-8), (20, 1e-11), (40, 2e-10), (80, 4e-10)], 1e-10, 10 * 2 ** (2 / 3)),  # later runs are at round-off
        ([(10, 1e-1), (20, float("inf")), (40, 1e-3)], 1e-2, 20),
        ([(10, 1e-1), (20, 0.0)], 1e-2, 10 * 2 ** (1 / 299)),
        ([(10, 1e-1), (20, 1e-11), (40, 1e-3), (80, 5e-9)], 1e-9, None),  # the second is right by chance
        ([], 1e-2, None),
    ],
)
def test_evaluations_needed_for_an_error(runs, wanted, expected):
    assert evaluations_for(runs, wanted) == (expected if expected is None else pytest.approx(expected))


def run_of(integrator, evaluations, error, scene="kepler-orbit", status="ok"):
    """A fabricated row of the trade-off between cost and error: one run of an integrator."""
    row = {"scene": scene, "integrator": integrator, "id": integrator.partition("(")[0]}
    return row | {"evaluations": evaluations, "error": error, "status": status}


def test_front_has_only_methods_that_evaluate_gradients():
    rows = [run_of("rk4", 100, 1e-2), run_of("rk4", 1000, 1e-6), run_of("stormer-verlet", 300, 1e-3)]
    others = [
        run_of("heyoka", 0, 1e-9),
        run_of("wisdom-holman", 2, 1e-9),
        run_of("pefrl", 3, 1e-9, status="diverged"),
        run_of("pefrl", 3, 1e-9, scene="nls"),
    ]
    lines = fronts.build([*rows, *others])
    assert [(x["error"], x["integrator"], x["evaluations"]) for x in lines] == [
        (1e-2, "rk4", 100),
        (1e-4, "rk4", 316),
        (1e-6, "rk4", 1000),
    ]
    assert fronts.build([*rows, run_of("pefrl", 50, 1e-4)])[1]["integrator"] == "pefrl"


def test_stored_fronts_cover_every_scene():
    assert list(fronts.TABLE.load()) == list(fronts.SCENES)
    for by in fronts.TABLE.load().values():
        assert tuple(by) == fronts.ERRORS
        counts = [best.evaluations for best in by.values()]
        assert counts == sorted(counts)
        assert {best.integrator.partition("(")[0] for best in by.values()} <= METHODS.keys() | PEERS.keys()


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
        ([1e-2, 1.0, 1.0], False),  # no error is small enough for a comparison
        ([0.5, 1.0, 1.0, 1.0], False),
        ([1.0, 1.0, 1e-3], False),
    ],
)
def test_ladder_ends_at_a_small_error_or_without_gain(errors, ended):
    assert (fronts.ERRORS[0], fronts.ERRORS[-1]) == (1e-2, 1e-10)
    runs = [place.Run(1, 1, e) for e in errors]
    assert bool(place.end_reason(runs, False)) == ended


def rank(monkeypatch, errors, adaptive=False, each=2):
    """The row that ranks an integrator, whose runs have these errors (None: failed), among the stored Pareto fronts.

    ``each``: gradient evaluations per step.
    """
    rungs = iter(errors)

    def measured(subject, entry, problem, t_end, size):
        error = next(rungs)
        return each * size, None if error is None else np.array([0.0, -error])

    monkeypatch.setattr(place.truths, "truth", lambda *a: SimpleNamespace(values=np.zeros(2)))
    monkeypatch.setattr(place, "run_subject", measured)
    return place.place(SimpleNamespace(adaptive=adaptive), "pendulum-short")


def test_steps_double_and_the_factor_is_over_the_front(monkeypatch):
    question = fronts.question("pendulum-short")
    first = round(question.t_end / (4 * question.build_problem().pace.step))
    row = rank(monkeypatch, [None, float("nan"), 1e-2, 1e-12])
    assert row["sizes"] == [4 * first, 8 * first]
    assert row["curve"] == [[8 * first, 1e-2], [16 * first, 1e-12]]
    best = fronts.TABLE.load()["pendulum-short"][1e-2]
    line = row["errors"][0]
    assert line["factor"] == pytest.approx(8 * first / best.evaluations)
    assert (line["cheapest"], line["its evaluations"]) == (best.integrator, best.evaluations)
    assert (row["on"], row["t_end"]) == ("pendulum-short", question.t_end)
    assert rank(monkeypatch, [0.5, 1e-3, 1.0, 1.0])["errors"][-1]["factor"] is None


@pytest.mark.parametrize("each", [1, 100])
def test_number_of_evaluations_is_limited(monkeypatch, each):
    """A run that would exceed the limit of steps or evaluations is not started."""
    sizes = rank(monkeypatch, [1.0] * 40, each=each)["sizes"]
    assert each * sizes[-1] <= place.MOST < 2 * each * sizes[-1]
    tried = rank(monkeypatch, [1.0] * 12, adaptive=True, each=1)["sizes"]
    assert tried == pytest.approx([10.0**-k for k in range(2, 14)])


@pytest.mark.parametrize(
    ("integrator", "adaptive", "run"),
    [(None, False, "own"), (None, True, "_tolerance"), ("a", False, "_run_registered"), ("a", True, "_run_registered")],
)
def test_runner_by_kind_of_integrator(monkeypatch, integrator, adaptive, run):
    for name in ("own", "_tolerance", "_run_registered"):
        monkeypatch.setattr(place, name, lambda *a, name=name: name)
    assert place.run_subject(SimpleNamespace(integrator=integrator, adaptive=adaptive), None, None, 1.0, 1) == run


def test_larger_count_of_the_two_gradients_is_used():
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


def wasteful(system, q, p, h):
    """Leapfrog with four gradients by q a step in place of two."""
    for _ in range(2):
        system.dH_dq(q, p)
    return leapfrog(system, q, p, h)


def test_wasted_evaluations_double_the_factor(monkeypatch):
    monkeypatch.setattr(place, "MOST", 4000)
    found = [place.place(subject(f, {}, ("separable",)), "pendulum-short") for f in (leapfrog, wasteful)]
    once, twice = ([e["factor"] for e in row["errors"]] for row in found)
    assert once[0] is not None
    assert once[-1] is None, "a leapfrog does not come to 1e-10 in so many"
    both = [(a, b) for a, b in zip(once, twice, strict=True) if a and b]
    assert len(both) >= 2
    assert all(b == pytest.approx(2 * a) for a, b in both)
    first, *_, last = found[0]["curve"]
    ours = place.place(subject("stormer-verlet"), "pendulum-short")
    assert ours["curve"][0] == [first[0] / 2 + 1, pytest.approx(first[1])], "it keeps the last gradient of a step"
    assert first[1] > 1e3 * last[1]


def test_adaptive_integrator_is_ranked_too():
    def run(system, q, p, t_end, tol):
        steps = round(t_end * tol**-0.5)
        for _ in range(steps):
            q, p = leapfrog(system, q, p, t_end / steps)
        return q, p

    row = place.place(subject(run, {}, ("separable",)), "pendulum-short")
    assert row["curve"][0][0] == 2 * 10 * 10
    assert [e["factor"] is None for e in row["errors"]] == [False, False, False, True, True]


def test_scenes_suit_the_integrator():
    assert place.scenes(subject(leapfrog)) == ["kepler-orbit", "double-pendulum-chaotic"]
    assert place.scenes(subject(leapfrog, {}, ("separable",))) == ["kepler-orbit", "pendulum-short"]
    assert place.scenes(subject(leapfrog, {}, ("polynomial degree",))) == ["henon-heiles-chaotic"]
    assert place.scenes(subject("wisdom-holman")) == []
