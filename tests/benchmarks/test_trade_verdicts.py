"""The trade-off page: its verdicts, tables and figures follow from fabricated rows, passing and failing."""

from __future__ import annotations

import re
from itertools import product

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.trade import (
    again,
    bench_front,
    choice,
    figures,
    front,
    page,
    peer_rows,
    retime,
    scene_page,
    settled,
    sweep,
)
from phasebench.benchmarks.ladder import race
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.timing import NONE, OURS, PEERS, TIED
from phasebench.benchmarks.page.page import ROWS
from phasebench.benchmarks.page.verdict import FAIL, FINDING, MISSING, PASS, Count, Range
from phasebench.benchmarks.problems.questions import BY_ID, QUESTIONS
from phasebench.integrators.driver import Solution
from support.pages import judge

SCENE = "kepler-orbit"
SIDES = (OURS, PEERS)


def row(accuracy: float = 1e-3, ratio=(0.5, 0.4, 0.6), ours="gauss-5", peer="heyoka", scene=SCENE, **more) -> dict:
    """A fabricated row of the trade-off at one accuracy: our fastest method and the fastest peer.

    ``ratio`` is the ratio of their times (median, low, high); a side is None if it does not reach the accuracy.
    """
    about = {"scene": scene, "problem": "kepler", "quantity": "end-state", "t_end": 6.28, "accuracy": accuracy}
    about |= {"reference": "certified", "reference uncertainty": 1e-15}
    for side, name, seconds in ((OURS, ours, ratio[0]), (PEERS, peer, 1.0)):
        if name:
            told = {"integrator": name, "h": 0.1, "tol": np.nan, "steps": 60, "error": accuracy / 2, "seconds": seconds}
            about |= {f"{side} {k}": v for k, v in told.items()}
    if ours and peer:
        about |= dict(zip(("ratio", "ratio low", "ratio high"), ratio, strict=True))
    return about | more


LOSS, TIE = (2.0, 1.6, 2.5), (0.96, 0.9, 0.99)
CASES = {
    "ours": (row(), OURS),
    "a peer": (row(ratio=LOSS), PEERS),
    "ours, almost a tie": (row(ratio=(0.94, 0.93, 0.95)), OURS),
    "a tie": (row(ratio=TIE), TIED),
    "a tie, theirs": (row(ratio=(1.1, 1.04, 1.2)), TIED),
    "a tie, just": (row(ratio=(1.1, choice.TIE, 1.2)), TIED),
    "not certain": (row(ratio=(0.5, 0.1, 3.0)), TIED),
    "ours alone": (row(peer=None), OURS),
    "a peer alone": (row(ours=None), PEERS),
    "none": (row(ours=None, peer=None), NONE),
}


@pytest.mark.parametrize("name", CASES)
def test_cheaper_side(name):
    given, expected = CASES[name]
    found = choice.choices(pd.DataFrame([given]))
    assert found["cheaper"].tolist() == [expected]
    assert choice.counts(found) == tuple(int(expected == x) for x in (OURS, PEERS, TIED, NONE))
    outcome = {OURS: PASS, PEERS: FINDING}.get(expected, MISSING)
    for verdict in (page.wins, scene_page._wins(BY_ID[SCENE])):
        said = judge(verdict, front.CHOICES, given)
        assert said.outcome == outcome
        assert said.measured == Count(int(expected == OURS), int(expected in (OURS, PEERS)))
        assert bool(said.where) == (expected == PEERS)


def test_no_rows_no_verdict():
    for verdict in (*page.PAGE.verdicts, page.answer):
        assert verdict({}.get) is None
    other = {front.CHOICES: pd.DataFrame([row(scene="toda")])}.get
    made = scene_page.page_of(BY_ID[SCENE])
    assert all(v(other) is None for v in (*made.verdicts, made.answer))
    assert judge(page.farthest, front.CHOICES, row(ratio=TIE), row(peer=None)) is None


