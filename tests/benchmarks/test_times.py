"""The time on fronts of the trade: what is stored, what the runs here make of it, and when nothing is said."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.certificate import fronts, place, times
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
    sides = {f"{side} {x}": v for side, of in (("ours", ours), ("peer", peer)) for x, v in of.items()}
    return {"scene": scene, "accuracy": accuracy} | sides


def side(seconds, integrator):
    return {"seconds": seconds, "integrator": integrator}


def test_who_is_the_fastest_is_stored_as_a_share_of_the_longest_run_of_the_reference():
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
    lines = times.made(choices, rungs)
    assert [(x["error"], x["integrator"], x["share"]) for x in lines] == [
        (1e-2, "a", 0.1),
        (1e-4, "b", 0.2),
        (1e-6, "b", 0.5),
    ]
    assert {(x["scene"], x["steps"], x["evaluations"]) for x in lines} == {("kepler-orbit", 100, 1200)}


def test_what_is_stored_is_of_every_scene():
    assert list(times.stored()) == list(fronts.SCENES)
    for known in times.stored().values():
        assert set(known.fastest) <= set(fronts.ERRORS)
        assert known.evaluations == 12 * known.steps, "the reference has twelve evaluations a step"
        for best in known.fastest.values():
            assert best.integrator.partition("(")[0] in METHODS.keys() | PEERS.keys()
            assert 0 < best.share < 10


def test_kept_is_what_was_made(tmp_path, monkeypatch):
    before = times.stored()
    lines = [
        {"scene": s, "error": e, "integrator": b.integrator, "share": b.share, "steps": k.steps}
        | {"evaluations": k.evaluations}
        for s, k in before.items()
        for e, b in k.fastest.items()
    ]
    monkeypatch.setattr(times, "PATH", tmp_path / "times.csv")
    times.keep(lines)
    assert times.stored() == before
    times.stored.cache_clear()


KNOWN = times.Stored(10, 120.0, {1e-2: times.Fastest("a", 0.5), 1e-4: times.Fastest("b", 2.0)})
ROW = {
    "on": "kepler-orbit",
    "errors": [
        {"error": 1e-2, "evaluations": 50.0},
        {"error": 1e-4, "evaluations": 400.0},
        {"error": 1e-6, "evaluations": 800.0},  # of which no time is stored
        {"error": 1e-8, "evaluations": None},
    ],
}
MINE, REFERENCE = np.full(9, 3e-3), np.full(9, 1e-4)


def test_a_time_here_over_the_reference_here_times_the_reference_there_over_the_fastest_there():
    """100 evaluations take 30 runs of the reference; so 50 of them 15, which is 30 times the half of one."""
    found = times.told(ROW, KNOWN, 100.0, {"mine": MINE, "reference": REFERENCE})
    assert [(e["error"], e["fastest"]) for e in found["errors"]] == [(1e-2, "a"), (1e-4, "b")]
    assert [e["factor"] for e in found["errors"]] == pytest.approx([30.0, 60.0])
    assert found["python"] is None


def test_what_python_costs_is_of_an_evaluation():
    python = np.full(9, 4 * times.STEPS * 1e-5)
    found = times.told(ROW, KNOWN, 100.0, {"mine": MINE, "reference": REFERENCE, "python": python})
    assert found["python"]["value"] == pytest.approx(1e-5 / (1e-4 / 120))


def test_the_interval_is_that_of_the_rounds():
    uneven = MINE * np.linspace(0.5, 2, 9)
    found = times.told(ROW, KNOWN, 100.0, {"mine": uneven, "reference": REFERENCE})["errors"][0]
    here = timing.ratio(uneven, REFERENCE)
    assert [found[k] for k in ("low", "factor", "high")] == pytest.approx([here.low, here.value, here.high])


@pytest.mark.parametrize(
    ("target", "requires", "runs"),
    [(leapfrog, ("separable",), {"mine", "python", "reference"}), ("stormer-verlet", (), {"mine", "reference"})],
    ids=["own", "ours"],
)
def test_what_is_timed_in_turns(target, requires, runs, monkeypatch):
    """The run that is timed is that of the rung whose evaluations are told; Python's is of a step that Python calls."""
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
        return place.measured(*arguments)

    found = times.timed(chosen, row, run)
    assert set(seen) == runs
    assert all(s > 0 for told in seen.values() for s in told)
    if sizes:  # Python calls it: two evaluations by q a step
        assert {2 * n for n in sizes} == {max(x for x, _ in row["curve"] if x <= times.SHORT)}
    evaluations = 2 * sizes[0] if sizes else row["curve"][-1][0]
    first, known = row["errors"][0], times.stored()["pendulum-short"]
    share = known.fastest[first["error"]].share
    assert found["errors"][0]["factor"] == pytest.approx(2.0 * first["evaluations"] / evaluations / share)


