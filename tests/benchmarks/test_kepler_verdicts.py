"""The Kepler page's sentences follow their rows, both ways."""

from __future__ import annotations

from math import inf, pi

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.kepler import page
from phasebench.benchmarks.experiments.kepler.times import TABLE
from phasebench.benchmarks.measure.timing import NONE, OURS, PEERS, TIED

OWN, THEIRS = "gauss-8", "heyoka"


def run(method: str, phase: float, low: float | None = None, high: float | None = None, **more) -> dict:
    return {
        "problem": "kepler", "e": 0.2, "mu": 0.0, "status": "ok", "orbits": 100.0, "phase growth": 1.0,
        "method": method, "kind": "phasebench" if method == OWN else "heyoka", "setting": "adaptive",
        "phase median": phase, "phase, low": low or phase, "phase, high": high or phase,
    } | more  # fmt: skip


def time(method: str, us: float, spread: float = 0.0, setting: str = "adaptive") -> dict:
    own = {"problem": "kepler", "e": 0.2, "method": method, "setting": setting}
    return own | {"us per orbit": us, "us, low": us - spread, "us, high": us + spread}


def tables(runs: list[dict], times: list[dict], **growth) -> dict:
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
        # One draw of 1e-10 whose neighbours reach 3e-9 is no follower to 1e-9, and none that certainly is not.
        ([run(OWN, 9e-10, 1e-10, 3e-9), run(THEIRS, 5e-9)], [time(OWN, 5), time(THEIRS, 10)], [OURS, OURS, TIED]),
        ([run(OWN, 2e-9, 5e-10, 3e-9), run(THEIRS, 5e-10)], [time(OWN, 5), time(THEIRS, 10)], [OURS, OURS, TIED]),
        # The dearer one wins all the same where the cheaper certainly does not get there.
        ([run(OWN, 2e-9), run(THEIRS, 5e-10)], [time(OWN, 5), time(THEIRS, 10)], [OURS, OURS, PEERS]),
        ([run(OWN, 5e-10), run(THEIRS, 2e-9, 1.1e-9, 4e-9)], [time(OWN, 50), time(THEIRS, 10)], [PEERS, PEERS, OURS]),
        # Where it may get there, it would be the dearer one still.
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
def test_the_cheaper_on_kepler_is_named(runs, times, who):
    data = tables(runs, times)
    assert page.cheapest(data["kepler"], data[TABLE])["cheaper"].tolist() == who
    ours, peers, tied, none = (who.count(x) for x in (OURS, PEERS, TIED, NONE))
    said = page.costs(data.get)
    assert said.holds == (ours >= peers)
    assert f"methods in {ours}, a peer in {peers}; {tied} {'is a tie' if tied == 1 else 'are ties'}" in said.text
    assert (f"{none} reached by none" in said.text) == bool(none)
    assert said.short == f"Cheapest over 100 orbits: ours {ours}, peers {peers}, ties {tied} of 3."


def test_the_cheapest_of_a_side_is_the_cheapest_that_gets_there():
    runs = [run(OWN, p, setting=s) for p, s in ((1e-3, "50 steps"), (1e-7, "150 steps"), (1e-10, "600 steps"))]
    times = [time(OWN, us, setting=s) for us, s in ((1.0, "50 steps"), (2.0, "150 steps"), (4.0, "600 steps"))]
    data = tables([*runs, run(THEIRS, 1e-10)], [*times, time(THEIRS, 3)])
    lines = page.cheapest(data["kepler"], data[TABLE])
    assert lines[OURS].tolist() == [f"{OWN} (50 steps)", f"{OWN} (150 steps)", f"{OWN} (600 steps)"]
    assert lines[f"{OURS}, µs an orbit"].tolist() == [1.0, 2.0, 4.0]
    assert lines["cheaper"].tolist() == [OURS, OURS, PEERS]
    assert lines["phase up to (rad)"].tolist() == ["1e-02", "1e-06", "1e-09"]


def test_shorter_runs_and_the_reference_follow_nothing():
    runs = [run(OWN, 1e-10), run(THEIRS, 1e-10, orbits=10.0), run("Taylor", 1e-12, kind="reference")]
    data = tables(runs, [time(OWN, 9), time(THEIRS, 1), time("Taylor", 1)])
    assert page.cheapest(data["kepler"], data[TABLE])["cheaper"].tolist() == [OURS] * 3
    said = page.costs(data.get)
    assert said.text.startswith("Following the phase over 100 orbits")
    assert said.short.startswith("Cheapest over 100 orbits")
    untimed = tables([run(OWN, 1e-10)], [time(OWN, float("nan"))])
    assert page.costs(untimed.get) is None