def test_half_of_the_decided_cases_must_be_won():
    rows = [row(1e-3), row(1e-6, LOSS), row(1e-9, TIE), row(1e-12, ours=None, peer=None)]
    said = judge(page.wins, front.CHOICES, *rows)
    assert (said.outcome, said.measured) == (PASS, Count(1, 2))
    worse = judge(page.wins, front.CHOICES, *rows, row(1e-4, LOSS))
    assert (worse.outcome, worse.measured) == (FINDING, Count(1, 3))
    assert worse.where == f"{SCENE} to 1e-06 and {SCENE} to 0.0001"


@pytest.mark.parametrize(("outside", "outcome"), [(0, PASS), (40, FAIL)])
def test_intervals_must_cover_90_percent_of_a_third_sweep(outside, outcome):
    rng = np.random.default_rng(1)
    keys = [
        {"scene": f"s{k}", "accuracy": 1e-3, "side": side, "integrator": side} for k in range(100) for side in SIDES
    ]
    finals = pd.DataFrame(keys).assign(seconds=1e-3 * np.exp(rng.normal(0, 0.1, 200)))
    second = finals.assign(sweep=2, seconds=1e-3 * np.exp(rng.normal(0, 0.1, 200)))
    third = finals.assign(sweep=3, seconds=1e-3)
    third.loc[third.index[:outside], "seconds"] = 1.0
    said = page.intervals({front.FINALS: finals, page.TIMES: pd.concat([second, third])}.get)
    assert said.outcome == outcome
    assert said.measured.low <= 1 - outside / 200
    assert said.where in ("times", "ratios")


def test_answers_count_wins_ties_and_the_fastest():
    rows = [row(1e-3), row(1e-4), row(1e-5, LOSS), row(1e-6, TIE), row(1e-7, (0.5, 0.4, 0.6), "gauss-8")]
    given = {front.CHOICES: pd.DataFrame(rows)}.get
    found = re.findall(r"in \d+(?: of \d+)?|; \d+|most often [\w-]+", page.answer(given))
    assert found == ["most often gauss-5", "in 3 of 5", "in 1", "; 1"]
    own = scene_page._answer(BY_ID[SCENE])
    assert re.findall(r"at \d|[\w-]+ for [\de.-]+\d", own(given)) == [
        "at 3",
        "at 1",
        "gauss-5 for 0.001",
        "gauss-8 for 1e-07",
    ]
    nobody = {front.CHOICES: pd.DataFrame([row(ours=None, peer=None)])}.get
    assert "0.001" in own(nobody)


def test_too_uncertain_reference_is_a_finding():
    reference, question = scene_page._reference(BY_ID[SCENE]), BY_ID[SCENE]
    whole = [row(a) for a in question.accuracies]
    n = len(whole)
    assert judge(reference, front.CHOICES, *whole).measured == Count(n, n)
    assert judge(reference, front.CHOICES, *whole).outcome == PASS
    less = judge(reference, front.CHOICES, *whole[:-2])
    assert (less.outcome, less.measured) == (FINDING, Count(n - 2, n))
    assert "1.0e-15" in less.where


def test_integrator_that_does_not_compile_is_a_finding():
    compiled, whys = scene_page._compilation(BY_ID[SCENE]), ["2.1 times as long as a", "3 times", "exact", None]

    def said(*reasons):
        rows = pd.DataFrame({"scene": SCENE, "integrator": "one", "why": list(reasons)})
        return compiled({front.DROPPED: rows}.get)

    assert (said(*whys).outcome, said(*whys).measured) == (PASS, Count(0, 4))
    broken = said(*whys, f"{race.UNCOMPILED}TypingError: called 2 times")
    assert (broken.outcome, broken.measured, broken.where) == (FINDING, Count(1, 5), "one")
    assert said(None, None) is None
    assert compiled({front.DROPPED: pd.DataFrame({"scene": [SCENE]})}.get) is None


