"""The measures of the trade: joined sweeps, the faster side, reasons, where Gauss crosses, of made-up rows."""

from __future__ import annotations

from math import inf

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.ladder import choice, peer_rows, sweep
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.timing import NONE, OURS, PEERS, TIED
from phasebench.benchmarks.problems.questions import QUESTIONS
from phasebench.benchmarks.studies.trade import front, gauss, joined, ratios, scenes, trade
from phasebench.benchmarks.studies.trade.joined import JOINED, coverage, join_sweeps, pairs, sweeps
from phasebench.integrators.driver import Solution

SCENE = "toda"

# -- joined sweeps -----------------------------------------------------------------------------------------------------


def random_sweeps(scatter: float, seed: int, cells: int = 200, base: float = 1e-3):
    """(times of the first sweep, rows of two more) of integrators whose median times scatter between sweeps."""
    rng = np.random.default_rng(seed)
    finals, times = [], []
    for k in range(cells):
        for side, name, mean in ((OURS, "a", 1.0), (OURS, "b", 1.2), (PEERS, "c", 2.0)):
            seconds = base * mean * np.exp(rng.normal(0, scatter, 3))
            key = {"scene": f"s{k}", "accuracy": 1e-3, "side": side, "integrator": name}
            finals.append(key | {"seconds": seconds[0], "low": seconds[0], "high": seconds[0], "steps": k})
            times += [key | {"sweep": s, "seconds": seconds[s - 1]} for s in (2, 3)]
    return pd.DataFrame(finals), pd.DataFrame(times)


@pytest.mark.parametrize("scatter", [0.005, 0.1])
def test_intervals_cover_a_third_sweep(scatter):
    shares = pd.DataFrame([coverage(*random_sweeps(scatter, seed)) for seed in range(8)]).mean()
    assert ((shares > 0.93) & (shares < 0.975)).all()


def test_control_intervals_of_one_sweep_do_not_cover(monkeypatch):
    """If intervals leave out the scatter between sweeps, half of the third sweep's times lie outside."""
    monkeypatch.setattr(joined, "LEVEL", 0.0)
    assert (coverage(*random_sweeps(0.1, 0)) < 0.6).all()


def test_interval_contains_both_joined_sweeps():
    table = sweeps(*random_sweeps(0.3, 1))
    interval = join_sweeps(table, table[1])
    for sweep_ in JOINED:
        assert (table[sweep_] >= interval["low"] * (1 - 1e-12)).all()
        assert (table[sweep_] <= interval["high"] * (1 + 1e-12)).all()


def test_intervals_depend_on_the_length_of_a_run():
    """Short runs that scatter more do not widen the intervals of long ones."""
    short, long = random_sweeps(0.2, 2, base=1e-5), random_sweeps(0.01, 3, base=1e-2)
    table = sweeps(*(pd.concat([a, b.assign(scene="l" + b["scene"])]) for a, b in zip(short, long, strict=True)))
    interval = join_sweeps(table, table[1])
    width = np.log(interval["high"] / interval["low"])
    lasting = table[1].to_numpy() > 1e-3
    assert width[lasting].median() < 0.1 < 0.3 < width[~lasting].median()


def test_ratios_are_of_the_best_by_both_sweeps():
    finals, times = random_sweeps(0.0, 0, cells=2)
    finals.loc[(finals["integrator"] == "b") & (finals["scene"] == "s0"), "seconds"] = 1e-5  # b was fast once by chance
    times.loc[(times["integrator"] == "b") & (times["scene"] == "s0"), "seconds"] = 1.0
    found = pairs(sweeps(finals, times)).set_index("scene")
    assert found.loc["s0", f"{OURS} integrator"] == "a"
    assert found.loc["s0", [1, 2, 3]].tolist() == pytest.approx([0.5] * 3)


