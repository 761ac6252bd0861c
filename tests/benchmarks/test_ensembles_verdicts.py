"""The ensembles page's sentences follow their rows, both ways."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.ensembles import against, bench_ensembles, ceiling, compare, lanes, maps, page
from phasebench.integrators.registry import method


def step(method="verlet", gain=4.0, spread=0.5, speed_up=1.9, **more) -> dict:
    row = {"problem": "p", "method": method, "in lanes": True, "status": "ok", "cores": 2, "speed-up": speed_up}
    row |= {"gain": gain, "gain, low": gain - spread, "gain, high": gain + spread, "largest difference": 0.0}
    return row | more


def told(verdict, **tables):
    return verdict({name: pd.DataFrame(rows) for name, rows in tables.items()}.get)


def gain(*rows):
    return told(page.gain, **{lanes.TABLE: rows})


def test_what_lanes_gain_is_the_least_and_the_most():
    said = gain(
        step("a", 3.0), step("b", 5.0), step("c", 9.0, **{"in lanes": False}), step("d", 9.0, status="diverged")
    )
    assert said.holds
    assert "3.0 (a, p) to 5.0 times (b, p) as fast" in said.text
    assert "2 of 2 ensembles end where it ends to the last bit." in said.text
    slow = gain(step("a", 3.0), step("b", 1.3))
    assert not slow.holds
    assert "not surely faster: b, p;" in slow.text
    assert gain(step(**{"in lanes": False})) is None
    assert not gain(step(gain=1.5, spread=0.5)).holds
    assert gain(step(gain=1.5, spread=0.4)).holds


def test_ensembles_that_end_elsewhere_are_counted():
    said = gain(step("a"), step("b", **{"largest difference": 3e-14}))
    assert "1 of 2 ensembles end where it ends to the last bit, the others within 3.00e-14." in said.text


MAPS = [{"map": maps.SECTION, "seconds": 0.25}, {"map": maps.GRID, "seconds": 0.5}]


@pytest.mark.parametrize(
    ("slowest", "bare", "wanted", "holds"),
    [(1.8, None, 1.8, True), (1.79, None, 1.8, False), (1.79, 2.0, 1.8, False), (1.53, 1.6, 1.52, True)]
    + [(1.51, 1.6, 1.52, False), (np.nan, 2.0, 1.8, False)],
)
def test_cores_are_held_to_what_is_wanted_or_to_what_they_can(slowest, bare, wanted, holds):
    rows = [step(), step("b", speed_up=slowest)]
    rows += [] if bare is None else [step(lanes.CEILING, problem="", speed_up=bare, **{"in lanes": False})]
    said = told(page.parallel, **{lanes.TABLE: rows, maps.TABLE: MAPS})
    assert said.holds == holds
    assert f"(wanted: {wanted:.2f}" in said.text
    assert bare is None or f"{bare:.2f} times on a bare loop" in said.text
    assert ("less: b, p" in said.text) != holds
    assert "to 1.90 times as fast as one" in said.text
    assert "the section took 0.25 s; the map of chaos took 0.5 s." in said.text


def test_the_speed_up_in_the_median_is_that_of_the_methods():
    rows = [step(), step("b", speed_up=1.5), step("c", speed_up=1.7)]
    said = told(page.parallel, **{lanes.TABLE: rows, maps.TABLE: MAPS})
    assert said.short == "2 cores: 1.70 times one in the median."
    assert told(page.parallel, **{lanes.TABLE: [step(status="diverged")], maps.TABLE: MAPS}) is None


def test_a_bare_loop_gains_on_two_threads_what_two_cores_give_and_on_one_nothing():
    assert ceiling.speed_up(1, 3, 20_000).value == pytest.approx(1, abs=0.7)
    assert 0.2 < ceiling.speed_up(2, 3, 200_000).value < 2.6


def rung(side, error, us, integrator=None, spread=0.02, problem="p") -> dict:
    row = {"problem": problem, "integrator": integrator or side, "side": side, "error": error, "us": us}
    return row | {"us, low": us * (1 - spread), "us, high": us * (1 + spread)}


def ladder(side, factor: float, order: int = 4) -> list[dict]:
    """The cost rises by 2 where the error falls by 2^order."""
    return [rung(side, 2.0 ** (-order * k), factor * 2.0**k) for k in range(12)]


def test_the_cost_at_an_error_is_on_the_line_between_two_rungs():
    rungs = pd.DataFrame(ladder("ours", 1.0))
    assert compare.at(rungs, 2.0**-16).value == pytest.approx(2.0**4)
    assert compare.at(rungs, 2.0**-18).value == pytest.approx(2.0**4.5)
    assert compare.at(rungs, 10.0).value == 1.0
    assert compare.at(rungs, 1e-30) is compare.NOWHERE


def test_a_run_that_does_not_arrive_is_no_rung():
    rungs = pd.DataFrame([*ladder("ours", 1.0), rung("ours", np.nan, 1e-3)])
    assert compare.at(rungs, 2.0**-16).value == pytest.approx(2.0**4)


def test_a_cheap_rung_of_a_small_error_is_not_made_dearer_by_a_dear_one_of_a_large():
    rungs = pd.DataFrame([rung("ours", 1e-3, 50.0), rung("ours", 1e-9, 10.0)])
    assert compare.at(rungs, 1e-5).value == 10.0


def test_a_rung_of_just_the_error_is_there_and_one_without_error_is_not_between():
    assert compare.at(pd.DataFrame([rung("ours", 1e-3, 5.0)]), 1e-3).value == 5.0
    assert compare.at(pd.DataFrame([rung("ours", 1e-3, 1.0), rung("ours", 0.0, 5.0)]), 1e-5).value == 5.0
    between = compare.at(pd.DataFrame([rung("ours", 0.0625, 1.0), rung("ours", 1e-3, 100.0)]), 0.25**0.5 * 0.0625**0.5)
    assert between.value == 1.0, "a coarser rung has the error"
    between = compare.at(pd.DataFrame([rung("ours", 0.09, 1.0), rung("ours", 1e-3, 100.0)]), (0.09 * 1e-3) ** 0.5)
    assert (between.value, between.low, between.high) == (pytest.approx(10), pytest.approx(9.8), pytest.approx(10.2))


@pytest.mark.parametrize(("apart", "cost"), [(99.0, 10.0), (100.0, 100.0), (1e4, 100.0)])
def test_no_power_law_goes_over_two_decades(apart, cost):
    """Half way between two rungs, of which one costs a hundred times the other."""
    rungs = pd.DataFrame([rung("ours", 1e-3 * apart, 1.0), rung("ours", 1e-3, 100.0)])
    assert compare.at(rungs, 1e-3 * apart**0.5).value == pytest.approx(cost)
    assert compare.at(rungs, 1e-3 * apart).value == 1.0
    assert compare.at(rungs, 1e-3).value == 100.0


def test_errors_are_at_most_two_decades_apart_down_to_round_off():
    np.testing.assert_allclose(np.diff(np.log10(compare.ERRORS)), [-2, -2, -2, -2, -1, -1, -1], rtol=1e-12)
    assert 1e-10 in compare.ERRORS
    assert compare.ERRORS[-1] == 1e-12


def test_tolerances_are_a_factor_of_ten_apart():
    np.testing.assert_allclose(np.diff(np.log10(against.TOLERANCES[:-1])), -1, rtol=1e-12)
    assert 1e-10 in against.TOLERANCES
    assert against.TOLERANCES[-2] / 10 < against.TOLERANCES[-1] == np.finfo(float).eps


@pytest.mark.parametrize("id", against.LADDERS)
def test_the_error_falls_by_at_most_two_decades_from_a_rung_to_the_next(id):
    rungs = np.array(against.LADDERS[id])
    assert method(id).order * np.log10(rungs[1:] / rungs[:-1]).max() <= 2
    assert (rungs * against.T_END == np.round(rungs * against.T_END)).all()


def power(who: str, kind: str, order: float, sizes) -> dict:
    return {against.Rung(who, kind, h): h**order for h in sizes}


def test_a_rung_is_put_between_neighbours_that_are_two_decades_apart():
    steps, tols = (0.5, 0.25, 0.125), (1e-3, 1e-4)
    wide, near = power("a", "h", 8, steps), power("b", "h", 4, steps)
    assert against.between(near) == []
    found = against.between(wide | near | power("c", "tol", 3, tols))
    assert [(r.who, r.kind) for r in found] == [("a", "h"), ("a", "h"), ("c", "tol")]
    for rung, middle in zip(found, ((0.5 * 0.25) ** 0.5, (0.25 * 0.125) ** 0.5, 10**-3.5), strict=True):
        assert rung.value == pytest.approx(middle, rel=2e-3)
    assert against.T_END / found[0].value == round(against.T_END / found[0].value)
    assert against.between(wide | {r: r.value**8 for r in found[:2]}) == []


def test_no_rung_is_put_where_no_error_is_asked_or_none_arrives():
    asked = power("a", "tol", 10, (0.9, 0.4))
    assert len(against.between(asked)) == 1
    assert against.between({r: e * 1e-13 for r, e in asked.items()}) == [], "below all that is asked"
    first, second = asked
    assert against.between({first: np.nan, second: 1e-9}) == []
    assert against.between({first._replace(who="b"): 1.0, second: 1e-9}) == [], "of two ladders"
    steps = [against.Rung("a", "h", against.T_END / n) for n in (7, 8)]
    assert against.between(dict(zip(steps, (1.0, 1e-9), strict=True))) == [], "there is no number of steps between"


def test_a_ladder_is_in_order_whatever_was_put_between():
    rungs = [against.Rung(who, "h", h) for who, h in (("b", 0.5), ("b", 0.1), ("a", 1.0), ("b", 0.3), ("a", 2.0))]
    assert [(r.who, r.value) for r in against.in_order(rungs)] == [
        *(("b", 0.5), ("b", 0.3), ("b", 0.1)),
        *(("a", 2.0), ("a", 1.0)),
    ]


def test_the_error_is_the_worst_orbits_and_one_that_is_lost_is_none():
    truth = np.zeros((3, 2))
    ends = np.array([[0.1, 0.0], [0.0, -0.5], [0.2, 0.3], [9.0, 9.0]])
    assert against.worst(ends, truth) == 0.5, "of those that are judged"
    assert against.worst(truth, truth) == 0.0
    ends[0, 0] = np.nan
    assert np.isnan(against.worst(ends, truth))


def test_a_cost_is_of_as_many_orbits_as_were_carried(monkeypatch):
    """A run of a second costs 1e6 us over its orbits: heyoka's carry fewer than ours."""
    ends = np.zeros((against.ORBITS, 4))
    ends[1, 2] = 0.25
    monkeypatch.setattr(against, "exact", lambda system, Q, P: np.zeros((len(Q), 4)))
    monkeypatch.setattr(against, "_ours", lambda system, id, h, Q, P: lambda: ends[: len(Q)])
    monkeypatch.setattr(against, "_batches", lambda system, tol, width, y: lambda: ends[: len(y)])
    monkeypatch.setattr(against, "widths", lambda: (4,))
    monkeypatch.setattr(against, "in_turns", lambda runs, rounds: {key: np.ones(9) for key in runs})
    rows = pd.DataFrame(against.measured("henon-heiles:box")[against.TABLE])
    assert set(rows["error"]) == {0.25}
    for side, orbits in (("heyoka", 128), ("ours", 512)):
        part = rows[rows["side"] == side]
        assert set(part["orbits"]) == {orbits}
        np.testing.assert_allclose(part["us"], 1e6 / orbits, rtol=1e-12)
    assert list(rows.loc[rows["side"] == "heyoka", "tol"]) == list(against.TOLERANCES)


