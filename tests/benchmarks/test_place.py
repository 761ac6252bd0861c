"""The place on fronts of the trade: what is stored, what a step needs, and what is said of it."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.certificate import fronts, place
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.certificate.verdicts import Tables
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