def first_choices(finals: pd.DataFrame) -> pd.DataFrame:
    """The fastest integrator of each side in each scene, and the ratio of their times, from the first sweep."""
    rows = []
    for (scene, accuracy), part in finals.groupby(["scene", "accuracy"]):
        row = {"scene": scene, "accuracy": accuracy}
        for side in (OURS, PEERS):
            best = part[part["side"] == side].sort_values("seconds").iloc[0].reindex(front.SHOWN)
            row |= {f"{side} {name}": best[name] for name in front.SHOWN}
        row |= dict.fromkeys(("ratio", "ratio low", "ratio high"), row[f"{OURS} seconds"] / row[f"{PEERS} seconds"])
        rows.append(row)
    return pd.DataFrame(rows)


def test_pages_receive_the_joined_times_and_intervals():
    finals, times = random_sweeps(0.1, 5, cells=40)
    first, table = first_choices(finals), sweeps(finals, times)
    given = {front.CHOICES: first, front.FINALS: finals, front.TIMES: times}
    found = joined.joined(given.get)
    for row in found.to_dict("records"):
        key = (row["scene"], row["accuracy"], OURS, row[f"{OURS} integrator"])
        assert row[f"{OURS} seconds"] == pytest.approx(np.sqrt(table.loc[key, 1] * table.loc[key, 2]))
        assert row[f"{OURS} low"] < row[f"{OURS} seconds"] < row[f"{OURS} high"]
        assert row["ratio low"] < row["ratio"] < row["ratio high"]
    assert (found[f"{OURS} steps"] == first[f"{OURS} steps"]).all()
    assert found["ratio"].tolist() != first["ratio"].tolist()
    for alone in ({front.CHOICES: first}, given | {front.TIMES: times[times["sweep"] == 3]}):
        assert joined.joined(alone.get)["ratio"].tolist() == first["ratio"].tolist()
    assert joined.joined({}.get) is None


def sweep_tables(members: dict[str, tuple[float, float]], again: str) -> list[pd.DataFrame]:
    """Finals, further times and a sweep made again, of one case.

    ``members`` has the seconds of integrators in two sweeps; ``again`` is the fastest of the sweep made again.
    """
    finals, times = [], []
    for name, seconds in (members | {"peer": (10.0, 10.0)}).items():
        key = {"scene": SCENE, "accuracy": 1e-3, "side": PEERS if name == "peer" else OURS, "integrator": name}
        finals.append(key | {"seconds": seconds[0]})
        times.append(key | {"seconds": seconds[1], "sweep": 2})
    second = [
        {"scene": SCENE, "accuracy": 1e-3, "integrator": n, "seconds": s} for n, s in ((again, 1.0), ("slow", 9.0))
    ]
    return [pd.DataFrame(rows) for rows in (finals, times, second)]


@pytest.mark.parametrize(
    ("members", "again", "agree"),
    [
        ({"a": (1.0, 1.0), "b": (2.0, 2.0)}, "a", True),
        ({"a": (1.0, 1.0), "b": (2.0, 2.0)}, "b", False),
        ({"a": (1.0, 1.0), "b": (1.04, 1.04)}, "b", True),
        ({"a": (1.0, 1.0), "b": (1.06, 1.06)}, "b", False),
        ({"a": (1.0, 1.0), "b": (1.3, 0.95)}, "b", True),
        ({"a": (1.0, 1.4), "b": (1.1, 1.1)}, "b", True),
        ({"a": (1.0, 1.0)}, "b", False),
    ],
    ids=["same", "apart", "within the factor", "just beyond it", "scattered", "joined winner", "no finalist"],
)
def test_sweeps_agree_on_the_winner_or_a_tie(members, again, agree):
    assert joined.agreement(*sweep_tables(members, again))["agree"].tolist() == [agree]


def test_a_further_sweep_times_the_stored_finals(tmp_path, monkeypatch):
    """With the stored steps or tolerances."""
    lines = [
        "scene,accuracy,side,integrator,h,tol,seconds",
        "pendulum-short,0.001,ours,stormer-verlet,0.05,,1e-5",
        "pendulum-short,0.001,peer,heyoka,,1e-6,1e-5",
    ]
    (tmp_path / f"{front.FINALS}.csv").write_text("\n".join(lines) + "\n")
    monkeypatch.setattr(front, "DATA", tmp_path)
    stored = front.stored_finals("pendulum-short")
    assert stored == ((1e-3, OURS, "stormer-verlet", 200, None, 1e-5), (1e-3, PEERS, "heyoka", None, 1e-6, 1e-5))
    rows = front.sweep_again("pendulum-short", 2)
    assert [(r["sweep"], r["side"], r["integrator"]) for r in rows] == [(2, *line[1:3]) for line in stored]
    assert all(0 < r["low"] <= r["seconds"] <= r["high"] < 1e-2 for r in rows)
    with pytest.raises(front.Unavailable, match="toda"):
        front.sweep_again("toda", 2)


