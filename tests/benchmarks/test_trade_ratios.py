"""Ours over the best peer: shares, reasons and sentences on tables for which they must change, both ways."""

from __future__ import annotations

from math import inf

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.trade import front, ratios_page, reasons
from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.problems.questions import QUESTIONS

SCENE = "toda"


def row(accuracy=1e-6, steps=(100, 50), seconds=(1e-5, 2e-5), spread=0.01, evaluations=800, scene=SCENE, **more):
    """A choice of ours (first) and the best peer's; a side whose steps are None does not get there."""
    out = {"scene": scene, "quantity": "end-state", "accuracy": accuracy}
    for side, n, s in zip((OURS, PEERS), steps, seconds, strict=True):
        known = {"integrator": f"one of {side}", "h": 0.1, "tol": np.nan, "steps": n, "seconds": s}
        out |= {f"{side} {k}": v if n is not None else np.nan for k, v in known.items()}
    out[f"{OURS} evaluations"] = evaluations
    both = None not in steps
    ratio = seconds[0] / seconds[1] if both else np.nan
    out |= {"ratio": ratio, "ratio low": ratio * (1 - spread), "ratio high": ratio * (1 + spread)}
    return out | more


def runs(price=1e-9, error=1e-9, scene=SCENE, kind="phasebench"):
    """A run of 1000 evaluations, each at that price."""
    told = {"integrator": "gauss-4", "kind": kind, "evaluations": 1000, "seconds": 1000 * price, "error": error}
    return pd.DataFrame([{"scene": scene} | told])


def data(*rows, rungs=None):
    return {front.CHOICES: pd.DataFrame(rows), front.RUNGS: runs() if rungs is None else rungs}.get


def one(**given):
    """The only cell that is above 1."""
    found = reasons.above(pd.DataFrame([row(**given)]), runs(1e-8))
    assert len(found) == 1
    return found.iloc[0]


#: 800 evaluations at 1e-8 s are 8 of our 10 us.
CASES = {
    reasons.UNREACHED: {"steps": (None, 50)},
    reasons.WITHIN: {"seconds": (1e-5, 9.95e-6)},
    reasons.REST: {"seconds": (1e-5, 9e-6)},
    reasons.MORE: {"seconds": (1e-5, 5e-6), "steps": (100, 50)},
    reasons.DEARER: {"seconds": (1e-5, 5e-6), "steps": (50, 50)},
    reasons.BOTH: {"seconds": (1e-5, 2.5e-6), "steps": (100, 50)},
}


@pytest.mark.parametrize("reason", CASES)
def test_each_reason_where_it_is_so(reason):
    found = one(**CASES[reason])
    assert found["reason"] == reason
    said = reasons.told(found.to_dict(), runs())
    assert said.startswith(reason)
    told = ratios_page.why(data(row(**CASES[reason]), rungs=runs(1e-8)))
    assert told.holds
    assert f"Of 1 cells above 1.0: 1 {reason} ({reasons.MEANING[reason]})" in told.text


def test_two_factors_a_little_above_one_are_named_together():
    assert one(seconds=(1.1e-5, 1e-5), steps=(105, 100), evaluations=1100)["reason"] == reasons.BOTH


def test_the_factors_multiply_to_the_ratio_and_the_share_is_of_the_cheapest_price():
    found = one(seconds=(1e-5, 4e-6))
    assert found["steps"] == 2
    assert found["steps"] * found["step"] == pytest.approx(found["ratio"]) == pytest.approx(2.5)
    assert found["per step"] == 8
    assert found["share"] == pytest.approx(0.8)
    assert found["evaluations alone"] == pytest.approx(2.0)
    rungs = pd.concat([runs(1e-8), runs(2e-9, kind="rebound"), runs(3e-9, scene="kepler-orbit"), runs(5e-9)])
    assert reasons.price(rungs[rungs["scene"] == SCENE]) == pytest.approx(5e-9)


def test_a_cell_that_the_rows_do_not_explain_is_a_finding():
    """A peer that tells no steps: the ratio has no factors."""
    given = row(seconds=(1e-5, 5e-6), steps=(100, 0))
    said = ratios_page.why(data(given, rungs=runs(1e-8)))
    assert not said.holds
    assert "1 is not explained by the rows" in said.text
    assert said.short == "0 of 1 cells above are explained."


def test_what_is_no_slower_needs_no_reason():
    assert reasons.above(pd.DataFrame([row(), row(1e-8, steps=(100, None))]), runs()).empty
    assert ratios_page.why(data(row())) is None
    assert ratios_page.table(data(row())) is None
    for verdict in ratios_page.PAGE.verdicts:
        assert verdict({}.get) is None


