"""Measures of ensembles: costs at equal error, rungs of a ladder, the speed-up of a bare loop, starts of maps."""

from __future__ import annotations

import time

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.ladder.costs import at
from phasebench.benchmarks.measure.timing import NOWHERE
from phasebench.benchmarks.studies.ensembles import against, lanes, maps
from phasebench.integrators.registry import method


def test_speed_up_of_a_bare_loop_on_one_and_two_threads():
    assert lanes.speed_up(1, 3, 20_000).value == pytest.approx(1, abs=0.7)
    assert 0.2 < lanes.speed_up(2, 3, 200_000).value < 2.6


def test_speed_up_counts_the_work_of_every_thread(monkeypatch):
    """Three threads that sleep at once do three times the work of one in the same time."""
    monkeypatch.setattr(lanes, "compile_loop", lambda: lambda *_: time.sleep(0.05))
    assert 2 < lanes.speed_up(3, 3).value < 5


def rung(side, error, us, integrator=None, spread=0.02, problem="p") -> dict:
    """The fabricated row of a run: side (ours or a peer), error, and time per orbit in us +- the relative spread."""
    row = {"problem": problem, "integrator": integrator or side, "side": side, "error": error, "us": us}
    return row | {"us, low": us * (1 - spread), "us, high": us * (1 + spread)}


def ladder(side, factor: float, order: int = 4) -> list[dict]:
    """Fabricated runs of one side at ever smaller steps: the cost doubles where the error falls by 2^order."""
    return [rung(side, 2.0 ** (-order * k), factor * 2.0**k) for k in range(12)]


def test_cost_is_interpolated_between_two_rungs():
    rungs = pd.DataFrame(ladder("ours", 1.0))
    assert at(rungs, 2.0**-16).value == pytest.approx(2.0**4)
    assert at(rungs, 2.0**-18).value == pytest.approx(2.0**4.5)
    assert at(rungs, 10.0).value == 1.0
    assert at(rungs, 1e-30) is NOWHERE


def test_failed_run_is_no_rung():
    rungs = pd.DataFrame([*ladder("ours", 1.0), rung("ours", np.nan, 1e-3)])
    assert at(rungs, 2.0**-16).value == pytest.approx(2.0**4)


def test_cheap_accurate_rung_beats_a_costly_inaccurate_one():
    rungs = pd.DataFrame([rung("ours", 1e-3, 50.0), rung("ours", 1e-9, 10.0)])
    assert at(rungs, 1e-5).value == 10.0


def test_cost_at_a_rung_and_next_to_a_rung_without_error():
    assert at(pd.DataFrame([rung("ours", 1e-3, 5.0)]), 1e-3).value == 5.0
    assert at(pd.DataFrame([rung("ours", 1e-3, 1.0), rung("ours", 0.0, 5.0)]), 1e-5).value == 5.0
    between = at(pd.DataFrame([rung("ours", 0.0625, 1.0), rung("ours", 1e-3, 100.0)]), 0.25**0.5 * 0.0625**0.5)
    assert between.value == 1.0, "a coarser rung has the error"
    between = at(pd.DataFrame([rung("ours", 0.09, 1.0), rung("ours", 1e-3, 100.0)]), (0.09 * 1e-3) ** 0.5)
    assert (between.value, between.low, between.high) == (pytest.approx(10), pytest.approx(9.8), pytest.approx(10.2))


@pytest.mark.parametrize(("apart", "cost"), [(99.0, 10.0), (100.0, 100.0), (1e4, 100.0)])
def test_interpolation_spans_less_than_two_decades(apart, cost):
    """The cost half way between the errors of two runs, one of which costs 100 times the other."""
    rungs = pd.DataFrame([rung("ours", 1e-3 * apart, 1.0), rung("ours", 1e-3, 100.0)])
    assert at(rungs, 1e-3 * apart**0.5).value == pytest.approx(cost)
    assert at(rungs, 1e-3 * apart).value == 1.0
    assert at(rungs, 1e-3).value == 100.0


@pytest.mark.parametrize("id", against.LADDERS)
def test_ladder_errors_fall_by_at_most_two_decades(id):
    rungs = np.array(against.LADDERS[id])
    assert method(id).order * np.log10(rungs[1:] / rungs[:-1]).max() <= 2
    assert (rungs * against.T_END == np.round(rungs * against.T_END)).all()


def power(who: str, kind: str, order: float, sizes) -> dict:
    """{run: error h^order} of an integrator at these sizes h, steps or tolerances according to ``kind``."""
    return {against.Rung(who, kind, h): h**order for h in sizes}