def test_cells_are_selected_by_scene_and_problem():
    cells = trade.STUDY.cells()
    assert trade.STUDY.cells(quick=True) == []
    assert len(cells) == front.COUNT + len(QUESTIONS) * (1 + len(front.SWEEPS))
    assert {c.names for c in cells if c.key["scene"] == "pendulum-long"} == {frozenset({"pendulum-long", "pendulum"})}
    assert all(c.own for c in cells)
    assert {*front.CHEAP} <= {*trade.SCENES}


# -- the faster side ---------------------------------------------------------------------------------------------------


def row(accuracy=1e-6, steps=(100, 50), seconds=(1e-5, 2e-5), spread=0.01, evaluations=800, scene=SCENE, **more):
    """A made-up case; pairs are (our best method, the best peer), steps None for a side that does not get there."""
    out = {"scene": scene, "quantity": "end-state", "accuracy": accuracy}
    for side, n, s in zip((OURS, PEERS), steps, seconds, strict=True):
        known = {"integrator": f"one of {side}", "h": 0.1, "tol": np.nan, "steps": n, "seconds": s}
        out |= {f"{side} {k}": v if n is not None else np.nan for k, v in known.items()}
    out[f"{OURS} evaluations"] = evaluations
    ratio = seconds[0] / seconds[1] if None not in steps else np.nan
    return out | {"ratio": ratio, "ratio low": ratio * (1 - spread), "ratio high": ratio * (1 + spread)} | more


LOW, HIGH = "ratio low", "ratio high"
CASES = {
    "ours": (row(), OURS),
    "a peer": (row(seconds=(2e-5, 1e-5)), PEERS),
    "ours, almost a tie": (row(**{LOW: 0.93, HIGH: 0.95}), OURS),
    "a tie": (row(**{LOW: 0.9, HIGH: 0.99}), TIED),
    "a tie, theirs": (row(**{LOW: 1.04, HIGH: 1.2}), TIED),
    "a tie, just": (row(**{LOW: choice.TIE, HIGH: 1.2}), TIED),
    "not certain": (row(**{LOW: 0.1, HIGH: 3.0}), TIED),
    "ours alone": (row(steps=(100, None)), OURS),
    "a peer alone": (row(steps=(None, 50)), PEERS),
    "none": (row(steps=(None, None)), NONE),
}


@pytest.mark.parametrize("name", CASES)
def test_cheaper_side(name):
    given, expected = CASES[name]
    found = choice.choices(pd.DataFrame([given]))
    assert found["cheaper"].tolist() == [expected]
    assert trade.counts(found) == tuple(int(expected == x) for x in (OURS, PEERS, TIED))
    assert choice.winner(found.iloc[0]) == {PEERS: "one of peer", NONE: ""}.get(expected, "one of ours")


def runs(price=1e-9, error=1e-9, scene=SCENE, kind="phasebench"):
    """A table of one run with 1000 gradient evaluations that take ``price`` seconds each."""
    told = {"integrator": "gauss-4", "kind": kind, "evaluations": 1000, "seconds": 1000 * price, "error": error}
    return pd.DataFrame([{"scene": scene} | told])


def data(*rows, rungs=None):
    return {front.CHOICES: pd.DataFrame(rows), front.RUNGS: runs(1e-8) if rungs is None else rungs}.get


def test_cases_of_one_side_count():
    given = data(row(), row(steps=(None, 5)), row(steps=(5, None)), row(steps=(None, None)))
    assert joined.cases(given)["ratio"].tolist() == [0.5, inf, 0.0]
    assert ratios.STUDY.claims["share"](given).measured.n == 2