def test_table_of_a_scene_has_both_sides():
    rows = [row(1e-6, ours=None), row(1e-3) | {f"{OURS} h": np.nan, f"{OURS} tol": 1e-5, f"{OURS} seconds": 0.002}]
    shown = scene_page._table(BY_ID[SCENE])({front.CHOICES: pd.DataFrame(rows)}.get).frame.to_dict("records")
    assert shown[0] == {
        "error up to": "1e-03",
        "ours": "gauss-5", "h or tol (ours)": "1.00e-05", "steps (ours)": "60", "ms (ours)": "2",
        "peer": "heyoka", "h or tol (peer)": "0.1", "steps (peer)": "60", "ms (peer)": "1000",
        "ratio": "0.5 [0.4, 0.6]", "cheaper": OURS,
    }  # fmt: skip
    assert [shown[1][name] for name in ("error up to", "ours", "ms (ours)", "steps (ours)", "ratio", "cheaper")] == [
        "1e-06", "none", "", "", "", PEERS,
    ]  # fmt: skip


def test_page_of_a_scene_is_linked_from_the_trade_page():
    assert not any(made.listed for made in scene_page.PAGES)
    alone = page.table({front.CHOICES: pd.DataFrame([row()])}.get).frame
    assert list(alone["scene"]) == [f"[{SCENE}](trade-{SCENE}.md)"]


def test_largest_difference_between_the_sides():
    near, far = row(), row(1e-6, (0.25, 0.2, 0.3), "gauss-4")
    lost = row(1e-9, LOSS, "gauss-8")
    said = judge(page.farthest, front.CHOICES, near, far, lost)
    assert (said.outcome, said.measured) == (PASS, Range(0.25, 2.0))
    assert said.where == f"{SCENE} to 1e-09: gauss-8 and heyoka"
    assert judge(page.farthest, front.CHOICES, near, row(1e-9, (2.1, 1.6, 2.5))).outcome == FINDING


def test_preserved_energy_does_not_count_as_a_lead():
    kept, other = ({"quantity": "energy", "ratio": (0.01, 0.01, 0.01), "ours": id} for id in ("avf", "gauss-4"))
    assert judge(page.farthest, front.CHOICES, row(), row(1e-6, **other)).measured == Range(0.01, 0.5)
    assert judge(page.farthest, front.CHOICES, row(), row(1e-6, **kept)).measured == Range(0.5, 0.5)


def test_table_has_a_scene_of_every_problem():
    rows = [row(1e-3), row(1e-6, LOSS), row(1e-9, TIE), row(1e-12, peer=None)]
    rows += [row(1e-3, scene=q.id) for q in QUESTIONS if q.id != SCENE]
    shown = page.table({front.CHOICES: pd.DataFrame(rows)}.get).frame
    assert len(shown) == min(len({q.problem.partition(":")[0] for q in QUESTIONS}), ROWS)
    line = shown[shown["scene"].str.contains(SCENE)].iloc[0]
    assert line["to 0.001"] == "gauss-5 (0.5)"
    assert line["to 1e-06"] == "heyoka (2)"
    assert line["to 1e-09"] == "gauss-5 (= 0.96)"
    assert line["to 1e-12"] == "gauss-5 (alone)"


# -- repeated sweeps ---------------------------------------------------------------------------------------------------


def finals(*members, scene=SCENE, accuracy=1e-3) -> list[dict]:
    """Fabricated rows of final timings at one accuracy, each from (integrator, median seconds, low, high)."""
    names = ("integrator", "seconds", "low", "high")
    return [{"scene": scene, "accuracy": accuracy} | dict(zip(names, m, strict=True)) for m in members]


A = ("a", 1.0, 0.9, 1.1)


