"""The Kepler page: its verdicts follow from fabricated rows, passing and failing."""

from __future__ import annotations

import re
from math import inf, pi

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.kepler import figures, page
from phasebench.benchmarks.experiments.kepler.times import TABLE
from phasebench.benchmarks.measure.timing import NONE, OURS, PEERS, TIED
from phasebench.benchmarks.page.verdict import FINDING, MISSING, PASS, Count

OWN, THEIRS = "gauss-8", "heyoka"


def run(method: str, phase: float, low: float | None = None, high: float | None = None, **more) -> dict:
    """The fabricated row of a run over 100 orbits: its phase error (rad) and the error's interval."""
    return {
        "problem": "kepler", "e": 0.2, "mu": 0.0, "status": "ok", "orbits": 100.0, "phase growth": 1.0,
        "method": method, "kind": "phasebench" if method == OWN else "heyoka", "setting": "adaptive",
        "phase median": phase, "phase, low": low or phase, "phase, high": high or phase,
    } | more  # fmt: skip


def time(method: str, us: float, spread: float = 0.0, setting: str = "adaptive") -> dict:
    """The fabricated row of a method's time per orbit in us, +- spread."""
    own = {"problem": "kepler", "e": 0.2, "method": method, "setting": setting}
    return own | {"us per orbit": us, "us, low": us - spread, "us, high": us + spread}


def tables(runs: list[dict], times: list[dict], **growth) -> dict:
    """The fabricated tables of the Kepler page; ``growth`` replaces values in the rows at the end of each run."""
    key = ("problem", "e", "method", "setting")
    ends = {"orbits": 100.0, "energy": 1e-13, "momentum": 1e-15, "phase": 1e-10, "perihelion": 1e-12}
    rows = [{k: r[k] for k in key} | ends | growth for r in runs]
    return {"kepler": pd.DataFrame(runs), TABLE: pd.DataFrame(times), "kepler_growth": pd.DataFrame(rows)}


@pytest.mark.parametrize(
    ("runs", "times", "who"),
    [
        ([run(OWN, 1e-10), run(THEIRS, 1e-10)], [time(OWN, 5), time(THEIRS, 10)], [OURS] * 3),
        ([run(OWN, 1e-10), run(THEIRS, 1e-10)], [time(OWN, 20), time(THEIRS, 10)], [PEERS] * 3),
        ([run(OWN, 1e-10), run(THEIRS, 1e-10)], [time(OWN, 9, 1), time(THEIRS, 10, 1)], [TIED] * 3),
        ([run(OWN, 1e-10)], [time(OWN, 9)], [OURS] * 3),
        ([run(THEIRS, 1e-10)], [time(THEIRS, 9)], [PEERS] * 3),
        # With phase errors from 1e-10 to 3e-9 it is uncertain whether a run reaches 1e-9.
        ([run(OWN, 9e-10, 1e-10, 3e-9), run(THEIRS, 5e-9)], [time(OWN, 5), time(THEIRS, 10)], [OURS, OURS, TIED]),
        ([run(OWN, 2e-9, 5e-10, 3e-9), run(THEIRS, 5e-10)], [time(OWN, 5), time(THEIRS, 10)], [OURS, OURS, TIED]),
        # The more expensive one wins if the cheaper one certainly misses the phase error.
        ([run(OWN, 2e-9), run(THEIRS, 5e-10)], [time(OWN, 5), time(THEIRS, 10)], [OURS, OURS, PEERS]),
        ([run(OWN, 5e-10), run(THEIRS, 2e-9, 1.1e-9, 4e-9)], [time(OWN, 50), time(THEIRS, 10)], [PEERS, PEERS, OURS]),
        # A side that may reach it but costs more loses either way.
        ([run(OWN, 5e-10), run(THEIRS, 2e-9, 5e-10, 4e-9)], [time(OWN, 5), time(THEIRS, 10)], [OURS] * 3),
        ([run(OWN, 1.1e-6), run(THEIRS, inf)], [time(OWN, 5), time(THEIRS, 1)], [OURS, NONE, NONE]),
        ([run(OWN, 1.1e-2)], [time(OWN, 5)], [NONE] * 3),
        ([run(OWN, 1e-10, status="timeout"), run(THEIRS, 1e-5)], [time(OWN, 5), time(THEIRS, 9)], [PEERS, NONE, NONE]),
    ],
    ids=[
        *("ours", "peer", "tie", "ours alone", "peer alone", "our draws", "their certainty", "they alone", "we alone"),
        *("dearer still", "none", "nobody", "failed"),
    ],
)
def test_cheaper_side_is_named(runs, times, who):
    data = tables(runs, times)
    assert page.cheapest(data["kepler"], data[TABLE])["cheaper"].tolist() == who
    ours, peers, tied = (who.count(x) for x in (OURS, PEERS, TIED))
    said = page.costs(data.get)
    assert said.measured == Count(ours, ours + peers)
    assert said.outcome == (MISSING if not ours + peers else PASS if ours >= peers else FINDING)
    assert bool(said.where) == bool(peers)
    tail = page.answer(data.get).partition("cheapest in ")[2]
    assert [int(n) for n in re.findall(r"\d+", tail)] == [ours, 3, peers, tied]