def test_rung_is_inserted_between_distant_errors():
    steps, tols = (0.5, 0.25, 0.125), (1e-3, 1e-4)
    wide, near = power("a", "h", 8, steps), power("b", "h", 4, steps)
    assert against.between(near) == []
    found = against.between(wide | near | power("c", "tol", 3, tols))
    assert [(r.who, r.kind) for r in found] == [("a", "h"), ("a", "h"), ("c", "tol")]
    for rung, middle in zip(found, ((0.5 * 0.25) ** 0.5, (0.25 * 0.125) ** 0.5, 10**-3.5), strict=True):
        assert rung.value == pytest.approx(middle, rel=2e-3)
    assert against.T_END / found[0].value == round(against.T_END / found[0].value)
    assert against.between(wide | {r: r.value**8 for r in found[:2]}) == []


def test_no_rung_is_inserted_where_none_is_needed():
    asked = power("a", "tol", 10, (0.9, 0.4))
    assert len(against.between(asked)) == 1
    assert against.between({r: e * 1e-13 for r, e in asked.items()}) == [], "below all that is asked"
    first, second = asked
    assert against.between({first: np.nan, second: 1e-9}) == []
    assert against.between({first._replace(who="b"): 1.0, second: 1e-9}) == [], "of two ladders"
    steps = [against.Rung("a", "h", against.T_END / n) for n in (7, 8)]
    assert against.between(dict(zip(steps, (1.0, 1e-9), strict=True))) == [], "there is no number of steps between"


def test_rungs_are_sorted_within_each_ladder():
    rungs = [against.Rung(who, "h", h) for who, h in (("b", 0.5), ("b", 0.1), ("a", 1.0), ("b", 0.3), ("a", 2.0))]
    assert [(r.who, r.value) for r in against.in_order(rungs)] == [
        *(("b", 0.5), ("b", 0.3), ("b", 0.1)),
        *(("a", 2.0), ("a", 1.0)),
    ]


def test_error_is_that_of_the_worst_orbit():
    truth = np.zeros((3, 2))
    ends = np.array([[0.1, 0.0], [0.0, -0.5], [0.2, 0.3], [9.0, 9.0]])
    assert against.worst(ends, truth) == 0.5, "of those that are judged"
    assert against.worst(truth, truth) == 0.0
    ends[0, 0] = np.nan
    assert np.isnan(against.worst(ends, truth))


def test_cost_is_divided_by_the_number_of_orbits(monkeypatch):
    """A run of 1 s costs 1e6 us over its number of orbits; heyoka carries fewer than our method."""
    ends = np.zeros((against.ORBITS, 4))
    ends[1, 2] = 0.25
    monkeypatch.setattr(against, "exact", lambda system, Q, P: np.zeros((len(Q), 4)))
    monkeypatch.setattr(against, "_ours", lambda system, id, h, Q, P: lambda: ends[: len(Q)])
    monkeypatch.setattr(against, "_batches", lambda system, tol, width, y: lambda: ends[: len(y)])
    monkeypatch.setattr(against, "widths", lambda: (4,))
    monkeypatch.setattr(against, "time_in_turns", lambda runs, rounds: {key: np.ones(9) for key in runs})
    rows = pd.DataFrame(against.against("henon-heiles:box"))
    assert set(rows["error"]) == {0.25}
    for side, orbits in (("heyoka", 128), ("ours", 512)):
        part = rows[rows["side"] == side]
        assert set(part["orbits"]) == {orbits}
        np.testing.assert_allclose(part["us"], 1e6 / orbits, rtol=1e-12)
    assert list(rows.loc[rows["side"] == "heyoka", "tol"]) == list(against.TOLERANCES)


@pytest.mark.parametrize("heyoka", [[], [rung("heyoka", 1.0, 1.0)]], ids=["not run", "not there"])
def test_side_that_misses_the_error_has_no_name(heyoka):
    first = against.compared(pd.DataFrame([rung("ours", 1e-3, 2.0), *heyoka])).iloc[0]
    assert (first["error"], first["ours"], first["us, ours"]) == (0.1, "ours", 2.0)
    assert first["heyoka"] == ""
    assert np.isnan(first["ours / heyoka"])


def test_starts_of_maps_lie_on_the_plane_at_their_energy():
    q2, p2 = np.random.default_rng(1).uniform(-0.2, 0.2, (2, 50))
    Q, P = maps.on_plane(q2, p2)
    energy = (P**2).sum(1) / 2 + (Q**2).sum(1) / 2 + Q[:, 0] ** 2 * Q[:, 1] - Q[:, 1] ** 3 / 3
    np.testing.assert_allclose(energy, maps.ENERGY, rtol=1e-14)
    assert (Q[:, 0] == 0).all()
    assert (P[:, 0] > 0).all()