@pytest.mark.parametrize("heyoka", [[], [rung("heyoka", 1.0, 1.0)]], ids=["not run", "not there"])
def test_a_side_that_does_not_get_there_is_nobody(heyoka):
    first = compare.compared(pd.DataFrame([rung("ours", 1e-3, 2.0), *heyoka])).iloc[0]
    assert (first["error"], first["ours"], first["us, ours"]) == (0.1, "ours", 2.0)
    assert first["heyoka"] == ""
    assert np.isnan(first["ours / heyoka"])


def beside(*rows):
    return told(page.beside_heyoka, **{against.TABLE: rows})


def test_whose_orbit_is_cheaper_follows_the_costs():
    n = sum(error >= 2.0**-44 for error in compare.ERRORS)
    ahead = beside(*ladder("ours", 1.0), *ladder("heyoka", 2.0))
    assert ahead.holds
    assert f"cheaper than in heyoka's in {n} of {n} cells, in 0 the intervals overlap; behind nowhere." in ahead.text
    behind = beside(*ladder("ours", 2.0), *ladder("heyoka", 1.0))
    assert not behind.holds
    assert f"in 0 of {n} cells" in behind.text
    assert "behind on p from 0.1 (2 to 2 times)." in behind.text
    tied = beside(*ladder("ours", 1.01), *ladder("heyoka", 1.0))
    assert tied.holds
    assert f"in {n} the intervals overlap" in tied.text


