"""The trade's sentences, tables and figures follow their rows, both ways."""

from __future__ import annotations

from itertools import product

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.trade import (
    again,
    bench_front,
    choice,
    climb,
    figures,
    front,
    page,
    peer_rows,
    retime,
    scene_page,
    sweep,
)
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.timing import NONE, OURS, PEERS, TIED
from phasebench.benchmarks.problems.questions import BY_ID, QUESTIONS
from phasebench.integrators.driver import Solution

SCENE = "kepler-orbit"


def row(accuracy: float = 1e-3, ratio=(0.5, 0.4, 0.6), ours="gauss-5", peer="heyoka", scene=SCENE, **more) -> dict:
    """A choice; a side is None where it does not reach the accuracy."""
    about = {"scene": scene, "problem": "kepler", "quantity": "end-state", "t_end": 6.28, "accuracy": accuracy}
    about |= {"reference": "certified", "reference uncertainty": 1e-15}
    for side, name, seconds in ((OURS, ours, ratio[0]), (PEERS, peer, 1.0)):
        if name:
            told = {"integrator": name, "h": 0.1, "tol": np.nan, "steps": 60, "error": accuracy / 2, "seconds": seconds}
            about |= {f"{side} {k}": v for k, v in told.items()}
    if ours and peer:
        about |= dict(zip(("ratio", "ratio low", "ratio high"), ratio, strict=True))
    return about | more


def told(verdict, *rows: dict):
    """The verdict on these choices."""
    return verdict({front.CHOICES: pd.DataFrame(rows)}.get)


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
def test_who_is_the_cheaper(name):
    given, expected = CASES[name]
    found = choice.choices(pd.DataFrame([given]))
    assert found["cheaper"].tolist() == [expected]
    ours, peers, tied, none = (int(expected == x) for x in (OURS, PEERS, TIED, NONE))
    said = told(page.wins, given)
    assert said.holds == (ours >= peers)
    assert f"to 0.001 {ours}:{peers}" in said.text
    assert said.short == f"Cheapest: ours {ours}, a peer {peers}, ties {tied} of 1."
    assert ("reached by none" in said.text) == bool(none)
    own = scene_page._advice(BY_ID[SCENE])({front.CHOICES: pd.DataFrame([given])}.get)
    assert own.holds == (ours >= peers)
    assert f"are the cheaper at {ours}, the peers at {peers}" in own.text


def final_of(**intervals) -> pd.DataFrame:
    """A final: of each integrator the interval of its median, which is the lower end."""
    rows = [{"integrator": k, "seconds": low, "low": low, "high": high} for k, (low, high) in intervals.items()]
    return pd.DataFrame(rows).assign(scene=SCENE, accuracy=1e-3)


@pytest.mark.parametrize(
    ("second", "found"),
    [
        ({"c": (9.0, 9.9), "a": (1.0, 1.1), "b": (1.1, 1.2)}, (1, 1, 0)),
        ({"c": (9.0, 9.9), "a": (1.2, 1.3), "b": (1.1, 1.2)}, (1, 0, 1)),
        ({"c": (0.5, 0.6), "a": (1.2, 1.3), "b": (1.1, 1.2)}, (1, 0, 0)),
    ],
    ids=["same", "tied", "apart"],
)
def test_who_wins_twice_or_is_tied_in_either_final(second, found):
    first = final_of(c=(9.0, 9.9), a=(1.0, 1.1), b=(1.15, 1.2))
    assert choice.agreement(first, final_of(**second))[:3] == found
    assert choice.agreement(first.assign(scene="other"), final_of(**second))[:3] == (0, 0, 0)


def test_nothing_measured_is_nothing_said():
    for verdict in page.PAGE.verdicts:
        assert verdict({}.get) is None
    other = {front.CHOICES: pd.DataFrame([row(scene="toda")])}.get
    assert all(v(other) is None for v in scene_page.page_of(BY_ID[SCENE]).verdicts)
    assert told(page.farthest, row(ratio=TIE), row(peer=None)) is None


def test_the_score_at_an_accuracy_is_told_wherever_anything_was_measured():
    other = {"scene": "toda-orbit"}
    rows = [row(1e-3), row(1e-3, LOSS, **other), row(1e-6, TIE), row(1e-6, TIE, **other)]
    rows += [row(1e-9), row(1e-9, TIE, **other), row(1e-12, ours=None, peer=None), row(1e-1, LOSS), row(1e-1, TIE)]
    said = told(page.wins, *rows).text
    assert (
        "cheaper: to 0.001 1:1; to 1e-06 0:0 and 2 ties; to 1e-09 1:0 and 1 tie; to 1e-12 0:0. Of all 9 pairs" in said
    )
    assert said.endswith("2 to 2, 4 ties, 1 reached by none.")


