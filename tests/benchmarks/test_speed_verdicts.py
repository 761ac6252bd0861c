"""The speed page: its verdicts follow from fabricated rows, passing and failing."""

from __future__ import annotations

import re

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.speed import bench_speed, canary, page, speed
from phasebench.benchmarks.page.verdict import FAIL, FINDING, PASS, Count
from support.pages import judge


def ratio(median: float, wanted: float | None = 1.4, spread: float = 0.05, name: str = "Verlet / C loop") -> dict:
    """The fabricated row of a ratio of times per step, median +- spread, with the largest value ``wanted`` of it."""
    return {"ratio": name, "median": median, page.LOW: median - spread, page.HIGH: median + spread, page.WANTED: wanted}


@pytest.mark.parametrize(
    ("last", "outcome", "n", "of"),
    [
        (ratio(1.2), PASS, 2, 2),
        (ratio(1.4), PASS, 2, 2),
        (ratio(1.42), FINDING, 1, 2),
        (ratio(9.0, None), PASS, 1, 1),
    ],
)
def test_ratios_are_compared_with_their_targets(last, outcome, n, of):
    said = judge(page.limits, "ratios", ratio(1.0, name="first"), last)
    assert (said.outcome, said.measured) == (outcome, Count(n, of))
    assert said.where.startswith("Verlet" if of == 2 else "first")
    assert judge(page.limits, "ratios", ratio(1.0, None)) is None


@pytest.mark.parametrize(("within", "outcome"), [([True, True], PASS), ([True, False], FAIL)])
def test_prepared_run_that_adds_time_fails(within, outcome):
    calls = [{"peer": f"p{k}", "ratio": 1.0 + k / 5, "within": good} for k, good in enumerate(within)]
    said = judge(page.call_overhead, page.CALLS, *calls)
    assert (said.outcome, said.measured, said.where) == (outcome, Count(sum(within), 2), "p1: 1.2 times")


def test_first_ratios_are_shown_and_all_times_kept():
    shown = judge(page.table, "ratios", *[ratio(1.0, name=f"{k:02d}") for k in range(30)]).frame
    assert list(shown["ratio"]) == [f"{k:02d}" for k in range(25)]
    assert list(shown.columns) == page.COLUMNS
    assert len(page.PAGE.whole({"speed": pd.DataFrame({"method": range(30)})}.get)) == 30


def test_answer_has_the_ranges_of_steps_and_c_loops():
    steps = [("a", 10.0, "ok"), ("b", 1e4, "ok"), ("c", 30.0, "ok"), ("d", 1.0, "diverged")]
    times = pd.DataFrame([{"method": m, "problem": "p", "ns per step": ns, "status": s} for m, ns, s in steps])
    names = (f"{page.LOOP} p", f"{page.LOOP} q", "Stormer-Verlet / C loop with merged kicks, p", "AVF / midpoint, p")
    ratios = pd.DataFrame([ratio(x, name=name) for name, x in zip(names, (1.25, 0.95, 3.0, 5.0), strict=True)])
    said = page.answer({"speed": times, "ratios": ratios}.get)
    assert re.findall(r"[\d.]*\d", said) == ["10", "10", "30", "3", "0.95", "1.25"]
    assert len(re.findall(r"[\d.]*\d", page.answer({"speed": times, "ratios": ratios.tail(2)}.get))) == 4
    assert page.answer({"speed": times.tail(1), "ratios": ratios}.get) is None
    assert page.answer({"speed": times}.get) is None


def test_speed_targets():
    """The largest ratios of times per step that the project promises: Stormer-Verlet to a C loop, and two schemes."""
    assert {k: v[2] for k, v in speed.RATIOS.items() if v[2]} == {
        "Stormer-Verlet / C loop": 1.05,
        "Scheme I(1/3) / C Stormer-Verlet": 10,
        "Scheme V / Scheme III(1/3)": 3,
    }


def test_row_of_times_has_medians(monkeypatch):
    seconds = iter([9.0, 1.0, 2.0, 3.0])
    monkeypatch.setattr(
        speed, "time_in_turns", lambda work, rounds: {n: [next(seconds) for _ in range(4)] for n in work}
    )
    (row,) = speed.measure_method_rows("pendulum", "stormer-verlet", ())["speed"]
    assert (row["ns per step"], row["ns, low"], row["ns, high"]) == (2.5e5, 1e5, 9e5)
    assert (row["status"], row["gradients per step"]) == ("ok", pytest.approx(1, abs=1e-3))
    times = {"stormer-verlet": [2.0, 9.0, 6.0], "C": [1.0, 3.0, 2.0]}
    monkeypatch.setattr(speed, "time_in_turns", lambda work, rounds: times)
    monkeypatch.setattr(speed, "_work", lambda *of: lambda: None)
    (row,) = speed.measure_ratio_rows("Stormer-Verlet / C loop", "kepler")["ratios"]
    assert (row["median"], row[page.LOW], row[page.HIGH], row[page.WANTED]) == (3.0, 2.0, 3.0, 1.05)
    bench_speed.bench_ratios(lambda table: [row])
    with pytest.raises(AssertionError):
        bench_speed.bench_ratios(lambda table: [row | {page.HIGH: row["median"] / 2, page.LOW: row["median"] / 4}])


def test_canary_sees_kernels_that_became_slower():
    stored = dict.fromkeys(canary.METHODS, 2.0)
    rows = [{"method": m, "ratio": 2.02} for m in canary.METHODS]
    assert canary.change(rows, stored.get) == pytest.approx(1.01)
    slower = [row | {"ratio": 2.6 if k % 3 else 2.0} for k, row in enumerate(rows)]
    assert canary.change(slower, stored.get) > canary.SAME
    assert canary.change(rows, {}.get) is None
    assert len({*canary.METHODS}) == 20