def test_the_table_names_the_longest_runs_and_the_page_its_steps():
    data = tables([run(OWN, 1e-10, orbits=10.0), run(THEIRS, 1e-10)], [time(OWN, 1), time(THEIRS, 2)])
    shown = page.table(data.get)
    assert shown.caption.startswith("The cheapest that follow the phase over 100 orbits")
    assert list(shown.frame["cheaper"]) == [PEERS] * 3
    assert page.table(tables([run(OWN, 1e-10)], [time(OWN, float("nan"))]).get) is None
    assert any("Fixed steps: 50 to 2400 an orbit" in said for said in page.PAGE.setting)


# -- the other sentences -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("phase", "lost"), [(4.9 * 1.5e-13 * 2 * pi * 100, False), (5.1 * 1.5e-13 * 2 * pi * 100, True), (1e-6, True)]
)
def test_a_lost_clock_is_told_from_an_energy_error(phase, lost):
    said = page.clocks(tables([run(THEIRS, 1e-10)], [], phase=phase).get)
    assert said.holds == (not lost)
    assert ("heyoka at e = 0.2" in said.text) == lost
    assert page.clocks(tables([run(THEIRS, 1e-10, mu=0.1)], [], phase=1.0).get).holds
    assert page.clocks(tables([run(THEIRS, 1e-10, setting="tolerance 1e-06")], [], phase=1.0).get).holds


def test_runs_that_do_not_get_through_are_counted():
    runs = [run(OWN, 1e-10), run(THEIRS, inf, status="diverged"), run("late", inf, status="skipped")]
    assert page.clocks(tables(runs, []).get).text.startswith("1 of 3 runs do not get through")


@pytest.mark.parametrize(
    ("power", "phase", "holds"),
    [(1.14, 1e-3, True), (1.16, 1e-3, False), (0.86, 1e-3, True), (0.84, 1e-3, False), (1.5, 1.1e-7, False)],
)
def test_phase_errors_that_are_not_linear_are_found(power, phase, holds):
    runs = [run(OWN, 1e-10), run(THEIRS, 1e-10, **{"phase growth": power})]
    said = page.laws(tables(runs, [], phase=phase).get)
    assert said.holds == holds
    assert (f"heyoka at e = 0.2 (t^{power:.2f})" in said.text) != holds
    assert page.laws(tables(runs, [], phase=0.9e-7).get) is None
    loose = [runs[0], runs[1] | {"setting": "tolerance 1e-09"}]
    assert page.laws(tables(loose, [], phase=phase).get).holds


def test_nine_in_ten_are_linear():
    runs = [run(f"m{k}", 1e-10, kind="phasebench") for k in range(9)]
    odd = [run(f"n{k}", 1e-10, **{"phase growth": 2.0}) for k in range(2)]
    assert page.laws(tables([*runs, odd[0]], [], phase=1e-3).get).holds
    assert not page.laws(tables([*runs, *odd], [], phase=1e-3).get).holds


def cost(method: str, seconds: float, error: float = 1e-9, problem: str = "kepler") -> dict:
    return {"problem": problem, "method": method, "status": "ok", "seconds": seconds, "error": error}


def test_the_settings_of_peers_are_compared_at_an_equal_error():
    rows = [
        *(cost("heyoka", s, e) for s, e in ((1.0, 1e-7), (2.0, 1e-9), (3.0, 1e-12))),
        *(cost("heyoka-high-accuracy", s, problem=p) for s, p in ((1.0, "kepler"), (6.0, "perturbed-kepler"))),
        cost("heyoka", 3.0, problem="perturbed-kepler"),
        cost("heyoka-batch", 0.1),
        cost("rebound-ias15", 4.0),
        cost("rebound-ias15(adaptive_mode=global)", 5.0),
        cost("rebound-ias15(adaptive_mode=individual)", 1.0) | {"status": "diverged"},
    ]
    said = page.tried(pd.DataFrame(rows))
    assert said.startswith("Settings tried, their time to 1e-08 over the best one's (the worse problem)")
    assert "heyoka: heyoka 2, heyoka-high-accuracy 2;" in said
    assert said.endswith("IAS15: ias15 1, ias15(adaptive_mode=global) 1.2.")
    assert page.tried(pd.DataFrame([cost("gauss-8", 1.0)])) == ""
    assert page.tried(pd.DataFrame([cost("heyoka", 1.0, 2e-8)])) == ""