@pytest.mark.parametrize("same", [19, 18])
def test_two_sweeps_agree_in_nineteen_of_twenty(same):
    names = [("a", "a")] * same + [("a", "b")] * (20 - same)
    one, two = (
        pd.concat(
            [final_of(**{n[k]: (1.0 + 9 * k, 1.1 + 9 * k)}).assign(accuracy=10.0**-i) for i, n in enumerate(names)]
        )
        for k in (0, 1)
    )
    said = page.twice({front.FINALS: one, again.TABLE: two}.get)
    assert said.holds == (same == 19)
    told_of = f"the same integrator in {same} and a tie in 0, together {5 * same} % (wanted: 95 %); another at"
    assert told_of in said.text
    assert ("to 1e-18 (a, then b)" in said.text) == (same == 18)
    assert said.short == f"The same sweep twice: {5 * same} % the same or a tie."


def test_the_page_of_a_scene_counts_ties_and_what_none_reaches():
    advice = scene_page._advice(BY_ID[SCENE])
    rows = [row(), row(1e-4), row(1e-5, TIE), row(1e-6, TIE), row(1e-7, ours=None, peer=None)]
    first = told(advice, *rows[:3], rows[4])
    assert "at 2, the peers at 0, 1 is a tie, 1 is reached by none." in first.text
    assert first.short == "Ours 2, peers 0, ties 1."
    both = told(advice, *rows, row(1e-8, ours=None, peer=None)).text
    assert both == (
        "Of 6 accuracies this project's methods are the cheaper at 2, the peers at 0, 2 are ties, "
        "2 are reached by none."
    )


@pytest.mark.parametrize(("uncertainty", "words"), [(2e-15, "certified, uncertain by 2.0e-15;"), (0.0, "certified;")])
def test_the_page_of_a_scene_says_what_is_true_and_how_well(uncertainty, words):
    said = told(scene_page._reference(BY_ID[SCENE]), row(**{"reference uncertainty": uncertainty}))
    assert f"What is true: {words}" in said.text
    assert said.short == "1 accuracies told."
    whole = [row(a) for a in BY_ID[SCENE].accuracies]
    assert told(scene_page._reference(BY_ID[SCENE]), *whole).text.endswith("; every accuracy can be told.")


def test_the_page_of_a_scene_counts_who_was_dropped():
    eliminated, whys = scene_page._eliminated(BY_ID[SCENE]), ["2.1 times as long as a", "3 times", "exact", None]

    def said(*reasons):
        rows = pd.DataFrame({"scene": SCENE, "integrator": "one", "why": list(reasons)})
        return eliminated({front.DROPPED: rows}.get)

    assert said(*whys).text == "2 were dropped on the way as too slow, 2 cannot do the problem or fail on it."
    assert said(*whys).holds
    assert not said(*whys, f"{climb.UNCOMPILED}TypingError: called 2 times").holds
    assert said(*whys, f"{climb.UNCOMPILED}TypingError: called 2 times").text.startswith(said(*whys).text[:-1])
    assert said(None, None) is None
    assert eliminated({front.DROPPED: pd.DataFrame({"scene": [SCENE]})}.get) is None


def test_the_table_of_a_scene_has_both_sides_at_every_accuracy():
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


def test_the_page_of_a_scene_is_reached_from_the_trades_alone_and_asks_its_question():
    for made in scene_page.PAGES:
        question = BY_ID[made.id.removeprefix("trade-")]
        assert made.question.lower() == f"{question.about}: which integrator is the cheapest?".lower()
        assert made.question[0].isupper()
        assert not made.listed
    alone = page.table({front.CHOICES: pd.DataFrame([row()])}.get).frame
    assert list(alone["scene"]) == [f"[{SCENE}](trade-{SCENE}.md)"]


def test_where_the_two_sides_are_farthest_apart():
    near, far = row(), row(1e-6, (0.25, 0.2, 0.3), "gauss-4")
    lost = row(1e-9, LOSS, "gauss-8")
    said = told(page.farthest, near, far, lost)
    assert f"on {SCENE} to 1e-06 gauss-4 takes 0.25 of the time of heyoka" in said.text
    assert f"on {SCENE} to 1e-09 heyoka takes 0.5 of the time of gauss-8" in said.text
    assert said.holds
    assert not told(page.farthest, near, row(1e-9, (2.1, 1.6, 2.5))).holds
    assert "heyoka takes" not in told(page.farthest, near, far).text
    assert "gauss-5 takes" not in told(page.farthest, lost).text


