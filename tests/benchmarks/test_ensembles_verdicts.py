"""The page on ensembles: its verdicts follow from fabricated rows, passing and failing."""

from __future__ import annotations

import re
import time

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.ensembles import against, bench_ensembles, ceiling, compare, lanes, maps, page
from phasebench.benchmarks.ladder.costs import at
from phasebench.benchmarks.page.verdict import FINDING, PASS, Count
from phasebench.integrators.registry import method
from support.pages import frame, judge


def step(method="verlet", gain=4.0, spread=0.5, speed_up=1.9, **more) -> dict:
    """A fabricated row: the gain (+- spread) of SIMD lanes over one orbit at a time, and the speed-up on all cores."""
    row = {"problem": "p", "method": method, "in lanes": True, "status": "ok", "cores": 2, "speed-up": speed_up}
    row |= {"gain": gain, "gain, low": gain - spread, "gain, high": gain + spread, "largest difference": 0.0}
    return row | more


def gain(*rows):
    """The page's verdict on the gain of SIMD lanes, from fabricated rows."""
    return judge(page.gain, lanes.TABLE, *rows)


def test_lanes_without_a_certain_gain_are_a_finding():
    others = [step("c", 0.9, **{"in lanes": False}), step("d", 0.9, status="diverged")]
    said = gain(step("a", 3.0), step("b", 5.0), *others)
    assert (said.outcome, said.measured) == (PASS, Count(2, 2))
    assert said.where.startswith("a, p: 3 ")
    slow = gain(step("a", 3.0), step("b", 1.3))
    assert (slow.outcome, slow.measured) == (FINDING, Count(1, 2))
    assert slow.where.startswith("b, p: 1.3 ")
    assert gain(step(**{"in lanes": False})) is None
    assert gain(step(gain=1.5, spread=0.5)).outcome == FINDING
    assert gain(step(gain=1.5, spread=0.4)).outcome == PASS


@pytest.mark.parametrize(
    ("slowest", "bare", "wanted", "holds"),
    [(1.8, None, 1.8, True), (1.79, None, 1.8, False), (1.79, 2.0, 1.8, False), (1.53, 1.6, 1.52, True)]
    + [(1.51, 1.6, 1.52, False), (np.nan, 2.0, 1.8, False)],
)
def test_speed_up_on_cores_against_the_ceiling(slowest, bare, wanted, holds):
    rows = [step(), step("b", speed_up=slowest)]
    rows += [] if bare is None else [step(lanes.CEILING, problem="", speed_up=bare, **{"in lanes": False})]
    said = judge(page.parallel, lanes.TABLE, *rows)
    assert said.outcome == (PASS if holds else FINDING)
    assert said.expected.low == pytest.approx(wanted)
    assert (said.measured.high, said.where) == (1.9, "b, p")
    assert judge(page.parallel, lanes.TABLE, step(status="diverged")) is None


def test_answer_has_the_gains_and_the_cheaper_orbits():
    tables = {lanes.TABLE: frame(step("a", 3.0), step("b", 5.0)), against.TABLE: frame(*ladder("ours", 1.0))}
    said = page.answer(tables.get)
    n = sum(error >= 2.0**-44 for error in compare.ERRORS)
    assert re.findall(r"[\d.]*\d", said) == [str(lanes.ORBITS), "3", "5", str(n), str(n), "0"]
    assert judge(page.answer, lanes.TABLE, step()) is None


def test_speed_up_of_a_bare_loop_on_one_and_two_threads():
    assert ceiling.speed_up(1, 3, 20_000).value == pytest.approx(1, abs=0.7)
    assert 0.2 < ceiling.speed_up(2, 3, 200_000).value < 2.6


def test_speed_up_counts_the_work_of_every_thread(monkeypatch):
    """Three threads that sleep at once do three times the work of one in the same time."""
    monkeypatch.setattr(ceiling, "compile_loop", lambda: lambda *_: time.sleep(0.05))
    assert 2 < ceiling.speed_up(3, 3).value < 5


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
    assert at(rungs, 1e-30) is compare.NOWHERE


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


def test_compared_errors_reach_round_off():
    np.testing.assert_allclose(np.diff(np.log10(compare.ERRORS)), [-2, -2, -2, -2, -1, -1, -1], rtol=1e-12)
    assert 1e-10 in compare.ERRORS
    assert compare.ERRORS[-1] == 1e-12


