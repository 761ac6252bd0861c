"""The Wisdom-Holman page: its verdicts follow its rows, passing and failing; rows are medians of alternating runs."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.wisdom_holman import bench_wisdom_holman, page, pairs, rivals
from phasebench.benchmarks.measure import clock
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.timing import NONE, OURS, PEERS, TIED
from phasebench.benchmarks.page.verdict import FAIL, FINDING, MISSING, PASS, Count, Range
from support.pages import judge

PAIR = {
    "problem": "solar", "method": "wisdom-holman", page.ERROR: 1e-6, page.THEIR_ERROR: 1e-6, "time ratio": 1.0,
    "distance of early positions": 1e-12,
}  # fmt: skip


# -- pairs of methods --------------------------------------------------------------------------------------------------


def test_pairs_run_hundreds_of_orbits_at_doubled_steps():
    orbits = {case: t_end / (2 * np.pi) for case, (name, _, _, t_end) in pairs.CASES.items() if "kepler" in name}
    assert [int(n) for n in orbits.values()] == [318, 318]
    turns = {case: [2 * np.pi / h for h in pairs.CASES[case][2]] for case in orbits}
    np.testing.assert_allclose([*turns.values()], [[25, 50, 100], [50, 100, 200]], rtol=1e-14)
    assert pairs.CASES["outer-solar-system"][2:] == ([50.0, 100.0, 200.0, 400.0], 500_000.0)
    assert all(cell.own for cell in pairs.cells())
    assert pairs.cells(quick=True) == []
    assert len(pairs.cells()) == len(pairs.PAIRS) * (3 + 3 + 4)


def test_failed_pair_raises(monkeypatch):
    lost = SimpleNamespace(status="diverged", reason="it fell", method=SimpleNamespace(label="who"))
    monkeypatch.setattr(pairs, "integrator", lambda name: SimpleNamespace(run=lambda *of, **how: lost))
    with pytest.raises(RuntimeError, match=": it fell"):
        pairs.measure_rows("perturbed-kepler, e = 0.2", "wisdom-holman", 0.1)


@pytest.mark.parametrize(("worst", "holds"), [(1.04e-6, True), (1.06e-6, False), (0.96e-6, True), (0.94e-6, False)])
def test_equality_of_splittings_by_the_worst_pair(worst, holds):
    said = judge(page.same, "wisdom_holman", PAIR, PAIR | {page.ERROR: worst}, PAIR)
    assert said.outcome == (PASS if holds else FAIL)
    assert said.measured == pytest.approx(100 * abs(worst * 1e6 - 1))


def test_errors_at_round_off_are_no_evidence():
    near = PAIR | {page.ERROR: 0.9e-11, page.THEIR_ERROR: 5e-11}
    assert judge(page.same, "wisdom_holman", PAIR, near).measured == 0
    assert judge(page.same, "wisdom_holman", near) is None
    for error in (page.ERROR, page.THEIR_ERROR):
        assert judge(page.same, "wisdom_holman", PAIR | {error: page.ROUND_OFF}) is None
    for errors in ({page.ERROR: 1.1e-11}, {page.ERROR: 5e-11, page.THEIR_ERROR: 1.1e-11}):
        assert judge(page.same, "wisdom_holman", PAIR, near | errors).outcome == FAIL


def test_early_position_differences_fail_the_bench():
    far = PAIR | {"distance of early positions": 3e-9}
    assert bench_wisdom_holman.off([far | {"h": 1.0}]) == []
    assert len(bench_wisdom_holman.off([far | {"h": 1.0, "distance of early positions": 1.1e-8}])) == 1


@pytest.mark.parametrize(("ratio", "holds"), [(1.4, True), (1.5, True), (1.6, False)])
def test_cost_is_the_median_on_the_slowest_problem(ratio, holds):
    fast = [PAIR | {"problem": "kepler", "time ratio": 0.1}] * 3
    slow = [PAIR | {"time ratio": x} for x in (0.1, ratio, 9.0)]
    said = judge(page.cost, "wisdom_holman", *slow, *fast)
    assert (said.outcome, said.where) == (PASS if holds else FINDING, "solar")
    assert said.measured == Range(0.1, ratio)


# -- all methods -------------------------------------------------------------------------------------------------------


def rival(method: str, cost: float, error: float = 1e-10, spread: float = 0.1, **more) -> dict:
    """The fabricated row of a method: energy error, and cost per step in ns +- spread."""
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
        # The cheaper one misses the error, and the cheapest of its side is not the first row.
        (
            [rival("wisdom-holman", 1.0, 1e-7), rival("wisdom-holman-saba-4", 3.0, 1e-13)]
            + [rival("rebound-saba-4", 9.0), rival("rebound-whfast", 2.0)],
            [OURS, PEERS, OURS],
        ),
        ([rival("wisdom-holman", 5.0), rival("rebound-whfast", 1.0, status="diverged")], [OURS, OURS, NONE]),
    ],
    ids=["ours", "peer", "tie", "wide", "ours alone", "peer alone", "by error", "failed"],
)
def test_cheapest_method_of_the_table(rows, who):
    table = pd.DataFrame(rows)
    assert page.cheapest(table)["cheaper"].tolist() == who
    said = judge(page.winners, rivals.TABLE, *rows)
    ours, peers = (who.count(x) for x in (OURS, PEERS))
    assert said.measured == Count(ours, ours + peers)
    assert said.outcome == (MISSING if not ours + peers else PASS if ours >= peers else FINDING)
    assert bool(said.where) == bool(peers)


def test_table_has_the_requested_errors():
    rows = [rival("wisdom-holman", 1.0, e) for e in (1.1e-6, 1.1e-9, 1.1e-12)]
    assert page.cheapest(pd.DataFrame(rows[:1]))["cheaper"].tolist() == [NONE] * 3
    assert page.cheapest(pd.DataFrame(rows[1:2]))["cheaper"].tolist() == [OURS, NONE, NONE]
    assert page.cheapest(pd.DataFrame(rows[2:]))["cheaper"].tolist() == [OURS, OURS, NONE]
    shown = page.table({rivals.TABLE: pd.DataFrame([rival("wisdom-holman", 1.0, 1e-12)])}.get).frame
    assert shown["energy error up to"].tolist() == ["1e-06", "1e-09", "1e-12"]
    assert set(shown["cheapest of phasebench"]) == {"wisdom-holman, h = 100"}
    assert set(shown["ns, phasebench"]) == {"1 [0.9, 1.1]"}
    assert set(shown["cheapest of REBOUND"]) == {"none"}


def test_vector_code_is_compared_where_both_ran():
    one = [rival(page.SCALAR, x, h=h) for x, h in ((8.0, 50.0), (6.0, 100.0), (9.0, 200.0))]
    many = [rival(page.VECTORS, x, h=h) for x, h in ((1.0, 50.0), (1.5, 100.0))]
    assert page.vector_gain(pd.DataFrame(one + many)).tolist() == [8, 4]
    off = rival(page.VECTORS, np.nan, status="skipped", reason="REBOUND finds no AVX512 here")
    for rows in ([*one, off], one, many):
        assert page.vector_gain(pd.DataFrame(rows)).empty
    assert off["reason"] in page._vectors(pd.DataFrame([*one, off]))


def test_answer_has_the_ratios_and_the_wins():
    tables = {"wisdom_holman": [PAIR, PAIR | {"problem": "kepler", "time ratio": 0.2}]}
    tables[rivals.TABLE] = [rival("wisdom-holman", 5.35), rival("rebound-whfast", 6.17)]
    said = page.answer({name: pd.DataFrame(rows) for name, rows in tables.items()}.get)
    assert re.findall(r"[\d.]*\d", said) == ["0.2", "1", "3", "2", "0", "0"]
    assert page.answer({}.get) is None


# -- measurements ------------------------------------------------------------------------------------------------------


def test_every_variant_of_rebound_is_measured():
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


@pytest.fixture
def fake_clocks(monkeypatch):
    """Short runs, and clocks that return 99 (warm-up, not counted), 1, 2, 3, ... seconds."""
    run = Integrator.run

    def short(self, problem, **how):
        return run(self, problem, **how | {"steps": min(how["steps"], 400)})

    def told(*_, **__):
        spent = iter([99.0, *range(1, 99)])
        return lambda: float(next(spent))

    monkeypatch.setattr(Integrator, "run", short)
    monkeypatch.setattr(clock, "clock", told)


def test_times_are_medians_of_alternating_rounds(fake_clocks, monkeypatch):
    chosen = [c for c in rivals.rivals() if c.id in ("wisdom-holman", "rebound-whfast-plain", "rebound-whfast512")]
    monkeypatch.setattr(rivals, "rivals", lambda: chosen)
    monkeypatch.setattr(rivals, "ROUNDS", 3)
    monkeypatch.setitem(pairs.CASES, "perturbed-kepler, e = 0.2", ("perturbed-kepler", {"e": 0.2}, [0.1], 40.0))
    rows = rivals.measure_rows("perturbed-kepler, e = 0.2")[rivals.TABLE]
    by = {r["method"]: r for r in rows}
    assert by["rebound-whfast512"]["status"] == "skipped"
    assert "Newtonian gravity alone" in by["rebound-whfast512"]["reason"]
    for name in ("wisdom-holman", "rebound-whfast-plain"):
        per = 1e9 / rivals.TIMED / 0.1
        assert [by[name][c] for c in (page.COST, page.LOW, page.HIGH)] == pytest.approx([2 * per, 1 * per, 3 * per])
    assert by["wisdom-holman"][page.ERROR] == pytest.approx(by["rebound-whfast-plain"][page.ERROR], rel=1e-3)


def test_row_of_a_pair_has_medians_and_largest_distance(fake_clocks, monkeypatch):
    monkeypatch.setattr(pairs, "ROUNDS", 3)
    monkeypatch.setitem(pairs.CASES, "perturbed-kepler, e = 0.2", ("perturbed-kepler", {"e": 0.2}, [0.1], 40.0))
    (row,) = pairs.measure_rows("perturbed-kepler, e = 0.2", "wisdom-holman", 0.1)["wisdom_holman"]
    per = 2e9 / pairs.TIMED
    assert (row["ns per step"], row["REBOUND's ns per step"]) == pytest.approx((per, per))
    assert (row["time ratio"], row["ratio, low"], row["ratio, high"]) == (1.0, 1.0, 1.0)
    assert 0 < row["distance of early positions"] <= row["distance of end positions"] * 100 < 1e-9
    assert row["energy error"] == pytest.approx(row["REBOUND's energy error"], rel=1e-3)
    other = pairs.PAIRS | {"wisdom-holman": "rebound-saba-4"}
    monkeypatch.setattr(pairs, "PAIRS", other)
    (wrong,) = pairs.measure_rows("perturbed-kepler, e = 0.2", "wisdom-holman", 0.1)["wisdom_holman"]
    assert bench_wisdom_holman.off([wrong])
    assert page.same({"wisdom_holman": pd.DataFrame([wrong])}.get).outcome == FAIL


def test_energy_error_is_the_largest_of_either_sign():
    system = SimpleNamespace(H=None, observe=lambda H, q, p: np.array(q))
    made = SimpleNamespace(system=system)
    assert pairs.energy_error(made, [2.0, 2.1, 1.6, 2.0], None) == pytest.approx(0.2)
    assert pairs.energy_error(made, [-2.0, -2.6, -1.9], None) == pytest.approx(0.3)


def test_distances_of_a_pair_are_relative(fake_clocks, monkeypatch):
    """Two runs of size 20 differ by 0.02 early, by 4 in the middle and by 1 at the end."""
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
    (row,) = pairs.measure_rows("perturbed-kepler, e = 0.2", "wisdom-holman", 0.1)["wisdom_holman"]
    assert row["distance of early positions"] == pytest.approx(1e-3)
    assert row["distance of end positions"] == pytest.approx(0.05)