def test_preserved_energy_does_not_count_as_a_lead():
    made = [
        row(k, quantity="energy", **{f"{OURS} integrator": id}) for k, id in ((1e-3, "avf(x=1)"), (1e-4, "gauss-4"))
    ]
    alone = row(steps=(100, None))
    assert trade.fair(joined.cases(data(*made, alone))).tolist() == [False, True, False]


# -- reasons -----------------------------------------------------------------------------------------------------------


def one(**given):
    """The case of our method that takes longer than the peer's, with its reason."""
    found = ratios.above(data(row(**given)))
    assert len(found) == 1
    return found.iloc[0]


#: 800 evaluations at 1e-8 s are 8 of our 10 us.
SLOWER = {
    ratios.UNREACHED: {"steps": (None, 50)},
    ratios.WITHIN: {"seconds": (1e-5, 9.95e-6)},
    ratios.REST: {"seconds": (1e-5, 9e-6)},
    ratios.MORE: {"seconds": (1e-5, 5e-6), "steps": (100, 50)},
    ratios.DEARER: {"seconds": (1e-5, 5e-6), "steps": (50, 50)},
    ratios.BOTH: {"seconds": (1e-5, 2.5e-6), "steps": (100, 50)},
}


@pytest.mark.parametrize("reason", SLOWER)
def test_each_reason_has_its_case(reason):
    found = one(**SLOWER[reason])
    assert found["reason"] == reason
    assert ratios.sentence(found.to_dict(), runs()).startswith(reason)


def test_reasons_at_their_bounds():
    assert one(seconds=(1.1e-5, 1e-5), steps=(105, 100), evaluations=1100)["reason"] == ratios.BOTH
    equal = data(row(seconds=(1e-5, 5e-6)), rungs=runs(6.25e-9))
    assert ratios.above(equal).iloc[0]["reason"] == ratios.REST, "the evaluations alone take as long as the peer's run"
    assert ratios.above(data(row(seconds=(1e-5, 5e-6), steps=(100, 0)))).iloc[0]["reason"] is None
    assert ratios.above(data(row(seconds=(1e-5, 1e-5)), row(1e-8, steps=(100, None)))).empty


def test_factors_multiply_to_the_ratio():
    found = one(seconds=(1e-5, 4e-6))
    assert found["steps"] == 2
    assert found["steps"] * found["step"] == pytest.approx(found["ratio"]) == pytest.approx(2.5)
    assert found["share"] == pytest.approx(0.8)
    rungs = pd.concat([runs(1e-8), runs(2e-9, kind="rebound"), runs(5e-9)])
    assert ratios.price(rungs)[SCENE] == pytest.approx(5e-9)


def test_growth_is_counted_from_the_last_fast_accuracy():
    rows = [row(1e-3, (10, 20)), row(1e-4, (20, 25)), row(1e-5, (40, 25), (2e-5, 1e-5))]
    rows.append(row(1e-6, (80, 30), (3e-5, 1e-5)))
    found = ratios.above(data(*rows)).set_index("accuracy")
    assert found.index.tolist() == [1e-6, 1e-5]
    assert (found["until"] == 1e-4).all()
    assert found.loc[1e-6, ["ours grew", "peer grew"]].tolist() == pytest.approx([4, 1.2])
    assert ratios.above(data(*rows[2:]))["ours grew"].isna().all()


def test_text_of_a_case_has_its_factors_and_growth():
    (found,) = ratios.above(data(row(1e-5, (10, 20)), row(1e-6, (40, 30), (1e-5, 2.5e-6)))).to_dict("records")
    plain = "more and dearer steps: steps x 1.3, a step's time x 3"
    assert ratios.sentence(found, runs()) == f"{plain}; evaluations 80 %; steps since 1e-05 x 4 and 1.5"
    assert ratios.sentence(found | {"ours grew": np.nan, "share": np.nan}, runs()) == plain
    unreached = one(steps=(None, 50)).to_dict()
    exact = pd.concat([runs(error=0.0), runs(error=2e-11)])
    assert ratios.sentence(unreached, exact) == "not reached: ours end at 2.0e-11 (gauss-4)"
    assert "no run of ours" in ratios.sentence(unreached, runs(kind="heyoka"))


