"""Ratios of the best method's time to the best peer's: their shares, the reasons told, verdicts that pass and fail."""

from __future__ import annotations

import re
from math import inf

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.trade import front, ratios_page, reasons
from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.page.verdict import FINDING, PASS, Count, Range
from phasebench.benchmarks.problems.questions import QUESTIONS

SCENE = "toda"


def row(accuracy=1e-6, steps=(100, 50), seconds=(1e-5, 2e-5), spread=0.01, evaluations=800, scene=SCENE, **more):
    """A fabricated row of the trade-off at one accuracy; pairs are (our best method, the best peer).

    A side whose steps are None does not reach the accuracy.
    """
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
    """A fabricated table of one run with 1000 gradient evaluations that take ``price`` seconds each."""
    told = {"integrator": "gauss-4", "kind": kind, "evaluations": 1000, "seconds": 1000 * price, "error": error}
    return pd.DataFrame([{"scene": scene} | told])


def data(*rows, rungs=None):
    return {front.CHOICES: pd.DataFrame(rows), front.RUNGS: runs() if rungs is None else rungs}.get


def one(**given):
    """The reason found for a fabricated row in which our method takes longer than the peer's."""
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
def test_each_reason_has_its_case(reason):
    found = one(**CASES[reason])
    assert found["reason"] == reason
    assert reasons.sentence(found.to_dict(), runs()).startswith(reason)
    said = ratios_page.explanations(data(row(**CASES[reason]), rungs=runs(1e-8)))
    assert (said.outcome, said.measured) == (PASS, Count(1, 1))


def test_two_factors_slightly_above_one_are_combined():
    assert one(seconds=(1.1e-5, 1e-5), steps=(105, 100), evaluations=1100)["reason"] == reasons.BOTH


def test_factors_multiply_to_the_ratio():
    found = one(seconds=(1e-5, 4e-6))
    assert found["steps"] == 2
    assert found["steps"] * found["step"] == pytest.approx(found["ratio"]) == pytest.approx(2.5)
    assert found["per step"] == 8
    assert found["share"] == pytest.approx(0.8)
    assert found["evaluations alone"] == pytest.approx(2.0)
    rungs = pd.concat([runs(1e-8), runs(2e-9, kind="rebound"), runs(3e-9, scene="kepler-orbit"), runs(5e-9)])
    assert reasons.price(rungs[rungs["scene"] == SCENE]) == pytest.approx(5e-9)


def test_unexplained_cell_is_a_finding():
    """A peer that reports no number of steps: the ratio of times cannot be split into factors."""
    rows = [row(10.0**-k, seconds=(1e-5, 5e-6), steps=(100, 0)) for k in (5, 6)]
    said = ratios_page.explanations(data(*rows, row(1e-7, seconds=(1e-5, 5e-6)), rungs=runs(1e-8)))
    assert (said.outcome, said.measured) == (FINDING, Count(1, 3))
    assert said.where == f"{SCENE} to 1e-05, {SCENE} to 1e-06"


def test_cells_that_are_no_slower_need_no_reason():
    assert reasons.above(pd.DataFrame([row(), row(1e-8, steps=(100, None))]), runs()).empty
    assert ratios_page.explanations(data(row())) is None
    assert ratios_page.table(data(row())) is None
    for verdict in ratios_page.PAGE.verdicts:
        assert verdict({}.get) is None
    assert ratios_page.answer({}.get) is None


def test_growth_is_counted_from_the_last_fast_accuracy():
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
    assert reasons.above(pd.DataFrame(rows[2:]), runs())["ours grew"].isna().all()


def test_unreached_cell_names_our_smallest_error():
    told = reasons.sentence(one(steps=(None, 50)).to_dict(), runs(error=3e-12))
    assert told == "not reached: ours end at 3.0e-12 (gauss-4)"
    assert "no run of ours" in reasons.sentence(one(steps=(None, 50)).to_dict(), runs(kind="heyoka"))


# -- the verdicts ------------------------------------------------------------------------------------------------------


def scenes(slow: int, every=QUESTIONS):
    """Fabricated rows of every scene at ten accuracies; in the first ``slow`` rows ours takes twice the peer's time."""
    rows = [row(10.0**-k, scene=q.id) for q in every for k in range(1, 11)]
    return rows[slow:] + [r | {"ratio": 2.0, "ratio low": 1.9, "ratio high": 2.1} for r in rows[:slow]]


CELLS = 10 * len(QUESTIONS)
FEW = CELLS // 20


@pytest.mark.parametrize(("slow", "outcome"), [(0, PASS), (FEW, PASS), (FEW + 1, FINDING)])
def test_95_percent_of_cells_must_be_no_slower(slow, outcome):
    """``FEW`` slower pairs (scene, accuracy) are at most 5 % of all, one more is above."""
    said = ratios_page.share(data(*scenes(slow)))
    assert (said.outcome, said.measured) == (outcome, Count(CELLS - slow, CELLS))
    assert said.where.partition(":")[0] == (QUESTIONS[0].id if slow else "")


def test_unmeasured_scene_is_a_finding():
    given = data(*scenes(0, QUESTIONS[1:]))
    found = [verdict(given) for verdict in ratios_page.PAGE.verdicts]
    assert [v.measured for v in found if v is not None and v.outcome == FINDING] == [
        Count(len(QUESTIONS) - 1, len(QUESTIONS))
    ]