def test_where_the_advice_changes():
    rows = [row(10.0**-k, r) for k, r in enumerate((LOSS, (0.5, 0.4, 0.6), TIE, (0.5, 0.4, 0.6), LOSS), start=1)]
    found = choice.choices(pd.DataFrame(rows))
    assert choice.changes(found) == [(1e-2, PEERS, OURS), (1e-5, OURS, PEERS)]
    advice = scene_page._advice(BY_ID[SCENE])({front.CHOICES: pd.DataFrame(rows)}.get).text
    assert "the peers first, from 0.01 on this project's methods, from 1e-05 on the peers" in advice
    steady = choice.choices(pd.DataFrame([row(), row(1e-4, TIE), row(1e-5)]))
    assert choice.changes(steady) == []


def test_an_accuracy_below_the_references_uncertainty_is_a_finding():
    question = BY_ID[SCENE]
    whole = [row(a) for a in question.accuracies]
    said = scene_page._reference(question)
    assert said({front.CHOICES: pd.DataFrame(whole)}.get).holds
    less = said({front.CHOICES: pd.DataFrame(whole[:-2])}.get)
    assert not less.holds
    assert "2 accuracies below that are not asked" in less.text


def test_the_table_has_a_scene_of_every_problem_and_says_who_wins():
    rows = [row(1e-3), row(1e-6, LOSS), row(1e-9, TIE), row(1e-12, peer=None)]
    rows += [row(1e-3, scene=q.id) for q in QUESTIONS if q.id != SCENE]
    shown = page.table({front.CHOICES: pd.DataFrame(rows)}.get).frame
    assert len(shown) == len({q.problem.partition(":")[0] for q in QUESTIONS}) <= 25
    line = shown[shown["scene"].str.contains(SCENE)].iloc[0]
    assert line["to 0.001"] == "gauss-5 (0.5)"
    assert line["to 1e-06"] == "heyoka (2)"
    assert line["to 1e-09"] == "gauss-5 (= 0.96)"
    assert line["to 1e-12"] == "gauss-5 (alone)"


# -- the same sweep twice ----------------------------------------------------------------------------------------------


def finals(*members, scene=SCENE, accuracy=1e-3) -> list[dict]:
    """Finalists of (name, seconds, low, high)."""
    names = ("integrator", "seconds", "low", "high")
    return [{"scene": scene, "accuracy": accuracy} | dict(zip(names, m, strict=True)) for m in members]


A, B, MEETS = ("a", 1.0, 0.9, 1.1), ("b", 2.0, 1.9, 2.1), ("b", 1.05, 1.0, 1.2)


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ([A, B], [A, B], (1, 1, 0)),
        ([A, MEETS], [("b", 0.9, 0.8, 1.0), A], (1, 0, 1)),
        ([A, B], [("b", 0.9, 0.8, 0.85), A], (1, 0, 0)),
        ([A, B], [("b", 0.9, 0.8, 1.0)], (1, 0, 0)),
    ],
)
def test_two_sweeps_agree_on_the_same_or_on_a_tie(first, second, expected):
    tables = pd.DataFrame(finals(*first)), pd.DataFrame(finals(*second))
    assert choice.agreement(*tables)[:3] == expected
    said = page.twice({front.FINALS: tables[0], again.TABLE: tables[1]}.get)
    agreed = expected[1] + expected[2] == 1
    assert said.holds == agreed
    assert f"together {100 * agreed} %" in said.text
    assert ("another at kepler-orbit to 0.001 (a, then b)" in said.text) != agreed


@pytest.mark.parametrize(("apart", "holds"), [(2, True), (3, False)])
def test_two_sweeps_must_agree_in_nineteen_of_twenty(apart, holds):
    first, turned = (A, B), (("b", 0.5, 0.4, 0.6), ("a", 1.0, 0.9, 1.1))
    one = [r for k in range(40) for r in finals(*first, accuracy=10.0**-k)]
    other = [r for k in range(40) for r in finals(*(turned if k < apart else first), accuracy=10.0**-k)]
    said = page.twice({front.FINALS: pd.DataFrame(one), again.TABLE: pd.DataFrame(other)}.get)
    assert said.holds == holds
    assert f"of 40 accuracies the cheapest was the same integrator in {40 - apart}" in said.text