def test_growth_is_since_the_last_accuracy_that_was_fast_enough():
    rows = [
        row(1e-3, (10, 20)),
        row(1e-4, (20, 25)),
        row(1e-5, (40, 25), (2e-5, 1e-5)),
        row(1e-6, (80, 30), (3e-5, 1e-5)),
    ]
    found = reasons.above(pd.DataFrame(rows), runs()).set_index("accuracy")
    assert found.index.tolist() == [1e-6, 1e-5]
    assert (found["until"] == 1e-4).all()
    assert found.loc[1e-6, "ours grew"] == 4
    assert found.loc[1e-6, "peer grew"] == pytest.approx(1.2)
    said = ratios_page.why(data(*rows)).text
    assert "its steps grow 3 times in the median, the peer's 1.1 times" in said
    assert "steps grow" not in ratios_page.why(data(*rows[2:])).text


def test_where_ours_end_is_said_of_a_cell_that_is_not_reached():
    told = reasons.told(one(steps=(None, 50)).to_dict(), runs(error=3e-12))
    assert told == "not reached: ours end at 3.0e-12 (gauss-4)"
    assert "no run of ours" in reasons.told(one(steps=(None, 50)).to_dict(), runs(kind="heyoka"))


# -- the sentences -----------------------------------------------------------------------------------------------------


def scenes(slow: int, every=QUESTIONS):
    """Every scene at ten accuracies; so many cells are slow."""
    rows = [row(10.0**-k, scene=q.id) for q in every for k in range(1, 11)]
    return rows[slow:] + [r | {"ratio": 2.0, "ratio low": 1.9, "ratio high": 2.1} for r in rows[:slow]]


@pytest.mark.parametrize(("slow", "holds"), [(0, True), (18, True), (19, False)])
def test_nineteen_of_twenty_cells_are_wanted(slow, holds):
    """370 cells: 18 are 4.9 %, 19 are 5.1 %."""
    said = ratios_page.share(data(*scenes(slow)))
    assert said.holds == holds
    assert f"in {370 - slow} of 370 cells" in said.text


def test_a_scene_that_was_not_measured_is_a_finding():
    said = ratios_page.share(data(*scenes(0, QUESTIONS[1:])))
    assert not said.holds
    assert f"{len(QUESTIONS) - 1} of {len(QUESTIONS)} scenes are measured; not {QUESTIONS[0].id}." in said.text


def test_cells_of_one_side_count_and_those_of_none_do_not():
    found = reasons.cells(pd.DataFrame([row(), row(steps=(None, 5)), row(steps=(5, None)), row(steps=(None, None))]))
    assert found["ratio"].tolist() == [0.5, inf, 0.0]
    assert "in 2 of 3 cells" in ratios_page.share(data(row(), row(steps=(None, 5)), row(steps=(5, None)))).text


def test_a_median_below_one_with_an_interval_above_it_is_not_certain():
    said = ratios_page.share(data(row(), row(seconds=(1.0, 1.005)))).text
    assert "in 2 of 2 cells (100.0 %)" in said
    assert "in 1 with the whole interval" in said


def test_until_which_accuracy_the_share_is_as_wanted():
    good = [row(10.0**-k, scene=s) for k in (1, 2, 3) for s in ("toda", "duffing")]
    assert ratios_page.until(data(*good)).holds
    assert "at every accuracy." in ratios_page.until(data(*good)).text
    bad = ratios_page.until(data(*good[:-1], row(1e-3, seconds=(2.0, 1.0), scene="duffing")))
    assert not bad.holds
    assert "at least 95 % down to 0.01, and least at 0.001 with 50 %" in bad.text
    assert "Slower anywhere: duffing (1)." in bad.text
    late = ratios_page.until(data(row(1e-1, seconds=(2.0, 1.0)), row(1e-2)))
    assert "not even at the coarsest accuracy, and least at 0.1 with 0 %" in late.text


def test_the_table_has_the_worst_of_every_scene_first(tmp_path):
    rows = [row(10.0**-k, seconds=(1e-5 * k, 1e-6), scene=q.id) for q in QUESTIONS[:10] for k in range(1, 5)]
    given = data(*rows, rungs=pd.concat([runs(1e-8, scene=q.id) for q in QUESTIONS[:10]]))
    shown = ratios_page.table(given).frame
    assert len(shown) == 25
    assert shown["scene"].nunique() == 10
    assert shown["ratio"].str.startswith("40 ").sum() == 10
    assert len(ratios_page.PAGE.whole(given)) == 40
    (picture,) = ratios_page.draw(given, tmp_path)
    assert (tmp_path / picture.file).stat().st_size > 5000


# -- on the line, of several ------------------------------------------------------------------------------------------


