"""Rank of a user's step among stored Pareto fronts of cost and error, and its time beside the fastest stored one."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.certificate import fronts, place, render, times
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.judge.evidence import Tables
from phasebench.benchmarks.ladder.bracket import evaluations_for
from phasebench.benchmarks.measure import timing
from support.steps import leapfrog


@pytest.mark.parametrize(
    ("runs", "wanted", "expected"),
    [
        ([(10, 1e-1), (100, 1e-3)], 1e-2, 10**1.5),
        ([(100, 1e-3), (10, 1e-1)], 1e-4, None),
        ([(10, 1e-3)], 1e-2, 10),
        ([(10, 1e-5), (20, 1e-1), (200, 1e-3)], 1e-2, 20 * 10**0.5),  # the first run is accurate by chance
        ([(10, 1e-8), (20, 1e-11), (40, 2e-10), (80, 4e-10)], 1e-10, 10 * 2 ** (2 / 3)),  # later runs are at round-off
        ([(10, 1e-1), (20, float("inf")), (40, 1e-3)], 1e-2, 20),
        ([(10, 1e-1), (20, 0.0)], 1e-2, 10 * 2 ** (1 / 299)),
        ([(10, 1e-1), (20, 1e-11), (40, 1e-3), (80, 5e-9)], 1e-9, None),  # the second is right by chance
        ([], 1e-2, None),
    ],
)
def test_evaluations_needed_for_an_error(runs, wanted, expected):
    assert evaluations_for(runs, wanted) == (expected if expected is None else pytest.approx(expected))


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
    question, made, _ = place.scene_parts("pendulum-short")
    first = round(question.t_end / (4 * made.pace.step))
    row = rank(monkeypatch, [None, float("nan"), 1e-2, 1e-12])
    assert row["sizes"] == [4 * first, 8 * first]
    assert row["curve"] == [[8 * first, 1e-2], [16 * first, 1e-12]]
    best = fronts.TABLE.load()["pendulum-short"][1e-2]
    line = row["errors"][0]
    assert line["factor"] == pytest.approx(8 * first / best.evaluations)
    assert (line["cheapest"], line["its evaluations"]) == (best.integrator, best.evaluations)
    assert (row["on"], row["t_end"]) == ("pendulum-short", question.t_end)
    assert rank(monkeypatch, [0.5, 1e-3, 1.0, 1.0])["errors"][-1]["factor"] is None
    shown = render._place(SimpleNamespace(tables=Tables({"place": [row]})))
    assert shown["times as many"][0] == f"{line['factor']:.2g}"


def test_adaptive_integrator_is_ranked_too():
    def run(system, q, p, t_end, tol):
        steps = round(t_end * tol**-0.5)
        for _ in range(steps):
            q, p = leapfrog(system, q, p, t_end / steps)
        return q, p

    row = place.place(subject(run, {}, ("separable",)), "pendulum-short")
    assert row["curve"][0][0] == 2 * 10 * 10
    assert [e["factor"] is None for e in row["errors"]] == [False, False, False, True, True]


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
    first = found[0]["curve"][0]
    ours = place.place(subject("stormer-verlet"), "pendulum-short")
    assert ours["curve"][0] == [first[0] / 2 + 1, pytest.approx(first[1])], "it keeps the last gradient of a step"


def test_scenes_suit_the_integrator():
    assert place.scenes(subject(leapfrog)) == ["kepler-orbit", "double-pendulum-chaotic"]
    assert place.scenes(subject(leapfrog, {}, ("separable",))) == ["kepler-orbit", "pendulum-short"]
    assert place.scenes(subject(leapfrog, {}, ("polynomial degree",))) == ["henon-heiles-chaotic"]
    assert place.scenes(subject("wisdom-holman")) == []


# -- times -------------------------------------------------------------------------------------------------------------


def test_factor_is_measured_through_the_reference():
    """A step's time over the fastest stored method's, which takes 0.5 of a reference run by the stored table.

    100 evaluations take 30 reference runs; 50 take 15, a factor of 30.  The cost of Python is one of an evaluation.
    """
    known = times.StoredTimes(10, 120.0, {1e-2: times.Fastest("a", 0.5), 1e-4: times.Fastest("b", 2.0)})
    needed = {1e-2: 50.0, 1e-4: 400.0, 1e-6: 800.0, 1e-8: None}
    row = {"on": "kepler-orbit", "errors": [{"error": e, "evaluations": n} for e, n in needed.items()]}
    mine, reference = 3e-3 * np.linspace(0.5, 1.5, 9), np.full(9, 1e-4)
    told = {"mine": mine, "reference": reference}
    found = times.times_row(row, known, 100.0, told)
    assert [(e["error"], e["fastest"]) for e in found["errors"]] == [(1e-2, "a"), (1e-4, "b")]
    assert [e["factor"] for e in found["errors"]] == pytest.approx([30.0, 60.0])
    assert found["python"] is None
    here = timing.ratio(mine, reference)
    assert [found["errors"][0][k] for k in ("low", "high")] == pytest.approx([here.low, here.high])
    python = np.full(9, 4 * times.STEPS * 1e-5)
    found = times.times_row(row, known, 100.0, told | {"python": python})
    assert found["python"]["value"] == pytest.approx(1e-5 / (1e-4 / 120))


@pytest.mark.parametrize(
    ("target", "requires", "runs"),
    [(leapfrog, ("separable",), {"mine", "python", "reference"}), ("stormer-verlet", (), {"mine", "reference"})],
)
def test_runs_that_are_timed_alternately(target, requires, runs, monkeypatch):
    """The timed run has as many steps as the stated number of evaluations needs."""
    monkeypatch.setattr(place, "MOST", 2000)
    chosen, seen, sizes = subject(target, {}, requires), {}, []

    def in_turns(work, rounds):
        seen.update({name: seconds() for name, seconds in work.items()})
        return {name: np.full(rounds, 1.0 if name == "mine" else 0.5) for name in work}

    def run(*arguments):
        sizes.append(arguments[-1])
        return place.run_subject(*arguments)

    monkeypatch.setattr(timing, "in_turns", in_turns)
    row = place.place(chosen, "pendulum-short")
    found = times.time_subject(chosen, row, run)
    assert set(seen) == runs
    assert min(seen.values()) > 0
    if sizes:  # a step in Python makes two evaluations by q per step
        assert {2 * n for n in sizes} == {max(x for x, _ in row["curve"] if x <= times.SHORT)}
    evaluations = 2 * sizes[0] if sizes else row["curve"][-1][0]
    first, known = row["errors"][0], times.TABLE.load()["pendulum-short"]
    share = known.fastest[first["error"]].share
    assert found["errors"][0]["factor"] == pytest.approx(2.0 * first["evaluations"] / evaluations / share)
