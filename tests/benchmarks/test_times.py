"""Times relative to the fastest stored method: the stored table, the ratio through a reference, when none is given."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.certificate import costs, fronts, place, times
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.measure import timing
from phasebench.benchmarks.problems import problem
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import BY_ID as METHODS
from phasebench.reference.peers import BY_ID as PEERS
from support.steps import leapfrog


def rung(seconds, steps, scene="kepler-orbit", integrator=times.REFERENCE, status="ok"):
    row = {"scene": scene, "integrator": integrator, "status": status, "seconds": seconds}
    return row | {"steps": steps, "evaluations": 12 * int(steps)}


def choice(accuracy, ours, peer, scene="kepler-orbit"):
    """A fabricated row: the fastest of our methods and the fastest peer at an accuracy, each a dict of columns."""
    sides = {f"{side} {x}": v for side, of in (("ours", ours), ("peer", peer)) for x, v in of.items()}
    return {"scene": scene, "accuracy": accuracy} | sides


def side(seconds, integrator):
    return {"seconds": seconds, "integrator": integrator}


def test_fastest_is_stored_relative_to_the_reference():
    rungs = [
        rung("1e-4", "10"),
        rung("1e-3", "100"),
        rung("1", "9", integrator="rk4"),
        rung("1", "9", status="diverged"),
        rung("1", "9", scene="pendulum-short"),
    ]
    choices = [
        choice(1e-4, side("3e-4", "a"), side("2e-4", "b")),
        choice(1e-2, side("1e-4", "a"), side("", "")),
        choice(1e-6, side(float("nan"), None), side("5e-4", "b")),
        choice(1e-8, side("", ""), side("", "")),
        choice(1e-3, side("1e-4", "a"), side("2e-4", "b")),  # an accuracy that is not compared
        choice(1e-2, side("1e-4", "a"), side("2e-4", "b"), scene="nls"),
        choice(1e-2, side("1e-4", "a"), side("2e-4", "b"), scene="henon-heiles-chaotic"),  # no run of the reference
    ]
    lines = times.build(choices, rungs)
    assert [(x["error"], x["integrator"], x["share"]) for x in lines] == [
        (1e-2, "a", 0.1),
        (1e-4, "b", 0.2),
        (1e-6, "b", 0.5),
    ]
    assert {(x["scene"], x["steps"], x["evaluations"]) for x in lines} == {("kepler-orbit", 100, 1200)}


def test_stored_times_cover_every_scene():
    assert list(times.TABLE.load()) == list(fronts.SCENES)
    for known in times.TABLE.load().values():
        assert set(known.fastest) <= set(fronts.ERRORS)
        assert known.evaluations == 12 * known.steps, "the reference has twelve evaluations a step"
        for best in known.fastest.values():
            assert best.integrator.partition("(")[0] in METHODS.keys() | PEERS.keys()
            assert 0 < best.share < 10


KNOWN = times.StoredTimes(10, 120.0, {1e-2: times.Fastest("a", 0.5), 1e-4: times.Fastest("b", 2.0)})
ROW = {
    "on": "kepler-orbit",
    "errors": [
        {"error": 1e-2, "evaluations": 50.0},
        {"error": 1e-4, "evaluations": 400.0},
        {"error": 1e-6, "evaluations": 800.0},  # no time is stored for this error
        {"error": 1e-8, "evaluations": None},
    ],
}
MINE, REFERENCE = np.full(9, 3e-3), np.full(9, 1e-4)


def test_factor_is_measured_through_the_reference():
    """A step's time over the fastest stored method's, which takes 0.5 of a reference run by the stored table.

    100 evaluations take 30 reference runs; 50 take 15, a factor of 30.
    """
    found = times.times_row(ROW, KNOWN, 100.0, {"mine": MINE, "reference": REFERENCE})
    assert [(e["error"], e["fastest"]) for e in found["errors"]] == [(1e-2, "a"), (1e-4, "b")]
    assert [e["factor"] for e in found["errors"]] == pytest.approx([30.0, 60.0])
    assert found["python"] is None


def test_cost_of_python_is_per_evaluation():
    python = np.full(9, 4 * times.STEPS * 1e-5)
    found = times.times_row(ROW, KNOWN, 100.0, {"mine": MINE, "reference": REFERENCE, "python": python})
    assert found["python"]["value"] == pytest.approx(1e-5 / (1e-4 / 120))


def test_interval_is_that_of_the_rounds():
    uneven = MINE * np.linspace(0.5, 2, 9)
    found = times.times_row(ROW, KNOWN, 100.0, {"mine": uneven, "reference": REFERENCE})["errors"][0]
    here = timing.ratio(uneven, REFERENCE)
    assert [found[k] for k in ("low", "factor", "high")] == pytest.approx([here.low, here.value, here.high])


@pytest.mark.parametrize(
    ("target", "requires", "runs"),
    [(leapfrog, ("separable",), {"mine", "python", "reference"}), ("stormer-verlet", (), {"mine", "reference"})],
    ids=["own", "ours"],
)
def test_runs_that_are_timed_alternately(target, requires, runs, monkeypatch):
    """A step in Python (also its calls: "python") or a method ("mine") alternates with a reference method.

    The timed run has the number of steps with the stated number of evaluations.
    """
    monkeypatch.setattr(place, "MOST", 2000)
    chosen, seen = subject(target, {}, requires), {}

    def in_turns(work, rounds):
        seen.update({name: [seconds() for _ in range(2)] for name, seconds in work.items()})
        return {name: np.full(rounds, 1.0 if name == "mine" else 0.5) for name in work}

    monkeypatch.setattr(timing, "in_turns", in_turns)
    row = place.place(chosen, "pendulum-short")
    assert len(row["sizes"]) == len(row["curve"])
    sizes = []

    def run(*arguments):
        sizes.append(arguments[-1])
        return place.run_subject(*arguments)

    found = times.time_subject(chosen, row, run)
    assert set(seen) == runs
    assert all(s > 0 for told in seen.values() for s in told)
    if sizes:  # a step in Python makes two evaluations by q per step
        assert {2 * n for n in sizes} == {max(x for x, _ in row["curve"] if x <= times.SHORT)}
    evaluations = 2 * sizes[0] if sizes else row["curve"][-1][0]
    first, known = row["errors"][0], times.TABLE.load()["pendulum-short"]
    share = known.fastest[first["error"]].share
    assert found["errors"][0]["factor"] == pytest.approx(2.0 * first["evaluations"] / evaluations / share)


def test_control_compiled_reference_against_itself():
    """Timed against itself, the reference method has the factor 1, within the accuracy of the clock."""
    runs = [times._often(problem("pendulum:swinging"), times.REFERENCE, 5.0, n) for n in (100, 100, 1000)]
    one, same, ten = (min(run() for _ in range(5)) for run in runs)
    assert 0.5 < same / one < 2
    compiled = prepare(problem("pendulum:swinging"), times.REFERENCE)
    alone = min(times._clock(lambda: compiled(5.0 / 1000, 1000))() for _ in range(9))
    assert 0.3 < ten / alone < 3, "of one run, not of all that are timed together"
    assert ten > 3 * one


def test_peer_that_counts_evaluations_is_timed():
    scipy = subject("scipy-dop853")
    row = place.place(scipy, "pendulum-short")
    found = times.time_subject(scipy, row, place.run_subject)
    assert found["python"] is None
    assert all(e["factor"] > 10 for e in found["errors"]), "its right-hand side is Python's"


def test_no_time_without_evaluations_or_a_met_error():
    heyoka = subject("heyoka")
    row = {"on": "pendulum-short", "curve": [[0.0, 1e-9]], "sizes": [1e-9], "errors": [{"evaluations": 0.0}]}
    assert times.time_subject(heyoka, row, place.run_subject) is None
    row = {"on": "pendulum-short", "curve": [[10.0, 1.0]], "sizes": [10], "errors": [{"evaluations": None}]}
    assert times.time_subject(subject("rk4"), row, place.run_subject) is None
    row = {"on": "nls", "curve": [[10.0, 1.0]], "sizes": [10], "errors": [{"evaluations": 10.0}]}
    assert times.time_subject(subject("rk4"), row, place.run_subject) is None, "of this scene no time is stored"


@pytest.mark.parametrize(
    ("x", "text"), [(2.345, "2.3"), (99.0, "99"), (123.0, "120"), (99.7, "100"), (15012.0, "15000")]
)
def test_factor_is_written_without_a_power_of_ten(x, text):
    assert costs.count(x) == text