def test_cheapest_of_a_side_must_reach_the_phase_error():
    runs = [run(OWN, p, setting=s) for p, s in ((1e-3, "50 steps"), (1e-7, "150 steps"), (1e-10, "600 steps"))]
    times = [time(OWN, us, setting=s) for us, s in ((1.0, "50 steps"), (2.0, "150 steps"), (4.0, "600 steps"))]
    data = tables([*runs, run(THEIRS, 1e-10)], [*times, time(THEIRS, 3)])
    lines = page.cheapest(data["kepler"], data[TABLE])
    assert lines[OURS].tolist() == [f"{OWN} (50 steps)", f"{OWN} (150 steps)", f"{OWN} (600 steps)"]
    assert lines[f"{OURS}, µs an orbit"].tolist() == [1.0, 2.0, 4.0]
    assert lines["cheaper"].tolist() == [OURS, OURS, PEERS]
    assert lines["phase up to (rad)"].tolist() == ["1e-02", "1e-06", "1e-09"]


def test_shorter_runs_and_the_reference_do_not_compete():
    runs = [run(OWN, 1e-10), run(THEIRS, 1e-10, orbits=10.0), run("Taylor", 1e-12, kind="reference")]
    data = tables(runs, [time(OWN, 9), time(THEIRS, 1), time("Taylor", 1)])
    assert page.cheapest(data["kepler"], data[TABLE])["cheaper"].tolist() == [OURS] * 3
    untimed = tables([run(OWN, 1e-10)], [time(OWN, float("nan"))])
    assert page.costs(untimed.get) is None
    assert page.answer(untimed.get) is None


def test_table_shows_the_longest_runs():
    data = tables([run(OWN, 1e-10, orbits=10.0), run(THEIRS, 1e-10)], [time(OWN, 1), time(THEIRS, 2)])
    assert list(page.table(data.get).frame["cheaper"]) == [PEERS] * 3
    assert page.table(tables([run(OWN, 1e-10)], [time(OWN, float("nan"))]).get) is None


def test_failed_runs_are_counted():
    runs = [run(OWN, 1e-10), run(THEIRS, inf, status="diverged"), run("late", inf, status="skipped")]
    assert "1 of 3 runs" in page.table(tables(runs, [time(OWN, 1)]).get).caption


