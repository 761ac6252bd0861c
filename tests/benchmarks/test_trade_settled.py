"""Joined timing sweeps: their intervals cover a further sweep at the stated rate, whatever the scatter."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.trade import retime, settled
from phasebench.benchmarks.experiments.trade.front import FINALS
from phasebench.benchmarks.experiments.trade.settled import JOINED, coverage, join_sweeps, pairs, sweeps
from phasebench.benchmarks.measure.timing import OURS, PEERS


def random_sweeps(scatter: float, seed: int, cells: int = 200, base: float = 1e-3):
    """(times of the first sweep, rows of two more) of integrators whose median times scatter between sweeps.

    A sweep times the fastest integrators of every scene once more.
    """
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
    found = [coverage(*random_sweeps(scatter, seed)) for seed in range(8)]
    for what in ("times", "ratios"):
        inside, total = np.sum([f[what] for f in found], axis=0)
        assert total >= 8 * 200
        assert 0.93 < inside / total < 0.975


def test_control_intervals_of_one_sweep_do_not_cover(monkeypatch):
    """If intervals leave out the scatter between sweeps, half of the third sweep's times lie outside."""
    monkeypatch.setattr(settled, "LEVEL", 0.0)
    for inside, total in coverage(*random_sweeps(0.1, 0)).values():
        assert inside / total < 0.6


def test_interval_contains_both_joined_sweeps():
    table = sweeps(*random_sweeps(0.3, 1))
    interval = join_sweeps(table, table[1])
    for sweep in JOINED:
        assert (table[sweep] >= interval["low"] * (1 - 1e-12)).all()
        assert (table[sweep] <= interval["high"] * (1 + 1e-12)).all()


def test_intervals_depend_on_the_length_of_a_run():
    """Short runs that scatter more do not widen the intervals of long ones."""
    short, long = random_sweeps(0.2, 2, base=1e-5), random_sweeps(0.01, 3, base=1e-2)
    parts = [pd.concat([a, b.assign(scene="l" + b["scene"])]) for a, b in zip(short, long, strict=True)]
    table = sweeps(*parts)
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


def choices(finals: pd.DataFrame) -> pd.DataFrame:
    """The fastest integrator of each side in each scene, and the ratio of their times, from the first sweep."""
    rows = []
    for (scene, accuracy), part in finals.groupby(["scene", "accuracy"]):
        row = {"scene": scene, "accuracy": accuracy}
        for side in (OURS, PEERS):
            best = part[part["side"] == side].sort_values("seconds").iloc[0]
            row |= {f"{side} {name}": best[name] for name in ("integrator", "steps", "seconds", "low", "high")}
        row |= dict.fromkeys(("ratio", "ratio low", "ratio high"), row[f"{OURS} seconds"] / row[f"{PEERS} seconds"])
        rows.append(row)
    return pd.DataFrame(rows)


def test_choices_have_the_joined_times_and_intervals():
    finals, times = random_sweeps(0.1, 5, cells=40)
    front = choices(finals)
    found = settled.join_choices(front, finals, times)
    table = sweeps(finals, times)
    for row in found.to_dict("records"):
        key = (row["scene"], row["accuracy"], OURS, row[f"{OURS} integrator"])
        assert row[f"{OURS} seconds"] == pytest.approx(np.sqrt(table.loc[key, 1] * table.loc[key, 2]))
        assert row[f"{OURS} low"] < row[f"{OURS} seconds"] < row[f"{OURS} high"]
        assert row["ratio low"] < row["ratio"] < row["ratio high"]
    assert (found[f"{OURS} steps"] == front[f"{OURS} steps"]).all()


def test_first_sweep_stands_without_a_second():
    finals, times = random_sweeps(0.1, 5, cells=3)
    front = choices(finals)
    assert settled.join_choices(front, finals, None) is front
    assert settled.join_choices(front, finals, times[times["sweep"] == 3]) is front


def test_pages_receive_the_joined_choices():
    finals, times = random_sweeps(0.1, 5, cells=40)
    front = choices(finals)
    told = settled.of_choices()(lambda rows: rows["ratio"].tolist())
    tables = {"front": front, FINALS: finals, settled.TIMES: times}
    assert told(tables.get) == settled.join_choices(front, finals, times)["ratio"].tolist() != front["ratio"].tolist()
    assert told({"front": front}.get) == front["ratio"].tolist()
    assert told({}.get) is None


def test_further_sweep_times_the_stored_finals(tmp_path):
    """A further sweep times the integrators of the stored table, with the stored steps or tolerances.

    An unmeasured scene has none.
    """
    lines = [
        "scene,accuracy,side,integrator,h,tol,seconds",
        "pendulum-short,0.001,ours,stormer-verlet,0.05,,1e-5",
        "pendulum-short,0.001,peer,heyoka,,1e-6,1e-5",
    ]
    (tmp_path / f"{FINALS}.csv").write_text("\n".join(lines) + "\n")
    stored = retime.finals("pendulum-short", tmp_path)
    assert stored == ((1e-3, OURS, "stormer-verlet", 200, None, 1e-5), (1e-3, PEERS, "heyoka", None, 1e-6, 1e-5))
    assert retime.finals("toda", tmp_path) == ()
    rows = retime.measure_rows("pendulum-short", 2, stored)[retime.TABLE]
    assert [(r["sweep"], r["side"], r["integrator"]) for r in rows] == [(2, *line[1:3]) for line in stored]
    assert all(0 < r["low"] <= r["seconds"] <= r["high"] < 1e-2 for r in rows)