def test_cells_of_one_side_count():
    found = reasons.cells(pd.DataFrame([row(), row(steps=(None, 5)), row(steps=(5, None)), row(steps=(None, None))]))
    assert found["ratio"].tolist() == [0.5, inf, 0.0]
    said = ratios_page.share(data(row(), row(steps=(None, 5)), row(steps=(5, None))))
    assert said.measured == Count(2, 3)


def test_share_is_judged_at_every_accuracy():
    good = [row(10.0**-k, scene=s) for k in (1, 2, 3) for s in ("toda", "duffing")]
    assert ratios_page.everywhere(data(*good)).outcome == PASS
    bad = ratios_page.everywhere(data(*good[:-1], row(1e-3, seconds=(2.0, 1.0), scene="duffing")))
    assert (bad.outcome, bad.measured) == (FINDING, Range(0.5, 1.0))
    assert "0.001" in bad.where
    late = ratios_page.everywhere(data(row(1e-1, seconds=(2.0, 1.0)), row(1e-2)))
    assert (late.outcome, late.measured) == (FINDING, Range(0.0, 1.0))


def test_answer_counts_slower_and_certainly_slower_cells():
    within = row(1e-6, seconds=(1e-5, 9.95e-6), scene="duffing")
    alone, slow = row(1e-7, steps=(None, 50)), row(1e-5, seconds=(2.0, 1.0))
    numbers = [int(n) for n in re.findall(r"\d+", ratios_page.answer(data(row(), within, alone, slow)))]
    assert numbers == [3, 4, 2]


def test_table_has_the_worst_cell_of_every_scene_first(tmp_path):
    rows = [row(10.0**-k, seconds=(1e-5 * k, 1e-6), scene=q.id) for q in QUESTIONS[:10] for k in range(1, 5)]
    given = data(*rows, rungs=pd.concat([runs(1e-8, scene=q.id) for q in QUESTIONS[:10]]))
    shown = ratios_page.table(given).frame
    assert len(shown) == 25
    assert shown["scene"].nunique() == 10
    assert shown["ratio"].str.startswith("40 ").sum() == 10
    assert len(ratios_page.PAGE.whole(given)) == 40
    (picture,) = ratios_page.draw(given, tmp_path)
    assert (tmp_path / picture.file).stat().st_size > 5000


# -- thresholds, several cells ----------------------------------------------------------------------------------------


def test_equal_time_is_no_slower():
    assert reasons.above(pd.DataFrame([row(seconds=(1e-5, 1e-5))]), runs()).empty
    assert ratios_page.share(data(row(seconds=(1e-5, 1e-5), spread=0.0))).measured == Count(1, 1)


def test_share_of_exactly_95_percent_passes():
    scenes_ = [f"s{k}" for k in range(20)]
    rows = [row(10.0**-a, scene=s) for a in range(1, 6) for s in scenes_]
    slow = [row(1e-4, seconds=(2.0, 1.0), scene=scenes_[0]), row(1e-5, seconds=(2.0, 1.0), scene=scenes_[0])]
    kept = [r for r in rows if (r["accuracy"], r["scene"]) not in {(1e-4, "s0"), (1e-5, "s0")}]
    said = ratios_page.everywhere(data(*kept, *slow))
    assert (said.outcome, said.measured) == (PASS, Range(0.95, 1.0))
    more = row(1e-5, seconds=(2.0, 1.0), scene="s1")
    kept = [r for r in kept if (r["accuracy"], r["scene"]) != (1e-5, "s1")]
    said = ratios_page.everywhere(data(*kept, *slow, more))
    assert (said.outcome, said.measured) == (FINDING, Range(0.9, 1.0))
    assert "1e-05" in said.where
    assert ratios_page.share(data(*kept, *slow, more)).where.startswith("s0: slower in 2 ")


def test_text_of_a_cell_has_its_factors_and_growth():
    rows = pd.DataFrame([row(1e-5, (10, 20)), row(1e-6, (40, 30), (1e-5, 2.5e-6))])
    (found,) = reasons.above(rows, runs(1e-8)).to_dict("records")
    assert reasons.sentence(found, runs()) == (
        "more and dearer steps: steps x 1.3, a step's time x 3; evaluations 80 %; steps since 1e-05 x 4 and 1.5"
    )
    nowhere = reasons.sentence(found | {"ours grew": np.nan, "share": np.nan}, runs())
    assert nowhere == "more and dearer steps: steps x 1.3, a step's time x 3"
    exact = pd.concat([runs(error=0.0), runs(error=2e-11)])
    assert reasons.sentence(one(steps=(None, 50)).to_dict(), exact) == "not reached: ours end at 2.0e-11 (gauss-4)"


def test_evaluations_equal_to_the_peers_time():
    """Our 10 us are 800 evaluations at 1.25e-8 s; at half that price they alone take as long as the peer's run."""
    assert reasons.above(pd.DataFrame([row(seconds=(1e-5, 5e-6))]), runs(6.25e-9)).iloc[0]["reason"] == reasons.REST


def test_equal_cells_keep_their_order():
    rows = pd.DataFrame([row(seconds=(2.0, 1.0), scene=s) for s in ("z", "a", "m")])
    found = reasons.above(rows, runs())
    assert found["scene"].tolist() == ["z", "a", "m"]
    assert found.index.tolist() == [0, 1, 2]
    assert "index" not in found
    assert "index" not in reasons.cells(rows)


def test_table_names_integrators_and_their_step_sizes():
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
