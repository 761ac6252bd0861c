"""The Wisdom-Holman page's sentences follow their rows, both ways; its rows are of medians in turns."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.wisdom_holman import bench_wisdom_holman, page, pairs, rivals
from phasebench.benchmarks.measure import clock
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.timing import NONE, OURS, PEERS, TIED

PAIR = {
    "problem": "solar", "method": "wisdom-holman", page.ERROR: 1e-6, page.THEIR_ERROR: 1e-6, "time ratio": 1.0,
    "distance of early positions": 1e-12,
}  # fmt: skip


def told(verdict, table: str, *rows: dict):
    return verdict({table: pd.DataFrame(rows)}.get)


# -- the pairs ---------------------------------------------------------------------------------------------------------


def test_pairs_are_run_over_hundreds_of_orbits_at_steps_that_double():
    orbits = {case: t_end / (2 * np.pi) for case, (name, _, _, t_end) in pairs.CASES.items() if "kepler" in name}
    assert [int(n) for n in orbits.values()] == [318, 318]
    turns = {case: [2 * np.pi / h for h in pairs.CASES[case][2]] for case in orbits}
    np.testing.assert_allclose([*turns.values()], [[25, 50, 100], [50, 100, 200]], rtol=1e-14)
    assert pairs.CASES["outer-solar-system"][2:] == ([50.0, 100.0, 200.0, 400.0], 500_000.0)
    assert all(cell.own for cell in pairs.cells())
    assert pairs.cells(quick=True) == []
    assert len(pairs.cells()) == len(pairs.PAIRS) * (3 + 3 + 4)


def test_a_pair_that_does_not_arrive_is_no_row(monkeypatch):
    lost = SimpleNamespace(status="diverged", reason="it fell", method=SimpleNamespace(label="who"))
    monkeypatch.setattr(pairs, "integrator", lambda name: SimpleNamespace(run=lambda *of, **how: lost))
    with pytest.raises(RuntimeError, match=": it fell"):
        pairs.measured("perturbed-kepler, e = 0.2", "wisdom-holman", 0.1)


@pytest.mark.parametrize(("worst", "holds"), [(1.04e-6, True), (1.06e-6, False), (0.96e-6, True), (0.94e-6, False)])
def test_the_same_splitting_is_told_by_the_worst_pair(worst, holds):
    said = told(page.same, "wisdom_holman", PAIR, PAIR | {page.ERROR: worst}, PAIR)
    assert said.holds == holds
    apart = f"by at most {100 * abs(worst * 1e6 - 1):.1g} %"
    assert apart in said.text
    assert said.short == f"Energy errors differ from REBOUND's {apart}."


def test_errors_of_round_off_are_no_evidence():
    near = PAIR | {page.ERROR: 0.9e-11, page.THEIR_ERROR: 5e-11}
    assert told(page.same, "wisdom_holman", PAIR, near).holds
    assert "(1 of 2 rows)" in told(page.same, "wisdom_holman", PAIR, near).text
    assert told(page.same, "wisdom_holman", near) is None
    for error in (page.ERROR, page.THEIR_ERROR):
        assert told(page.same, "wisdom_holman", PAIR | {error: page.ROUND_OFF}) is None
    assert not told(page.same, "wisdom_holman", PAIR, near | {page.ERROR: 1.1e-11}).holds
    assert not told(page.same, "wisdom_holman", PAIR, near | {page.ERROR: 5e-11, page.THEIR_ERROR: 1.1e-11}).holds


def test_the_greatest_early_distance_is_named():
    far = PAIR | {"distance of early positions": 3e-9}
    assert "3.00e-09" in told(page.same, "wisdom_holman", PAIR, far, PAIR).text
    assert bench_wisdom_holman.off([far | {"h": 1.0}]) == []
    assert len(bench_wisdom_holman.off([far | {"h": 1.0, "distance of early positions": 1.1e-8}])) == 1


@pytest.mark.parametrize(("ratio", "holds"), [(1.4, True), (1.5, True), (1.6, False)])
def test_the_cost_is_the_median_of_the_slowest_problem(ratio, holds):
    fast = [PAIR | {"problem": "kepler", "time ratio": 0.1}] * 3
    slow = [PAIR | {"time ratio": x} for x in (0.1, ratio, 9.0)]
    said = told(page.cost, "wisdom_holman", *slow, *fast)
    assert said.holds == holds
    assert f"solar {ratio:.2f}; kepler 0.10" in said.text


# -- everybody ---------------------------------------------------------------------------------------------------------


def rival(method: str, cost: float, error: float = 1e-10, spread: float = 0.1, **more) -> dict:
    kind = "rebound" if method.startswith("rebound") else "phasebench"
    row = {"problem": "solar", "kind": kind, "method": method, "h": 100.0, "status": "ok", "reason": ""}
    return row | {page.ERROR: error, page.COST: cost, page.LOW: cost - spread, page.HIGH: cost + spread} | more


@pytest.mark.parametrize(
    ("rows", "who"),
    [
        ([rival("wisdom-holman", 5.35), rival("rebound-whfast", 6.17)], [OURS, OURS, NONE]),
        ([rival("wisdom-holman-corrector", 6.17), rival("rebound-whfast", 5.35)], [PEERS, PEERS, NONE]),
        ([rival("wisdom-holman", 6.17), rival("rebound-whfast", 6.0)], [TIED, TIED, NONE]),
        ([rival("wisdom-holman", 6.17, spread=0.5), rival("rebound-whfast", 5.35, spread=0.5)], [TIED, TIED, NONE]),
        ([rival("wisdom-holman", 6.17)], [OURS, OURS, NONE]),
        ([rival("rebound-whfast", 6.17)], [PEERS, PEERS, NONE]),
        # The cheaper one does not get there, and the cheapest of its side is not the first.
        (
            [rival("wisdom-holman", 1.0, 1e-7), rival("wisdom-holman-saba-4", 3.0, 1e-13)]
            + [rival("rebound-saba-4", 9.0), rival("rebound-whfast", 2.0)],
            [OURS, PEERS, OURS],
        ),
        ([rival("wisdom-holman", 5.0), rival("rebound-whfast", 1.0, status="diverged")], [OURS, OURS, NONE]),
    ],
    ids=["ours", "peer", "tie", "wide", "ours alone", "peer alone", "by error", "failed"],
)
def test_the_cheapest_is_the_true_one_of_the_table(rows, who):
    table = pd.DataFrame(rows)
    assert page.cheapest(table)["cheaper"].tolist() == who
    said = told(page.winners, rivals.TABLE, *rows)
    ours, peers, tied, none = (who.count(x) for x in (OURS, PEERS, TIED, NONE))
    assert said.holds == (ours >= peers)
    assert f"splittings in {ours}, one of REBOUND's in {peers}, a tie in {tied}" in said.text
    assert (f"none gets there in {none}" in said.text) == bool(none)
    assert said.short == f"Cheapest for an energy error: ours {ours}, REBOUND {peers}, ties {tied} of 3."


def test_the_errors_wanted_are_those_of_the_table():
    rows = [rival("wisdom-holman", 1.0, e) for e in (1.1e-6, 1.1e-9, 1.1e-12)]
    assert page.cheapest(pd.DataFrame(rows[:1]))["cheaper"].tolist() == [NONE] * 3
    assert page.cheapest(pd.DataFrame(rows[1:2]))["cheaper"].tolist() == [OURS, NONE, NONE]
    assert page.cheapest(pd.DataFrame(rows[2:]))["cheaper"].tolist() == [OURS, OURS, NONE]
    shown = page.table({rivals.TABLE: pd.DataFrame([rival("wisdom-holman", 1.0, 1e-12)])}.get).frame
    assert shown["energy error up to"].tolist() == ["1e-06", "1e-09", "1e-12"]
    assert set(shown["cheapest of phasebench"]) == {"wisdom-holman, h = 100"}
    assert set(shown["ns, phasebench"]) == {"1 [0.9, 1.1]"}
    assert set(shown["cheapest of REBOUND"]) == {"none"}


def test_the_vector_code_is_compared_or_its_absence_explained():
    one = [rival(page.SCALAR, x, h=h) for x, h in ((8.0, 50.0), (6.0, 100.0), (9.0, 200.0))]
    many = [rival(page.VECTORS, x, h=h) for x, h in ((1.0, 50.0), (1.5, 100.0))]
    assert "is 4 to 8 times as fast as WHFast" in page.vectors(pd.DataFrame(one + many))
    why = "REBOUND finds no AVX512 here"
    off = rival(page.VECTORS, np.nan, status="skipped", reason=why)
    assert page.vectors(pd.DataFrame([*one, off])) == f"WHFast512 has no row: {why}."
    assert "it was not measured" in page.vectors(pd.DataFrame(one))
    assert "where WHFast did not" in page.vectors(pd.DataFrame(many))


# -- what is measured --------------------------------------------------------------------------------------------------


def test_everybody_is_at_its_best():
    ids = {c.id for c in rivals.rivals()}
    theirs = {i.removeprefix("rebound-") for i in ids if i.startswith("rebound-")}
    kernels = {f"whfast({k}, corrector2)" for k in ("default", "lazy", "modifiedkick", "composition")}
    others = {f"whfast(coordinates={c})" for c in ("democraticheliocentric", "whds", "barycentric")}
    assert theirs >= {"whfast", "whfast-plain", "whfast-modifiedkick", "whfast-composition", *kernels, *others}
    assert theirs >= {*(f"whfast-corrector-{n}" for n in (3, 5, 7, 11, 17)), "whfast512", "whfast512-corrector-17"}
    assert len([i for i in theirs if i.startswith("saba")]) == 18
    labels = [c.label for c in rivals.rivals()]
    assert len(set(labels)) == len(labels)
    assert {f"wisdom-holman-corrector(corrector={n})" for n in (3, 5, 7, 11, 17)} < set(labels)
    assert {"wisdom-holman-aba-8-6-4", "wisdom-holman-saba-2"} < set(labels)
    assert 200.0 in pairs.CASES["outer-solar-system"][2]


@pytest.fixture
def timed(monkeypatch):
    """Runs that are short, and clocks that tell 9, 1, 2, 3, ... seconds in turn, the first of which is not counted."""
    run = Integrator.run

    def short(self, problem, **how):
        return run(self, problem, **how | {"steps": min(how["steps"], 400)})

    def told(*_, **__):
        spent = iter([99.0, *range(1, 99)])
        return lambda: float(next(spent))

    monkeypatch.setattr(Integrator, "run", short)
    monkeypatch.setattr(clock, "clock", told)


def test_times_of_rivals_are_medians_of_rounds_in_turns(timed, monkeypatch):
    chosen = [c for c in rivals.rivals() if c.id in ("wisdom-holman", "rebound-whfast-plain", "rebound-whfast512")]
    monkeypatch.setattr(rivals, "rivals", lambda: chosen)
    monkeypatch.setattr(rivals, "ROUNDS", 3)
    monkeypatch.setitem(pairs.CASES, "perturbed-kepler, e = 0.2", ("perturbed-kepler", {"e": 0.2}, [0.1], 40.0))
    rows = rivals.measured("perturbed-kepler, e = 0.2")[rivals.TABLE]
    by = {r["method"]: r for r in rows}
    assert by["rebound-whfast512"]["status"] == "skipped"
    assert "Newtonian gravity alone" in by["rebound-whfast512"]["reason"]
    for name in ("wisdom-holman", "rebound-whfast-plain"):
        per = 1e9 / rivals.TIMED / 0.1
        assert [by[name][c] for c in (page.COST, page.LOW, page.HIGH)] == pytest.approx([2 * per, 1 * per, 3 * per])
    assert by["wisdom-holman"][page.ERROR] == pytest.approx(by["rebound-whfast-plain"][page.ERROR], rel=1e-3)


def test_a_pair_is_of_medians_and_of_the_greatest_distance(timed, monkeypatch):
    monkeypatch.setattr(pairs, "ROUNDS", 3)
    monkeypatch.setitem(pairs.CASES, "perturbed-kepler, e = 0.2", ("perturbed-kepler", {"e": 0.2}, [0.1], 40.0))
    (row,) = pairs.measured("perturbed-kepler, e = 0.2", "wisdom-holman", 0.1)["wisdom_holman"]
    per = 2e9 / pairs.TIMED
    assert (row["ns per step"], row["REBOUND's ns per step"]) == pytest.approx((per, per))
    assert (row["time ratio"], row["ratio, low"], row["ratio, high"]) == (1.0, 1.0, 1.0)
    assert 0 < row["distance of early positions"] <= row["distance of end positions"] * 100 < 1e-9
    assert row["energy error"] == pytest.approx(row["REBOUND's energy error"], rel=1e-3)
    other = pairs.PAIRS | {"wisdom-holman": "rebound-saba-4"}
    monkeypatch.setattr(pairs, "PAIRS", other)
    (wrong,) = pairs.measured("perturbed-kepler, e = 0.2", "wisdom-holman", 0.1)["wisdom_holman"]
    assert bench_wisdom_holman.off([wrong])
    assert not page.same({"wisdom_holman": pd.DataFrame([wrong])}.get).holds


def test_the_energy_error_is_the_greatest_of_either_sign():
    system = SimpleNamespace(H=None, observe=lambda H, q, p: np.array(q))
    made = SimpleNamespace(system=system)
    assert pairs.energy_error(made, [2.0, 2.1, 1.6, 2.0], None) == pytest.approx(0.2)
    assert pairs.energy_error(made, [-2.0, -2.6, -1.9], None) == pytest.approx(0.3)


def test_distances_of_a_pair_are_parts_of_its_size(timed, monkeypatch):
    """Two runs about 20 units wide that are 0.02 apart soon, 4 apart in the middle, and 1 apart at their end."""
    theirs = 20 * np.ones((pairs.ROWS + 1, 2))
    apart = np.zeros_like(theirs)
    apart[5, 1], apart[pairs.ROWS // 2, 0], apart[-1, 0] = -0.02, 4.0, -1.0

    def made(name):
        q = theirs if name.startswith("rebound") else theirs + apart
        method = SimpleNamespace(label=name)
        s = SimpleNamespace(q=q, p=q, status="ok", reason="", seconds=1.0, method=method)
        return SimpleNamespace(run=lambda *of, **how: s)

    monkeypatch.setattr(pairs, "integrator", made)
    monkeypatch.setattr(pairs, "energy_error", lambda *of: 0.0)
    (row,) = pairs.measured("perturbed-kepler, e = 0.2", "wisdom-holman", 0.1)["wisdom_holman"]
    assert row["distance of early positions"] == pytest.approx(1e-3)
    assert row["distance of end positions"] == pytest.approx(0.05)