def tables(cases: dict[tuple, dict[str, tuple[float, float]]], again_names: dict) -> dict[str, pd.DataFrame]:
    """The tables of joined sweeps and of a sweep made again.

    ``cases``: (scene, accuracy) -> integrator -> its seconds in the first and in the second sweep; a peer that takes
    ten times as long is added.  ``again_names``: (scene, accuracy) -> the fastest integrator of the sweep made again.
    """
    finals, times = [], []
    for (scene, accuracy), members in cases.items():
        for name, seconds in (members | {"peer": (10.0, 10.0)}).items():
            key = {"scene": scene, "accuracy": accuracy, "side": PEERS if name == "peer" else OURS, "integrator": name}
            finals.append(key | {"seconds": seconds[0]})
            times.append(key | {"seconds": seconds[1], "sweep": 2})
    second = [
        {"scene": scene, "accuracy": accuracy, "integrator": name, "seconds": seconds}
        for (scene, accuracy), first in again_names.items()
        for name, seconds in ((first, 1.0), ("slow", 9.0))
    ]
    return {front.FINALS: pd.DataFrame(finals), settled.TIMES: pd.DataFrame(times), again.TABLE: pd.DataFrame(second)}


CASE = (SCENE, 1e-3)


@pytest.mark.parametrize(
    ("members", "then", "expected"),
    [
        ({"a": (1.0, 1.0), "b": (2.0, 2.0)}, "a", (1, 1, 0)),
        ({"a": (1.0, 1.0), "b": (2.0, 2.0)}, "b", (1, 0, 0)),
        ({"a": (1.0, 1.0), "b": (1.04, 1.04)}, "b", (1, 0, 1)),
        ({"a": (1.0, 1.0), "b": (1.06, 1.06)}, "b", (1, 0, 0)),
        ({"a": (1.0, 1.0), "b": (1.3, 0.95)}, "b", (1, 0, 1)),
        ({"a": (1.0, 1.4), "b": (1.1, 1.1)}, "b", (1, 1, 0)),
        ({"a": (1.0, 1.0)}, "b", (1, 0, 0)),
    ],
    ids=["same", "apart", "within the factor", "just beyond it", "scattered", "joined winner", "no finalist"],
)
def test_sweeps_agree_on_the_winner_or_a_tie(members, then, expected):
    made = tables({CASE: members}, {CASE: then})
    assert settled.agreement(made[front.FINALS], made[settled.TIMES], made[again.TABLE])[:3] == expected
    said = page.twice(made.get)
    agreed = expected[1] + expected[2]
    assert (said.outcome, said.measured) == (PASS if agreed else FAIL, Count(agreed, 1))
    assert said.where == ("" if agreed else "kepler-orbit to 0.001 (a, then b)")


@pytest.mark.parametrize(("same", "outcome"), [(19, PASS), (18, FAIL)])
def test_two_sweeps_must_agree_in_19_of_20_cases(same, outcome):
    cases = [(SCENE, 10.0**-i) for i in range(20)]
    winners = dict(zip(cases, "a" * same + "b" * (20 - same), strict=True))
    said = page.twice(tables({case: {"a": (1.0, 1.0), "b": (2.0, 2.0)} for case in cases}, winners).get)
    assert (said.outcome, said.measured) == (outcome, Count(same, 20))
    assert ("to 1e-18 (a, then b)" in said.where) == (same == 18)


def test_single_measurement_is_no_pair():
    made = tables({CASE: {"a": (1.0, 1.0)}}, {("toda", 1e-3): "a"})
    assert settled.agreement(made[front.FINALS], made[settled.TIMES], made[again.TABLE]) == (0, 0, 0, ())


def test_repeated_scenes_are_cells():
    cells = bench_front.cells()
    assert bench_front.cells(quick=True) == []
    later = [(c.key["sweep"], c.key["scene"]) for c in cells if "sweep" in c.key]
    assert later == [(k, q.id) for k in retime.SWEEPS for q in QUESTIONS if retime.finals(q.id)]
    assert [c.key["scene"] for c in cells if "sweep" not in c.key] == [*again.scenes(), *(q.id for q in QUESTIONS)]
    assert len({c.id for c in cells}) == len(cells) == len(QUESTIONS) + again.COUNT + len(later)
    assert len({c.content for c in cells}) == len(cells)
    assert set(again.CHEAP) <= set(BY_ID)
    assert again.scenes() == again.scenes()


