"""The speed page's sentences follow their rows, both ways."""

from __future__ import annotations

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.speed import bench_speed, page, speed


def ratio(median: float, wanted: float | None = 1.4, spread: float = 0.05, name: str = "Verlet / C loop") -> dict:
    return {"ratio": name, "median": median, page.LOW: median - spread, page.HIGH: median + spread, page.WANTED: wanted}


def told(verdict, table: str, *rows: dict):
    return verdict({table: pd.DataFrame(rows)}.get)


@pytest.mark.parametrize(
    ("last", "holds", "words"),
    [
        (ratio(1.2), True, "2 of 2 ratios are within what is wanted, 2 with their whole interval."),
        (ratio(1.38), True, "2 of 2 ratios are within what is wanted, 1 with their whole interval."),
        (ratio(1.4), True, "2 of 2 ratios are within what is wanted, 1 with their whole interval."),
        (
            ratio(1.42),
            False,
            "1 of 2 ratios are within what is wanted, 1 with their whole interval; over it: Verlet / C",
        ),
        (ratio(1.42), False, "loop 1.42 (wanted 1.4)"),
        (ratio(9.0, None), True, "1 of 1 ratios"),
    ],
)
def test_ratios_are_held_to_what_is_wanted(last, holds, words):
    said = told(page.limits, "ratios", ratio(1.0), last)
    assert said.holds == holds
    assert words in said.text
    assert told(page.limits, "ratios", ratio(1.0, None)) is None


def test_an_interval_that_ends_at_what_is_wanted_is_within_it():
    said = told(page.limits, "ratios", ratio(1.0, 1.25, 0.25))
    assert "1 of 1 ratios are within what is wanted, 1 with their whole interval." in said.text


def test_the_first_ratios_are_shown_and_every_time_is_kept():
    shown = told(page.table, "ratios", *[ratio(1.0, name=f"{k:02d}") for k in range(30)]).frame
    assert list(shown["ratio"]) == [f"{k:02d}" for k in range(25)]
    assert list(shown.columns) == page.COLUMNS
    assert len(page.PAGE.whole({"speed": pd.DataFrame({"method": range(30)})}.get)) == 30


def test_the_ratios_to_c_are_named():
    rows = [ratio(1.25), ratio(3.0, name="AVF / implicit midpoint"), ratio(5.0, name="Scheme I / C Verlet")]
    said = told(page.beside_c, "ratios", *rows)
    assert said.text == "Times of a step beside a bare C loop: Verlet / C loop 1.25; Scheme I / C Verlet 5.00."
    assert said.holds
    assert told(page.beside_c, "ratios", rows[1]) is None


def test_the_fastest_the_slowest_and_the_median_are_told_apart():
    rows = [
        {"method": m, "problem": "p", "ns per step": ns, "status": status}
        for m, ns, status in (("a", 10.0, "ok"), ("b", 100.0, "ok"), ("c", 30.0, "ok"), ("d", 1.0, "diverged"))
    ]
    said = told(page.fastest, "speed", *rows)
    assert (
        "from 10 ns (a, p) to 100 ns (b, p), 30 ns in the median of 3 pairs of a method and a problem (3 methods, 3"
        in said.text
    )
    assert said.holds
    assert told(page.fastest, "speed", rows[3]) is None


def test_a_method_with_other_parameters_is_no_other_method():
    """As many methods as the page on methods counts, and how many more with each of their parameters."""
    rows = [
        {"method": m, "problem": p, "ns per step": 1.0, "status": "ok"}
        for m in ("a", "a(lam=1/3)", "a(lam=2)", "b")
        for p in ("p", "q")
    ]
    assert "of 8 pairs of a method and a problem (2 methods, 4 with" in told(page.fastest, "speed", *rows).text


def test_what_is_wanted_of_whom():
    """A promise of this project: a step takes at most so many times as long."""
    assert {k: v[2] for k, v in speed.RATIOS.items() if v[2]} == {
        "Stormer-Verlet / C loop": 1.05,
        "Scheme I(1/3) / C Stormer-Verlet": 10,
        "Scheme V / Scheme III(1/3)": 3,
    }


def test_a_row_of_times_is_of_the_medians(monkeypatch):
    seconds = iter([9.0, 1.0, 2.0, 3.0])
    monkeypatch.setattr(speed, "interleaved", lambda work, rounds: {n: [next(seconds) for _ in range(4)] for n in work})
    (row,) = speed.timed("pendulum", "stormer-verlet", ())["speed"]
    assert (row["ns per step"], row["ns, low"], row["ns, high"]) == (2.5e5, 1e5, 9e5)
    assert (row["status"], row["gradients per step"]) == ("ok", pytest.approx(1, abs=1e-3))
    times = {"stormer-verlet": [2.0, 9.0, 6.0], "C": [1.0, 3.0, 2.0]}
    monkeypatch.setattr(speed, "interleaved", lambda work, rounds: times)
    monkeypatch.setattr(speed, "_work", lambda *of: lambda: None)
    (row,) = speed.compared("Stormer-Verlet / C loop", "kepler")["ratios"]
    assert (row["median"], row[page.LOW], row[page.HIGH], row[page.WANTED]) == (3.0, 2.0, 3.0, 1.05)
    assert bench_speed.bench_ratios(lambda table: [row]) is None