def test_the_compiled_reference_takes_its_own_time():
    """Control: the method through which times are told takes once its own time, as far as a clock tells."""
    runs = [times._often(problem("pendulum:swinging"), times.REFERENCE, 5.0, n) for n in (100, 100, 1000)]
    one, same, ten = (min(run() for _ in range(5)) for run in runs)
    assert 0.5 < same / one < 2
    compiled = prepare(problem("pendulum:swinging"), times.REFERENCE)
    alone = min(times._clocked(lambda: compiled(5.0 / 1000, 1000))() for _ in range(9))
    assert 0.3 < ten / alone < 3, "of one run, not of all that are timed together"
    assert ten > 3 * one


def test_a_peer_that_tells_its_evaluations_tells_its_seconds():
    scipy = subject("scipy-dop853")
    row = place.place(scipy, "pendulum-short")
    found = times.timed(scipy, row, place.measured)
    assert found["python"] is None
    assert all(e["factor"] > 10 for e in found["errors"]), "its right-hand side is Python's"


def test_who_tells_no_evaluations_or_meets_nothing_has_no_time():
    heyoka = subject("heyoka")
    row = {"on": "pendulum-short", "curve": [[0.0, 1e-9]], "sizes": [1e-9], "errors": [{"evaluations": 0.0}]}
    assert times.timed(heyoka, row, place.measured) is None
    row = {"on": "pendulum-short", "curve": [[10.0, 1.0]], "sizes": [10], "errors": [{"evaluations": None}]}
    assert times.timed(subject("rk4"), row, place.measured) is None
    row = {"on": "nls", "curve": [[10.0, 1.0]], "sizes": [10], "errors": [{"evaluations": 10.0}]}
    assert times.timed(subject("rk4"), row, place.measured) is None, "of this scene no time is stored"


def said(low=90.0, factor=100.0, high=110.0, python=None):
    errors = [{"error": 1e-2, "fastest": "a", "low": low, "factor": factor, "high": high}]
    errors.append({"error": 1e-4, "fastest": "a", "low": 1.0, "factor": 2.34, "high": 1e9})
    (line,) = times.said([{"on": "kepler-orbit", "reference": "dop853", "errors": errors, "python": python}])
    return line.removeprefix("time on kepler-orbit: ")


def test_what_is_said_of_a_time():
    plain = said()
    assert plain == (
        "about 100 times the fastest stored for an error of 1e-02, 2.3 times for an error of 1e-04 "
        "(to a factor of 2; told through dop853, run in turns here and stored there)"
    )
    price = {"low": 900.0, "value": 1234.0, "high": 1500.0}
    assert said(python=price).startswith(plain)
    assert "about 1200 times the compiled one" in said(python=price)
    assert "compiled one" in said(python=price | {"high": 1800.0})
    assert said(python=price | {"high": 2000.0}) == f"{plain}, with what Python's calls cost"
    assert times.said([{"on": "kepler-orbit", "errors": []}]) == []


@pytest.mark.parametrize(("high", "told"), [(180.0, True), (180.1, False)])
def test_a_time_that_differs_from_run_to_run_is_not_told(high, told):
    line = said(90.0, 100.0, high)
    assert ("about 100 times" in line) is told
    assert line.startswith("not told, the runs differ too much (90 to 180 times") is not told


@pytest.mark.parametrize(("x", "text"), [(2.345, "2.3"), (99.0, "99"), (123.0, "120"), (15012.0, "15000")])
def test_a_factor_is_written_without_a_power_of_ten(x, text):
    assert times.count(x) == text