# -- the other verdicts ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("phase", "lost"), [(4.9 * 1.5e-13 * 2 * pi * 100, False), (5.1 * 1.5e-13 * 2 * pi * 100, True), (1e-6, True)]
)
def test_phase_error_beyond_the_energy_error(phase, lost):
    said = page.clocks(tables([run(THEIRS, 1e-10)], [], phase=phase).get)
    assert (said.outcome, said.measured) == (FINDING if lost else PASS, Count(int(lost), 1))
    assert said.where.startswith("heyoka, e = 0.2" if lost else "")
    perturbed, loose = (run(THEIRS, 1e-10, **more) for more in ({"mu": 0.1}, {"setting": "tolerance 1e-06"}))
    assert page.clocks(tables([perturbed, loose], [], phase=1.0).get).outcome == MISSING


@pytest.mark.parametrize(
    ("power", "phase", "holds"),
    [(1.14, 1e-3, True), (1.16, 1e-3, False), (0.86, 1e-3, True), (0.84, 1e-3, False), (1.5, 1.1e-7, False)],
)
def test_nonlinear_phase_errors_are_found(power, phase, holds):
    runs = [run(OWN, 1e-10), run(THEIRS, 1e-10, **{"phase growth": power})]
    said = page.laws(tables(runs, [], phase=phase).get)
    assert (said.outcome, said.measured) == (PASS if holds else FINDING, Count(1 + holds, 2))
    assert said.where == f"heyoka, e = 0.2: t^{power:.2f}"
    assert page.laws(tables(runs, [], phase=0.9e-7).get) is None
    loose = [runs[0], runs[1] | {"setting": "tolerance 1e-09"}]
    assert page.laws(tables(loose, [], phase=phase).get).measured == Count(1, 1)


def test_nine_in_ten_phase_errors_must_be_linear():
    runs = [run(f"m{k}", 1e-10, kind="phasebench") for k in range(9)]
    odd = [run(f"n{k}", 1e-10, **{"phase growth": 2.0}) for k in range(2)]
    assert page.laws(tables([*runs, odd[0]], [], phase=1e-3).get).outcome == PASS
    assert page.laws(tables([*runs, *odd], [], phase=1e-3).get).outcome == FINDING


def cost(method: str, seconds: float, error: float = 1e-9, problem: str = "kepler") -> dict:
    """The fabricated row of a timed run: seconds and error of a method on a problem."""
    return {"problem": problem, "method": method, "status": "ok", "seconds": seconds, "error": error}


def test_peer_settings_are_compared_at_equal_error():
    rows = [
        *(cost("heyoka", s, e) for s, e in ((1.0, 1e-7), (2.0, 1e-9), (3.0, 1e-12))),
        *(cost("heyoka-high-accuracy", s, problem=p) for s, p in ((1.0, "kepler"), (6.0, "perturbed-kepler"))),
        cost("heyoka", 3.0, problem="perturbed-kepler"),
        cost("heyoka-batch", 0.1),
        cost("rebound-ias15", 4.0),
        cost("rebound-ias15(adaptive_mode=global)", 5.0),
        cost("rebound-ias15(adaptive_mode=individual)", 1.0) | {"status": "diverged"},
    ]
    found = page.settings_tried(pd.DataFrame(rows))
    assert found["heyoka"].to_dict() == {"heyoka": 2, "heyoka-high-accuracy": 2}
    assert found["IAS15"].to_dict() == {"rebound-ias15": 1, "rebound-ias15(adaptive_mode=global)": 1.25}
    assert page.settings_tried(pd.DataFrame([cost("gauss-8", 1.0)])) == {}
    assert page.settings_tried(pd.DataFrame([cost("heyoka", 1.0, 2e-8)])) == {}


def test_diagram_shows_curves_fastest_at_some_error():
    told = [("a", 1.0, 1e-3), ("b", 2.0, 1e-8), ("c", 3.0, 1e-5), ("d", 4.0, 1e-12)]
    rows = pd.DataFrame(told, columns=["method", "seconds", "error"])
    assert figures.frontier(rows, 9) == ["b", "d", "a"]
    assert figures.frontier(rows, 1) == ["b"]