def test_exactly_as_long_is_no_longer():
    assert reasons.above(pd.DataFrame([row(seconds=(1e-5, 1e-5))]), runs()).empty
    share = ratios_page.share(data(row(seconds=(1e-5, 1e-5), spread=0.0))).text
    assert "in 1 of 1 cells (100.0 %)" in share
    assert "in 1 with the whole interval" in share


def test_a_share_of_just_nineteen_in_twenty_is_enough():
    scenes_ = [f"s{k}" for k in range(20)]
    rows = [row(10.0**-a, scene=s) for a in range(1, 6) for s in scenes_]
    slow = [row(1e-4, seconds=(2.0, 1.0), scene=scenes_[0]), row(1e-5, seconds=(2.0, 1.0), scene=scenes_[0])]
    kept = [r for r in rows if (r["accuracy"], r["scene"]) not in {(1e-4, "s0"), (1e-5, "s0")}]
    assert ratios_page.until(data(*kept, *slow)).holds
    more = row(1e-5, seconds=(2.0, 1.0), scene="s1")
    kept = [r for r in kept if (r["accuracy"], r["scene"]) != (1e-5, "s1")]
    said = ratios_page.until(data(*kept, *slow, more))
    assert not said.holds
    assert said.text.startswith("The share is at least 95 % down to 0.0001, and least at 1e-05 with 90 %")
    assert said.text.endswith("Slower anywhere: s0 (2) and s1 (1).")


def test_cells_that_are_not_explained_are_counted_and_those_within_do_not_grow():
    unknown = [row(10.0**-k, seconds=(1e-5, 5e-6), steps=(100, 0)) for k in (5, 6)]
    said = ratios_page.why(data(*unknown, rungs=runs(1e-8)))
    assert "2 are not explained by the rows" in said.text
    within = row(1e-6, (90, 20), (1e-5, 9.99e-6))
    grown = ratios_page.why(data(row(1e-5, (10, 20)), within, row(1e-7, (40, 60), (1e-5, 2e-6)), rungs=runs(1e-8)))
    assert "its steps grow 4 times in the median, the peer's 3 times" in grown.text


def test_the_parts_of_a_cell_are_told_with_its_growth():
    rows = pd.DataFrame([row(1e-5, (10, 20)), row(1e-6, (40, 30), (1e-5, 2.5e-6))])
    (found,) = reasons.above(rows, runs(1e-8)).to_dict("records")
    assert reasons.told(found, runs()) == (
        "more and dearer steps: steps x 1.3, a step's time x 3; evaluations 80 %; steps since 1e-05 x 4 and 1.5"
    )
    nowhere = reasons.told(found | {"ours grew": np.nan, "share": np.nan}, runs())
    assert nowhere == "more and dearer steps: steps x 1.3, a step's time x 3"
    exact = pd.concat([runs(error=0.0), runs(error=2e-11)])
    assert reasons.told(one(steps=(None, 50)).to_dict(), exact) == "not reached: ours end at 2.0e-11 (gauss-4)"


def test_evaluations_that_would_take_just_as_long_leave_the_rest_to_blame():
    """800 of them at 1.25e-8 s are all of our 10 us; at half that price they are what the peer takes."""
    assert reasons.above(pd.DataFrame([row(seconds=(1e-5, 5e-6))]), runs(6.25e-9)).iloc[0]["reason"] == reasons.REST


def test_cells_that_are_as_bad_stand_as_they_come():
    rows = pd.DataFrame([row(seconds=(2.0, 1.0), scene=s) for s in ("z", "a", "m")])
    found = reasons.above(rows, runs())
    assert found["scene"].tolist() == ["z", "a", "m"]
    assert found.index.tolist() == [0, 1, 2]
    assert "index" not in found
    assert "index" not in reasons.cells(rows)


def test_the_table_says_who_at_which_size_and_who_is_alone():
    rows = [row(1e-6, seconds=(3e-5, 1e-5)), row(1e-7, steps=(None, 50)), row(1e-3, steps=(50, None))]
    rows[0] |= {f"{PEERS} h": np.nan, f"{PEERS} tol": 1e-9}
    given = data(*rows, rungs=runs(1e-8))
    shown = ratios_page.table(given).frame
    assert shown[["ours", "peer", "ratio"]].to_numpy().tolist() == [
        ["none", "one of peer, h 0.1", "peer alone"],
        ["one of ours, h 0.1", "one of peer, tol 1.00e-09", "3 [2.97, 3.03]"],
    ]
    whole = ratios_page.PAGE.whole(given)
    assert [bool(w) for w in whole["why"]] == [True, True, False]
    many = data(*(row(scene=f"s{k}", seconds=(100.0 - k, 1.0)) for k in range(30)))
    assert ratios_page.table(many).frame["scene"].tolist() == [f"[s{k}](trade-s{k}.md)" for k in range(25)]