def test_table_has_the_worst_case_of_every_scene_first():
    rows = [row(10.0**-k, seconds=(1e-5 * k, 1e-6), scene=f"s{n}") for n in range(10) for k in range(1, 5)]
    shown = ratios.table(data(*rows)).frame
    assert len(shown) == 25
    assert shown["scene"].nunique() == 10
    assert shown["ratio"].str.startswith("40 ").sum() == 10


# -- Gauss of order 16 -------------------------------------------------------------------------------------------------


def gauss_runs(*scenes):
    """For each (scene, exponent, constant) times of Gauss, ``constant``, and of others, 1 / error^exponent."""
    rows = []
    for scene, exponent, constant in scenes:
        for k in range(1, 11):
            error = 0.9 * 10.0**-k
            times = {"gauss-8": constant, "pefrl": error**-exponent, "rk4": 2 * error**-exponent, "heyoka": 1e-9}
            about = {"scene": scene, "status": "ok", "error": error}
            rows += [about | {"integrator": id, "id": id, "seconds": seconds} for id, seconds in times.items()]
    return pd.DataFrame(rows)


def gauss_ratios(rungs: pd.DataFrame) -> pd.DataFrame:
    return gauss.ratios({front.RUNGS: rungs}.get)


def test_methods_cross_where_their_times_do():
    found = gauss.crossings(gauss_ratios(gauss_runs(("toda", 0.25, 100.0), ("duffing", 0.25, 1e9))))
    assert found["toda"] == pytest.approx(1e-8)  # (0.9e-8)^-1/4 = 102.7, and (0.9e-7)^-1/4 = 57.7
    assert np.isnan(found["duffing"])


def test_only_the_end_of_a_scene_counts():
    """An error at which Gauss is faster by chance, before larger ratios at smaller errors, is no crossing."""
    part = pd.DataFrame({"scene": SCENE, "accuracy": [1e-1, 1e-2, 1e-3, 1e-4], "ratio": [0.9, 1.2, 0.8, 0.7]})
    assert gauss.crossings(part)[SCENE] == 1e-3
    assert np.isnan(gauss.crossings(part.assign(ratio=[0.5, 0.5, 0.5, 1.5]))[SCENE])


def test_peers_and_runs_that_failed_do_not_count():
    given = gauss_runs(("toda", 0.25, 100.0))
    assert set(gauss_ratios(given)["fastest explicit"]) == {"pefrl"}
    failed = given.assign(status=given["status"].mask(given["id"] == "pefrl", "diverged"))
    assert set(gauss_ratios(failed)["fastest explicit"]) == {"rk4"}


def test_a_scene_ends_where_only_the_first_of_the_search_are_left():
    given = gauss_runs(("toda", 0.25, 100.0))
    given.loc[given["id"] == "rk4", "seconds"] /= 4
    assert gauss_ratios(given)["accuracy"].min() == pytest.approx(1e-10)
    dropped = given[(given["id"] != "rk4") | (given["error"] > 1e-6)]
    assert gauss_ratios(dropped)["accuracy"].min() == pytest.approx(1e-5)


def test_what_is_explicit_depends_on_the_system():
    assert gauss.is_explicit("pefrl", True)
    assert not gauss.is_explicit("pefrl", False)
    assert gauss.is_explicit("rk4", False)
    assert not any(gauss.is_explicit(id, True) for id in ("scheme-iii", "gauss-8", "rk4-adaptive", "heyoka"))


# -- pages and rows of scenes ------------------------------------------------------------------------------------------


def test_a_diagram_has_at_most_nine_curves():
    rows = [
        {"accuracy": 10.0**-k, "side": side, "integrator": f"m{i}", "seconds": 1 + abs(k - i)}
        for k in range(1, 13) for side in (OURS, PEERS) for i in range(12)
    ]  # fmt: skip
    assert [len(scenes.integrators_to_draw(pd.DataFrame(rows), *of)) for of in scenes.CURVES.items()] == [5, 4]


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