def test_repeated_sweep_is_independent(monkeypatch):
    """The rows of a repetition are the final timings of a complete sweep measured anew."""
    swept = []

    def measured(scene):
        swept.append(scene)
        return {front.FINALS: finals(A, scene=scene), front.CHOICES: []}

    monkeypatch.setattr(front, "measure_rows", measured)
    assert again.measure_rows(SCENE) == {again.TABLE: finals(A)}
    assert swept == [SCENE]


def test_missed_accuracy_fails_the_bench():
    good = {"accuracy": 1e-3, "error": 1e-4, "low": 1.0, "seconds": 1.1, "high": 1.2}
    bench_front.bench_front(lambda table: [good])
    for bad in ({"error": 2e-3}, {"seconds": 2.0}, {"low": 0.0}):
        with pytest.raises(AssertionError):
            bench_front.bench_front(lambda table, bad=bad: [good | bad])


# -- figures -----------------------------------------------------------------------------------------------------------


def test_figures_have_at_most_nine_curves(tmp_path, monkeypatch):
    drawn, save = [], figures.style.save
    monkeypatch.setattr(figures.style, "save", lambda figure, *where: drawn.append(figure) or save(figure, *where))
    names = [f"m{k}" for k in range(12)]
    rows = [
        {"scene": SCENE, "accuracy": 10.0**-k, "side": side, "integrator": n, "seconds": 1 + abs(k - i)}
        for (k, side) in product(range(1, 13), (OURS, PEERS))
        for i, n in enumerate(names)
    ]
    rungs = pd.DataFrame(
        {"scene": SCENE, "integrator": n, "error": 10.0**-k, "seconds": k, "steps": k}
        for n in names
        for k in range(1, 9)
    )
    picture = figures.work_precision(BY_ID[SCENE], pd.DataFrame(rows), rungs, tmp_path)
    assert [len(axes.lines) for axes in drawn[0].axes] == [9 + 1, 9], "beside the times, the front of all"
    assert (tmp_path / picture.file).stat().st_size > 5000
    every = choice.choices(pd.DataFrame([row(0.1), row(1e-2, LOSS), row(1e-3, peer=None)]))
    assert (tmp_path / figures.ratios(every, tmp_path).file).stat().st_size > 3000


# -- times of a sweep --------------------------------------------------------------------------------------------------


@pytest.fixture
def clock(monkeypatch):
    """A function that sets the run times, in milliseconds, that the next integrations report."""
    times: list[float] = []

    def told(run):
        def timed(*a, **k):
            s = run(*a, **k)
            return Solution(*(getattr(s, f) if f != "seconds" else times.pop(0) for f in s.__dataclass_fields__))

        return timed

    monkeypatch.setattr(Integrator, "run", told(Integrator.run))
    monkeypatch.setattr(sweep, "integrate", told(sweep.integrate))
    monkeypatch.setattr(peer_rows, "integrate_peer", told(peer_rows.integrate_peer))
    return lambda *milliseconds: times.extend(1e-3 * x for x in milliseconds)


def test_seconds_are_medians(clock):
    clock(77, 5, 1, 2)
    assert sweep.measure(sweep.Task("pendulum-t1000", "stormer-verlet", (), 0.05))["seconds"] == 2e-3
    # The run with rows, the second of a peer and the first of a method, does not count.
    clock(5, 77, 1, 2)
    assert sweep.measure(sweep.Task("pendulum-t1000", "heyoka", (), None, tol=1e-6))["seconds"] == 2e-3


def test_unmeasured_scenes_are_named():
    names = [q.id for q in QUESTIONS]
    few, every = pd.DataFrame({"scene": names[:-2] * 2}), pd.DataFrame({"scene": names})
    found = page.scenes_with_rows({front.CHOICES: few}.get)
    assert (found.outcome, found.measured) == (FINDING, Count(len(names) - 2, len(names)))
    assert all(name in found.where for name in names[-2:])
    assert page.scenes_with_rows({front.CHOICES: every}.get).outcome == PASS