def test_what_was_measured_once_is_no_pair():
    other = pd.DataFrame(finals(A, scene="toda"))
    assert choice.agreement(pd.DataFrame(finals(A)), other) == (0, 0, 0, ())


def test_some_scenes_are_measured_again_and_each_is_a_cell():
    cells = bench_front.cells()
    assert bench_front.cells(quick=True) == []
    later = [(c.key["sweep"], c.key["scene"]) for c in cells if "sweep" in c.key]
    assert later == [(k, q.id) for k in retime.SWEEPS for q in QUESTIONS if retime.finals(q.id)]
    assert [c.key["scene"] for c in cells if "sweep" not in c.key] == [*again.scenes(), *(q.id for q in QUESTIONS)]
    assert len({c.id for c in cells}) == len(cells) == len(QUESTIONS) + again.COUNT + len(later)
    assert len({c.content for c in cells}) == len(cells)
    assert set(again.CHEAP) <= set(BY_ID)
    assert again.scenes() == again.scenes()


def test_the_second_sweep_begins_from_nothing(monkeypatch):
    """Its rows are the finals of a sweep of its own."""
    swept = []

    def measured(scene):
        swept.append(scene)
        return {front.FINALS: finals(A, scene=scene), front.CHOICES: []}

    monkeypatch.setattr(front, "measured", measured)
    assert again.measured(SCENE) == {again.TABLE: finals(A)}
    assert swept == [SCENE]


def test_who_misses_the_accuracy_fails_the_run():
    good = {"accuracy": 1e-3, "error": 1e-4, "low": 1.0, "seconds": 1.1, "high": 1.2}
    assert bench_front.bench_front(lambda table: [good]) is None
    for bad in ({"error": 2e-3}, {"seconds": 2.0}, {"low": 0.0}):
        with pytest.raises(AssertionError):
            bench_front.bench_front(lambda table, bad=bad: [good | bad])


# -- figures -----------------------------------------------------------------------------------------------------------


def test_the_figures_are_drawn_of_at_most_nine_curves(tmp_path):
    names = [f"m{k}" for k in range(12)]
    rows = [
        {"scene": SCENE, "accuracy": 10.0**-k, "side": side, "integrator": n, "seconds": 1 + abs(k - i)}
        for (k, side) in product(range(1, 13), (OURS, PEERS))
        for i, n in enumerate(names)
    ]
    assert len(choice.drawn(pd.DataFrame(rows), OURS, 5)) == 5
    rungs = pd.DataFrame(
        {"scene": SCENE, "integrator": n, "error": 10.0**-k, "seconds": k, "steps": k}
        for n in names
        for k in range(1, 9)
    )
    picture = figures.work_precision(BY_ID[SCENE], pd.DataFrame(rows), rungs, tmp_path)
    assert (tmp_path / picture.file).stat().st_size > 5000
    every = choice.choices(pd.DataFrame([row(0.1), row(1e-2, LOSS), row(1e-3, peer=None)]))
    assert (tmp_path / figures.ratios(every, tmp_path).file).stat().st_size > 3000


# -- seconds of the sweep ----------------------------------------------------------------------------------------------


@pytest.fixture
def clock(monkeypatch):
    """Integrations that take so many milliseconds, one after another."""
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
    clock(5, 1, 2)
    assert sweep.measure(sweep.Task("pendulum-t1000", "stormer-verlet", (), 0.05))["seconds"] == 2e-3
    # The second one is of the run with rows.
    clock(5, 77, 1, 2)
    assert sweep.measure(sweep.Task("pendulum-t1000", "heyoka", (), None, tol=1e-6))["seconds"] == 2e-3


def test_the_curves_of_a_diagram_are_of_those_that_are_cheapest_somewhere():
    told = [("a", 1.0, 1e-3), ("b", 2.0, 1e-8), ("c", 3.0, 1e-5), ("d", 4.0, 1e-12)]
    rows = pd.DataFrame(told, columns=["method", "seconds", "global_error"])
    assert choice.frontier(rows, 9) == ["b", "d", "a"]
    assert choice.frontier(rows, 1) == ["b"]


def test_scenes_that_were_not_measured_are_named():
    names = [q.id for q in QUESTIONS]
    few, every = pd.DataFrame({"scene": names[:-2] * 2}), pd.DataFrame({"scene": names})
    found = page.missing(lambda name: few)
    assert not found.holds
    assert f"{len(names) - 2} of {len(names)} scenes" in found.text
    assert all(name in found.text for name in names[-2:])
    assert page.missing(lambda name: every) is None