def test_tolerances_are_a_factor_of_ten_apart():
    np.testing.assert_allclose(np.diff(np.log10(against.TOLERANCES[:-1])), -1, rtol=1e-12)
    assert 1e-10 in against.TOLERANCES
    assert against.TOLERANCES[-2] / 10 < against.TOLERANCES[-1] == np.finfo(float).eps


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
    rows = pd.DataFrame(against.measure_rows("henon-heiles:box")[against.TABLE])
    assert set(rows["error"]) == {0.25}
    for side, orbits in (("heyoka", 128), ("ours", 512)):
        part = rows[rows["side"] == side]
        assert set(part["orbits"]) == {orbits}
        np.testing.assert_allclose(part["us"], 1e6 / orbits, rtol=1e-12)
    assert list(rows.loc[rows["side"] == "heyoka", "tol"]) == list(against.TOLERANCES)


@pytest.mark.parametrize("heyoka", [[], [rung("heyoka", 1.0, 1.0)]], ids=["not run", "not there"])
def test_side_that_misses_the_error_has_no_name(heyoka):
    first = compare.cost_table(pd.DataFrame([rung("ours", 1e-3, 2.0), *heyoka])).iloc[0]
    assert (first["error"], first["ours"], first["us, ours"]) == (0.1, "ours", 2.0)
    assert first["heyoka"] == ""
    assert np.isnan(first["ours / heyoka"])


def beside(*rows):
    """The page's verdict on the comparison of ensembles with heyoka, from fabricated rows."""
    return judge(page.beside_heyoka, against.TABLE, *rows)


def test_cheaper_side_follows_the_costs():
    n = sum(error >= 2.0**-44 for error in compare.ERRORS)
    ahead = beside(*ladder("ours", 1.0), *ladder("heyoka", 2.0))
    assert (ahead.outcome, ahead.measured, ahead.where) == (PASS, Count(0, n), "")
    behind = beside(*ladder("ours", 2.0), *ladder("heyoka", 1.0))
    assert (behind.outcome, behind.measured) == (FINDING, Count(n, n))
    assert behind.where == "p from 0.1 (2 to 2 times)"
    tied = beside(*ladder("ours", 1.01), *ladder("heyoka", 1.0))
    assert (tied.outcome, tied.measured) == (PASS, Count(0, n))


def test_ratio_of_costs_is_a_range():
    # From the power laws 2 error^(-1/3) and error^(-1/4), between 1e-1 and 1e-9.
    said = beside(*ladder("ours", 2.0, order=3), *ladder("heyoka", 1.0))
    assert said.where == "p from 0.1 (2.4 to 11 times, or not reached)"
    rows = [*ladder("ours", 1.0), *ladder("heyoka", 2.0)]
    assert list(judge(page.full_table, against.TABLE, *rows)["cheaper"]) == ["ours"] * len(compare.ERRORS)


def test_problems_are_named_in_the_order_of_the_table():
    rows = [r | {"problem": name} for name in ("z", "a") for r in (*ladder("ours", 2.0), *ladder("heyoka", 1.0))]
    assert beside(*rows).where == "z from 0.1 (2 to 2 times) and a from 0.1 (2 to 2 times)"


def test_table_shows_the_cost_of_a_step():
    columns = dict.fromkeys(("ns scalar", "ns ensemble", "ns all cores", "speed-up, low", "speed-up, high"), 1.0)
    shown = judge(page.table, lanes.TABLE, *(step(f"{k:02d}", **columns) for k in range(30))).frame
    assert list(shown["method"]) == [f"{k:02d}" for k in range(25)]


def test_error_that_only_heyoka_reaches_counts_against_us():
    said = beside(*ladder("ours", 1.0)[:5], *ladder("heyoka", 2.0))
    assert said.outcome == FINDING
    assert "not reached" in said.where


def test_bench_names_faulty_rows():
    rows = [step(), step("b", status="diverged"), step("c", **{"largest difference": 1e-9})]
    assert [line.partition(" ")[0] for line in bench_ensembles.off(rows)] == ["b", "c"]


def test_starts_of_maps_lie_on_the_plane_at_their_energy():
    Q, P = maps.random_starts(50)
    energy = (P**2).sum(1) / 2 + (Q**2).sum(1) / 2 + Q[:, 0] ** 2 * Q[:, 1] - Q[:, 1] ** 3 / 3
    np.testing.assert_allclose(energy, maps.ENERGY, rtol=1e-14)
    assert (Q[:, 0] == 0).all()
    assert (P[:, 0] > 0).all()