def test_how_far_behind_is_a_range():
    # By the power laws 2 error^(-1/3) and error^(-1/4), from 1e-1 to 1e-9.
    said = beside(*ladder("ours", 2.0, order=3), *ladder("heyoka", 1.0))
    assert "behind on p from 0.1 (2.4 to 11 times, or not reached)." in said.text
    rows = [*ladder("ours", 1.0), *ladder("heyoka", 2.0)]
    assert list(told(page.whole, **{against.TABLE: rows})["cheaper"]) == ["ours"] * len(compare.ERRORS)


def test_problems_are_named_in_the_order_of_the_table():
    rows = [r | {"problem": name} for name in ("z", "a") for r in (*ladder("ours", 2.0), *ladder("heyoka", 1.0))]
    assert "behind on z from 0.1 (2 to 2 times) and a from 0.1 (2 to 2 times)." in beside(*rows).text


def test_the_table_shows_what_a_step_costs():
    columns = dict.fromkeys(("ns scalar", "ns ensemble", "ns all cores", "speed-up, low", "speed-up, high"), 1.0)
    shown = told(page.table, **{lanes.TABLE: [step(f"{k:02d}", **columns) for k in range(30)]}).frame
    assert list(shown["method"]) == [f"{k:02d}" for k in range(25)]


def test_an_error_that_only_heyoka_reaches_is_behind():
    said = beside(*ladder("ours", 1.0)[:5], *ladder("heyoka", 2.0))
    assert not said.holds
    assert "not reached" in said.text


def test_the_bench_names_what_is_off():
    rows = [step(), step("b", status="diverged"), step("c", **{"largest difference": 1e-9})]
    assert [line.partition(" ")[0] for line in bench_ensembles.off(rows)] == ["b", "c"]


def test_maps_start_on_the_plane_at_their_energy():
    Q, P = maps.scattered(50)
    energy = (P**2).sum(1) / 2 + (Q**2).sum(1) / 2 + Q[:, 0] ** 2 * Q[:, 1] - Q[:, 1] ** 3 / 3
    np.testing.assert_allclose(energy, maps.ENERGY, rtol=1e-14)
    assert (Q[:, 0] == 0).all()
    assert (P[:, 0] > 0).all()
