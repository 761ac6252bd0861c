"""The trade page's sentences follow their rows, both ways; its ladders go as far as they decide."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.trade import bench_errors, choice, ladders, page, peer_rows, sweep
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.measure.timing import NONE, OPEN, OURS, PEERS, TIED
from phasebench.benchmarks.problems.scenes import BY_ID
from phasebench.integrators.driver import Solution


def row(method: str, seconds: float, error: float = 1e-10, tol: float = np.nan, **more) -> dict:
    own = {"method": method, "kind": "phasebench" if method.startswith("gauss") else "heyoka", "seconds": seconds}
    ended = {"purpose": "drift", "status": "ok", "scene": "s", "t_end": 10.0, "global_error_time": 10.0, "h": 0.1}
    return own | ended | {"global_error": error, "tol": tol} | more


def told(verdict, *rows: dict):
    """The verdict on the first row as the sweep's and the others as the ladders'."""
    return verdict({"rows": pd.DataFrame(rows[:1]), ladders.TABLE: pd.DataFrame(rows[1:])}.get)


CASES = {
    "ours": ([row("gauss-5", 1.0), row("heyoka", 1.16, tol=1e-15)], [OURS] * 3),
    "peer": ([row("gauss-5", 1.16), row("heyoka", 1.0, tol=1e-15)], [PEERS] * 3),
    "tie": ([row("gauss-5", 1.0), row("heyoka", 1.14, tol=1e-15)], [TIED] * 3),
    "tie, theirs": ([row("gauss-5", 1.14), row("heyoka", 1.0, tol=1e-15)], [TIED] * 3),
    "ours alone": ([row("gauss-5", 1.0)], [OURS] * 3),
    "peer alone": ([row("heyoka", 1.0, tol=1e-15)], [PEERS] * 3),
    # heyoka was run at 1e-9 alone, fast: what it would take for an error of 1e-9 was not measured.
    "not decided": ([row("gauss-5", 1.0), row("heyoka", 0.5, 1e-7, 1e-9)], [PEERS, PEERS, OPEN]),
    "tight enough": ([row("gauss-5", 1.0), row("heyoka", 0.5, 1e-7, 9e-15)], [PEERS, PEERS, OURS]),
    # It took longer even so: a tighter tolerance takes no less.
    "slower still": ([row("gauss-5", 1.0), row("heyoka", 3.0, 1e-7, 1e-9)], [OURS] * 3),
    # It got there, at one of its tolerances: nothing is open.
    "reached": (
        [row("gauss-5", 1.0), row("heyoka", 0.4, 1e-2, 1e-6), row("heyoka", 0.95, 1e-10, 1e-9)],
        [TIED] * 3,
    ),
    "none": ([row("gauss-5", 1.0, 1e-4), row("heyoka", 2.0, 1e-2, 1e-15)], [OURS, NONE, NONE]),
    "at the limit": ([row("gauss-5", 1.0, 1e-6)], [OURS, OURS, NONE]),
    "the cheaper of many": (
        [row("gauss-5", 9.0), row("gauss-4", 2.0), row("gauss-2", 1.0, 1e-2), row("heyoka", 3.0, tol=1e-15)],
        [OURS] * 3,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_the_cheapest_for_an_accuracy(name):
    rows, expected = CASES[name]
    assert choice.choices(pd.DataFrame(rows))["cheaper"].tolist() == expected
    said = told(page.wins, *rows)
    ours, peers, tied, open_, none = (expected.count(x) for x in (OURS, PEERS, TIED, OPEN, NONE))
    assert said.holds == (ours >= peers)
    assert (
        f"methods is cheapest in {ours}, a peer in {peers}, {tied} {'is a tie' if tied == 1 else 'are ties'}"
        in said.text
    )
    assert ("not decided" in said.text) == bool(open_)
    assert ("reached by none" in said.text) == bool(none)
    assert said.short == f"Cheapest on long scenes: ours {ours}, a peer {peers}, ties {tied}, not decided {open_} of 3."


def test_nothing_measured_is_nothing_said():
    assert page.wins({}.get) is None
    assert page.largest({}.get) is None
    assert told(page.wins, row("gauss-5", 1.0, purpose="order")) is None


def test_rows_that_did_not_end_well_are_no_choice():
    rows = pd.DataFrame([row("gauss-5", 1.0)])
    assert len(choice.long_rows(rows)) == 1
    assert choice.choices(rows.assign(status="diverged")).empty
    assert choice.choices(rows.assign(global_error_time=9.9)).empty
    assert choice.long_rows(rows.drop(columns="seconds")).empty


def test_where_the_two_sides_are_farthest_apart():
    near = [row("gauss-5", 1.0), row("heyoka", 2.0, tol=1e-15)]
    far = [r | {"scene": "t"} for r in (row("gauss-5", 1.0), row("heyoka", 4.0, tol=1e-15))]
    lost = [r | {"scene": "u"} for r in (row("gauss-5", 3.0), row("heyoka", 1.0, tol=1e-15))]
    said = told(page.largest, *near, *far, *lost)
    assert "on t to 0.001 gauss-5 takes 0.25 of the time of heyoka" in said.text
    assert "on u to 0.001 heyoka takes 0.33 of the time of gauss-5" in said.text
    assert "on u" not in told(page.largest, *near, *far).text
    assert "gauss-5 takes" not in told(page.largest, *lost).text
    assert told(page.largest, *CASES["tie"][0]) is None
    assert told(page.largest, *CASES["ours alone"][0]) is None


def test_the_table_shows_both_sides():
    rows = {"rows": pd.DataFrame(CASES["not decided"][0])}
    shown = page.table(rows.get).frame
    assert shown["cheapest of phasebench"].tolist() == ["gauss-5"] * 3
    assert shown["cheapest peer"].tolist() == ["heyoka", "heyoka", "none"]
    assert shown["its ms"].tolist() == ["500", "500", ""]
    assert shown["error up to"].tolist() == ["1e-03", "1e-06", "1e-09"]


def test_the_curves_are_of_those_that_are_cheapest_somewhere():
    rows = pd.DataFrame([row("a", 1.0, 1e-3), row("b", 2.0, 1e-8), row("c", 3.0, 1e-5), row("d", 4.0, 1e-12)])
    assert choice.frontier(rows, 9) == ["b", "d", "a"]
    assert choice.frontier(rows, 1) == ["b"]


def test_the_choices_of_a_report_are_made_once_and_anew_for_other_tables():
    first, second = (pd.DataFrame([row("gauss-5", 1.0, 1e-9)]) for _ in range(2))
    seen = [choice.of_all(choice.choices)({"rows": t}.get) for t in (first, first, second)]
    assert seen[0] is seen[1]
    assert seen[1] is not seen[2]


# -- ladders -----------------------------------------------------------------------------------------------------------

SCENE = BY_ID["henon-heiles-box-t1000"]


@pytest.fixture
def errors(monkeypatch):
    """Rows whose error and seconds are functions of the steps or of the tolerance."""

    def told(error, seconds=lambda n: 1e-3):
        def measure(scene, c, steps=None, tol=None):
            n = steps or tol
            return {"n": n, "status": "ok", "global_error": error(n), "first run": seconds(n)}

        monkeypatch.setattr(ladders, "measure", measure)

    return told


BASE = round(SCENE.t_end / SCENE.steps[0])


def test_a_ladder_of_steps_goes_wider_while_it_is_of_use(errors):
    errors(lambda n: 1e-4 * (BASE / n) ** 2)
    found = [r["n"] for r in ladders._steps(SCENE, integrator("stormer-verlet"))]
    assert found == pytest.approx([BASE, *(BASE / 1.5**k for k in range(1, 4))], rel=1e-3)
    errors(lambda n: 2e-3 * (BASE / n) ** 2)
    assert len(list(ladders._steps(SCENE, integrator("stormer-verlet")))) == 1


def test_a_method_that_is_exact_at_every_step_ends_its_ladder_at_one(errors):
    errors(lambda n: 0.0)
    steps = ladders._steps(SCENE, integrator("stormer-verlet"))
    assert [r["n"] for r in islice(steps, 100)][-1] == 1


def test_a_ladder_of_steps_goes_finer_for_a_high_order_until_it_is_enough(errors):
    errors(lambda n: 1e-8 * (BASE / n) ** 8)
    found = [r["n"] for r in ladders._steps(SCENE, integrator("gauss-4"))]
    assert max(found) == pytest.approx(BASE * 1.5, rel=1e-3)
    low = [r["n"] for r in ladders._steps(SCENE, integrator("stormer-verlet"))]
    assert max(low) == BASE
    errors(lambda n: 1e-2, lambda n: 1e-3 * n / BASE)
    dear = [r["n"] for r in ladders._steps(SCENE, integrator("gauss-4"))]
    assert dear[-2] / BASE < ladders.LONGEST / 1e-3 < dear[-1] / BASE


def test_a_ladder_of_steps_ends_where_a_run_fails(errors, monkeypatch):
    failed = {"status": "diverged", "first run": 1e-3}
    monkeypatch.setattr(ladders, "measure", lambda scene, c, steps: failed | {"n": steps})
    assert len(list(ladders._steps(SCENE, integrator("stormer-verlet")))) == 1


def test_a_ladder_of_tolerances_ends_below_the_last_accuracy(errors):
    heyoka, ias15, scipy = (integrator(x) for x in ("heyoka", "rebound-ias15", "scipy-dop853-numba"))
    errors(lambda tol: 100 * tol)
    assert [r["n"] for r in ladders._tolerances(SCENE, heyoka)] == [10.0**-k for k in range(3, 12)]
    errors(lambda tol: 1.0)
    assert [r["n"] for r in ladders._tolerances(SCENE, ias15)] == [10.0**-k for k in range(3, 16)]
    assert min(r["n"] for r in ladders._tolerances(SCENE, scipy)) == 1e-13
    errors(lambda tol: 1.0, lambda tol: 0.021)
    assert len(list(ladders._tolerances(SCENE, scipy))) == 1


def test_every_integrator_has_its_ladder_on_every_long_regular_scene():
    cells = ladders.cells()
    assert ladders.cells(quick=True) == []
    assert len({(c.key["scene"], c.key["method"]) for c in cells}) == len(cells)
    scenes = {c.key["scene"] for c in cells}
    assert scenes == {s for s in BY_ID if BY_ID[s].purpose == "drift" and BY_ID[s].regular}
    here = {c.key["method"] for c in cells if c.key["scene"] == SCENE.id}
    assert {"heyoka", "heyoka-high-accuracy", "rebound-ias15", "gauss-4", "scipy-dop853-numba"} < here
    assert "rebound-whfast" not in here
    assert all(c.own for c in cells)


@pytest.mark.parametrize(("id", "size"), [("stormer-verlet", {"steps": 20_000}), ("heyoka", {"tol": 1e-9})])
def test_a_row_of_a_ladder_is_that_of_the_sweep(id, size):
    c = integrator(id)
    found = ladders.measure(SCENE, c, **size)
    h = SCENE.t_end / size["steps"] if "steps" in size else None
    wanted = sweep.measure(sweep.Task(SCENE.id, id, (), h, tol=size.get("tol")), repeats=1)
    same = ("scene", "method", "kind", "purpose", "t_end", "global_error_time", "status", "h", "tol")
    assert found["global_error"] == pytest.approx(wanted["global_error"], rel=1e-9)
    assert {k: found[k] for k in same} == {k: wanted.get(k) for k in same}
    assert bench_errors.bench_ladders(lambda table: [found]) is None
    with pytest.raises(AssertionError):
        bench_errors.bench_ladders(lambda table: [found | {"seconds": 0.0}])


# -- seconds -----------------------------------------------------------------------------------------------------------


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
    assert ladders.measure(SCENE, integrator("heyoka"), tol=1e-6)["seconds"] == 2e-3
    clock(21)  # it is not repeated
    assert ladders.measure(SCENE, integrator("heyoka"), tol=1e-6)["seconds"] == 21e-3
    clock(5, 1, 2)
    assert sweep.measure(sweep.Task(SCENE.id, "stormer-verlet", (), 0.05))["seconds"] == 2e-3
    # The second one is of the run with rows.
    clock(5, 77, 1, 2)
    assert sweep.measure(sweep.Task(SCENE.id, "heyoka", (), None, tol=1e-6))["seconds"] == 2e-3
