"""The audit: controls come out as declared, false labels are contradicted, nothing hangs, the page says it."""

from __future__ import annotations

import io
import time
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from phasebench.benchmarks.experiments.audit import cases, judge, measures, worker
from phasebench.benchmarks.experiments.audit.audit import Audit, audit, select
from phasebench.benchmarks.experiments.audit.judge import CONTRADICTED, HOLDS, IN_PART, UNDERSTATED, UNJUDGED
from phasebench.benchmarks.experiments.audit.page import PAGE
from phasebench.benchmarks.experiments.audit.table import TEXTS, show
from phasebench.benchmarks.measure import metrics
from phasebench.integrators.errors import InvalidInput
from phasebench.reference.peers import Claims, Run
from support.planted import control

#: The other control is `bench_audit`'s.
CONTROLS = ("stormer-verlet", "rk4", "gauss-2")


@pytest.fixture(scope="module")
def controls():
    """The audit of the controls."""
    return audit(CONTROLS, isolate=False)


def verdicts(found, peer):
    return {c["property"]: c["verdict"] for c in found.claims if c["peer"] == peer}


def relabelled(id, **claims):
    """A control under another name and other claims."""
    honest = control(id)
    return replace(honest, id=f"{id}-mislabelled", claims=replace(honest.claims, **claims))


@pytest.mark.parametrize("id", CONTROLS)
def test_controls_come_out_as_declared(controls, id):
    rows = [r for r in controls.rows if r["peer"] == id]
    assert {r["status"] for r in rows} == {"ok"}
    assert {r["measure"] for r in rows} == {worker.PREPARE, *measures.FIXED}
    assert verdicts(controls, id) == dict.fromkeys(("order", "symplectic", "reversible", "energy"), HOLDS)
    assert not controls.remarks, "all that is found is declared"
    for row in rows:
        if row["measure"] in judge.KEPT:
            assert judge.kept(row) is (id != "rk4"), row


#: Where the harmonic oscillator's energies begin to grow: 2, sqrt(8) and for Gauss's methods nowhere.
@pytest.mark.parametrize(("id", "limit"), [("stormer-verlet", 2.0), ("rk4", 8**0.5), ("gauss-2", None)])
def test_stability_limits_that_are_known(controls, id, limit):
    row = next(r for r in controls.rows if r["peer"] == id and r["measure"] == "stability")
    assert row["unconditional"] is (limit is None)
    assert limit is None or abs(row["value"] - limit) < 1e-6


@pytest.mark.parametrize("id", CONTROLS)
def test_a_cost_is_of_a_step(controls, id):
    row = next(r for r in controls.rows if r["peer"] == id and r["measure"] == "cost")
    assert row["value"] == pytest.approx(row["per_time"] * row["h"])
    assert 1e-3 < row["value"] < 10, "microseconds"


@pytest.mark.parametrize(
    ("value", "slope", "half", "verdict"),
    [
        (1e-3, 1e-9, 2e-9, True),  # no slope
        (1e-3, 5e-8, 1e-9, True),  # a slope that adds up to little
        (1e-3, 3e-7, 1e-9, None),
        (1e-3, 6e-7, 1e-9, False),
        (0.3, 1e-9, 2e-9, None),  # all energy was dissipated, and stays so
        (0.3, 2e-4, 1e-9, False),
        (0.3, 1e-4, 2e-4, None),
    ],
)
def test_an_energy_error_is_bounded_or_drifts_or_it_is_open(value, slope, half, verdict):
    row = {"status": "ok", "value": value, "slope": slope, "low": slope - half, "high": slope + half}
    assert judge.bounded(row | {"time": 1000.0, "scale": 1.0}) is verdict


@pytest.mark.parametrize(
    ("id", "false"),
    [
        ("rk4", {"order": 5}),
        ("rk4", {"symplectic": True}),
        ("rk4", {"reversible": True}),
        ("rk4", {"energy": "bounded"}),
        ("stormer-verlet", {"energy": "round-off"}),
    ],
)
def test_a_false_label_is_contradicted_and_the_others_are_not(controls, id, false):
    liar = relabelled(id, **false)
    mine = [r | {"peer": liar.id} for r in controls.rows if r["peer"] == id]
    found = {c["property"]: c for c in judge.claims(liar, "1", mine)}
    (name,) = false
    assert {n for n, c in found.items() if c["verdict"] != HOLDS} == {name}
    assert found[name]["verdict"] == CONTRADICTED
    assert found[name]["command"] == f"phasebench audit --peer {liar.id}"
    assert found[name]["problems"]


def test_a_false_label_is_contradicted_from_the_beginning():
    """The whole way, of a record that is in no registry."""
    found = audit([relabelled("rk4", order=None, symplectic=True)], quick=True)
    assert [c["property"] for c in found.contradictions] == ["symplectic"]


def _row(problem, value, half=0.01, **more):
    return {"status": "ok", "problem": problem, "value": value, "low": value - half, "high": value + half} | more


@pytest.mark.parametrize(
    ("orders", "verdict"),
    [
        ((2.01, 1.99), HOLDS),
        ((1.01, 0.98), CONTRADICTED),
        ((3.01, 2.98), UNDERSTATED),
        ((3.01, 0.98), CONTRADICTED),
        ((2.11, 2.12), UNJUDGED),
        ((3.01, 2.02), IN_PART),
        ((3.01,), UNJUDGED),
        ((2.4, 2.5), UNJUDGED),
        ((2.05, None), HOLDS),
        ((None, None), UNJUDGED),
    ],
)
def test_one_problem_alone_and_slopes_between_integers_contradict_no_order(orders, verdict):
    rows = [_row(str(i), x) if x else {"status": "ok", "problem": str(i), "reason": "-"} for i, x in enumerate(orders)]
    peer = replace(control("stormer-verlet"), claims=replace(control("rk4").claims, order=2))
    found = judge.claims(peer, "1", [r | {"peer": peer.id, "measure": "order", "reason": ""} for r in rows])
    assert found[0]["verdict"] == verdict


@pytest.mark.parametrize(
    ("id", "modest", "more"),
    [
        ("rk4", {"order": 3}, "order"),
        ("stormer-verlet", {"order": 1}, "order"),
        ("stormer-verlet", {"symplectic": False}, "symplectic"),
        ("gauss-2", {"reversible": False}, "reversible"),
        ("stormer-verlet", {"energy": "drift"}, "energy"),
    ],
)
def test_more_than_is_claimed_is_understated_of_whatever_kind(controls, id, modest, more):
    peer = relabelled(id, **modest)
    mine = [r | {"peer": peer.id} for r in controls.rows if r["peer"] == id]
    found = {c["property"]: c["verdict"] for c in judge.claims(peer, "1", mine)}
    assert found.pop(more) == UNDERSTATED
    assert set(found.values()) == {HOLDS}


def test_what_is_below_the_floor_is_not_judged():
    """A defect at the floor says nothing where the classical method's is there too, or the integrator's own error."""
    row = {"status": "ok", "value": 1e-12, "floor": 1e-12, "classical": 1e-5, "own": 1e-6}
    assert judge.kept(row) is True
    assert judge.kept(row | {"classical": 1e-11}) is None
    assert judge.kept(row | {"own": 1e-11}) is None
    assert judge.kept(row | {"value": 9e-11}) is True
    assert judge.kept(row | {"value": 1.1e-10}) is False


def test_a_claim_without_its_measure_is_not_judged_and_says_why():
    peer = replace(control("rk4"), claims=Claims(order=4))
    row = {"peer": peer.id, "measure": "package", "status": "ok", "reason": "", "problem": ""}
    (claim,) = judge.claims(peer, "1", [row])
    assert (claim["verdict"], claim["reason"]) == (UNJUDGED, "it was not measured")
    failed = row | {"measure": "cost", "status": "timeout", "reason": "it did not return"}
    (claim,) = judge.claims(peer, "1", [row, failed])
    assert (claim["verdict"], claim["reason"]) == (UNJUDGED, "it did not return")
    (claim,) = judge.claims(peer, "1", [row | {"status": "skipped", "reason": "no such package"}])
    assert (claim["verdict"], claim["reason"]) == (UNJUDGED, "skipped: no such package")


def test_a_remark_names_structures_that_nobody_claims(controls):
    rows = [r for r in controls.rows if r["peer"] in ("stormer-verlet", "rk4")]
    claimed = {"peer": "stormer-verlet", "property": "symplectic", "claim": "symplectic"}
    (remark,) = judge.remarks(rows, [claimed])
    assert remark == "reversible on the problems here, which is not claimed: stormer-verlet"
    found = judge.remarks(rows, [claimed | {"claim": "not symplectic"}])
    assert [r.split()[0] for r in found] == ["symplectic", "reversible"]
    assert all("rk4" not in r for r in found)


@pytest.mark.parametrize("missing", [None, float("nan")])
def test_what_was_not_found_is_not_judged(missing):
    assert judge.agrees({"status": "ok", "value": missing}, 2) is None
    assert judge.kept({"status": "ok", "value": 1e-9, "floor": missing}) is None
    assert judge.bounded({"status": "ok", "value": 1e-9, "slope": missing}) is None


@pytest.mark.parametrize("text", [judge.order_text, judge.structure_text, judge.energy_text])
def test_a_failed_row_is_shown_with_its_reason(text):
    row = {"status": "diverged", "problem": "kepler", "reason": "a collision", "value": 1.0, "low": 1.0, "high": 1.0}
    row |= {"floor": 1.0, "classical": 1.0, "own": 1.0, "h": 1.0, "steps": 1.0, "slope": 1.0, "time": 1.0}
    assert text(row) == "diverged (kepler: a collision)"
    assert "1" in text(row | {"status": "ok"})
    assert "collision" not in text(row | {"status": "ok"})


@pytest.mark.parametrize(("value", "kind"), [(0.09, True), (0.11, None), (0.6, None), (0.95, False)])
def test_an_order_agrees_within_the_gate(value, kind):
    row = {"status": "ok", "value": 2 + value, "low": 2 + value - 0.005, "high": 2 + value + 0.005}
    assert judge.agrees(row, 2) is kind
    assert judge.agrees(row | {"value": 2 - value, "low": 1.995 - value, "high": 2.005 - value}, 2) is kind


@pytest.mark.parametrize(("times", "verdict"), [(0.9, HOLDS), (9.0, UNJUDGED), (11.0, CONTRADICTED)])
def test_round_off_is_brouwers_law_and_ten_times_it_is_none(times, verdict):
    row = _row("a", 1.0) | {"measure": "energy", "steps": 10_000.0, "scale": 0.5, "time": 100.0, "slope": 0.0}
    law = 100 * np.finfo(float).eps * 0.5 * 100
    row |= {"value": times * law, "low": -1.0, "high": 1.0, "reason": ""}
    peer = replace(control("rk4"), claims=Claims(energy="round-off"))
    (claim,) = judge.claims(peer, "1", [row | {"peer": peer.id}])
    assert claim["verdict"] == verdict


def test_a_structure_broken_on_one_problem_contradicts_and_denied_ones_must_be_kept_on_all():
    kept = {"measure": "symplecticity", "status": "ok", "value": 1e-12, "floor": 1e-12, "classical": 1e-5, "own": 1e-5}
    kept |= {"reason": "", "h": 0.1, "steps": 1.0}
    broken = kept | {"value": 1e-6}
    for claimed, rows, verdict in (
        (True, (kept, kept), HOLDS),
        (True, (kept, broken), CONTRADICTED),
        (False, (kept, broken), HOLDS),
        (False, (kept, kept), UNDERSTATED),
        (False, (kept, kept | {"own": 1e-12}), UNJUDGED),
    ):
        peer = replace(control("rk4"), claims=Claims(symplectic=claimed))
        mine = [r | {"peer": peer.id, "problem": str(i)} for i, r in enumerate(rows)]
        assert [c["verdict"] for c in judge.claims(peer, "1", mine)] == [verdict], (claimed, verdict)


def test_a_method_that_keeps_more_than_the_state_has_no_step_matrix():
    """Leapfrog as a two-step method: a run starts with an Euler step, so two steps are not one taken twice."""

    def run(task):
        field = task.system.vector_field()
        rows = [task.state, task.state + task.h * field(0.0, task.state)]
        for _ in range(task.steps - 1):
            rows.append(rows[-2] + 2 * task.h * field(0.0, rows[-1]))
        return Run.of_states(np.array(rows)[task.numbers], task.steps, 0, 0.0)

    row = worker.row(replace(control("rk4"), id="two-step", run=run), "stability", "harmonic-oscillator")
    assert row["status"] == "skipped"
    assert "more than the state" in row["reason"]


def test_stability_cells_name_windows():
    rows = {"status": "ok", "value": 2.7, "unconditional": False, "scanned": 7.0, "grows": 0.0, "reason": ""}
    text = TEXTS["stability"]
    assert text(rows | {"intervals": "0..2.7 2.98..3.98"}) == "2.7; unstable on 2.7 to 2.98, then from 3.98"
    assert text(rows | {"intervals": "0..2.7"}) == "2.7"
    assert text(rows | {"value": 0.0, "intervals": "", "grows": 0.118}) == "0 (x 1.118 a step at 0.5)"
    assert text(rows | {"value": 10.0, "unconditional": True}) == "none up to 10"
    assert text(rows | {"value": 7.0, "reason": "Newton", "intervals": "0..7"}) == "7, the last that could be taken"


def test_a_small_leading_term_shows_at_finer_steps():
    """A clean h^2 gives way to a rough h^1 below: the order is 1."""
    k = np.arange(24)
    h = 0.5 / np.sqrt(2.0) ** k
    error = 0.1 * np.where(k < 12, h**2, h * h[12] * (1 + 0.01 * np.sin(37.0 * k)))
    assert abs(metrics.order(h, error).value - 2) < 0.01, "the control: the best fit is that of the coarse steps"
    found, _ = measures.asymptotic(h, error, 1e-15)
    assert abs(found.value - 1) < 0.05
    found, bend = measures.asymptotic(h[:8], 0.1 * (h[:8] ** 2 + 0.05 * h[:8]), 1e-15)
    assert found.value - bend < 1.9, "the bend is in the interval"


def test_round_off_that_adds_up_is_no_order():
    h = 1 / np.sqrt(2.0) ** np.arange(24)
    found, _ = measures.asymptotic(h, 1e-2 * h**8 + 1e-15 / h, 1e-16)
    assert abs(found.value - 8) < 0.1


def test_an_absent_package_is_skipped_with_its_reason():
    def load(name):
        raise ImportError(f"No module named '{name}'")

    peer = replace(control("rk4"), id="absent", package="no-such-package", load=load)
    found = audit([peer, "stormer-verlet"], quick=True, isolate=False)
    assert [(r["status"], r["version"]) for r in found.rows if r["peer"] == "absent"] == [("skipped", "absent")]
    assert "no-such-package" in found.rows[0]["reason"]
    assert set(verdicts(found, "absent").values()) == {UNJUDGED}
    assert verdicts(found, "stormer-verlet")["symplectic"] == HOLDS


def test_an_exceeded_budget_is_said_and_what_was_measured_stays():
    rk4 = control("rk4")

    def slow(*args):
        time.sleep(0.02)
        return rk4.run(*args)

    row = worker.row(replace(rk4, id="slow", run=slow), "order", "henon-heiles:box", 0.1)
    assert "budget" in row["reason"]
    assert row["finest_error"] > 1e-6
    assert row["seconds"] < 2
    assert "budget" not in worker.row(rk4, "order", "henon-heiles:box", 10.0)["reason"]


def test_a_measure_that_does_not_return_is_ended_from_outside(monkeypatch):
    monkeypatch.setattr(worker, "LOADING", 0.0)
    monkeypatch.setattr(worker, "MORE", 0.05)
    with worker.Worker() as apart:
        row = apart.row(control("rk4"), "order", "henon-heiles:box", 0.01)
        assert apart.process is None
    assert row["status"] == "timeout"
    assert "did not return" in row["reason"]


def test_a_peer_in_a_process_of_its_own_measures_the_same():
    rows = [audit(["rk4"], quick=True, isolate=isolate).rows for isolate in (True, False)]
    kept = [[{k: v for k, v in r.items() if k != "seconds"} for r in part] for part in rows]
    assert kept[0] == kept[1]


def test_a_peer_that_raises_is_a_row():
    def broken(*args):
        raise RuntimeError("no such potential")

    found = audit([replace(control("rk4"), id="broken", run=broken)], quick=True)
    assert {r["status"] for r in found.rows[1:]} <= {"invalid", "diverged"}
    assert all("no such potential" in r["reason"] for r in found.rows[1:])
    assert {c["verdict"] for c in found.claims} == {UNJUDGED}


def test_names_are_peers_packages_or_wrong():
    assert {p.kind for p in select(["scipy"])} == {"scipy"}
    assert [p.id for p in select(["rk4", "heyoka", "rk4"])] == ["rk4", "heyoka"]
    with pytest.raises(InvalidInput, match="did you mean"):
        select(["rebound-leapfog"])


def test_cases_start_on_their_orbits_in_general_position():
    for case in cases.CASES:
        if case.problem == "outer-solar-system":
            continue
        made, (q, p) = cases.problem(case), cases.start(case)
        H = made.system.observe(made.system.H, np.array([made.q0, q]), np.array([made.p0, p]))
        assert abs(H[1] - H[0]) < 1e-12 * (1 + abs(H[0])), case.problem
        moving = [v for x, v in zip(q, p, strict=True) if (x, v) != (0, 0)]  # not in a plane
        assert np.abs(moving).min() > 1e-3, case.problem


@pytest.mark.parametrize("lying", [False, True])
def test_the_page_is_written_from_rows(controls, lying, tmp_path):
    rows, claims = list(controls.rows), list(controls.claims)
    peer = relabelled("rk4", **({"symplectic": True} if lying else {}))
    peer = replace(peer, package="somewhere")
    mine = [r | {"peer": peer.id, "package": "somewhere", "version": "1.2"} for r in rows if r["peer"] == "rk4"]
    gone = worker.blank(replace(peer, id="gone", package="nowhere"), worker.PREPARE)
    rows += [*mine, gone | {"status": "skipped", "reason": "nowhere cannot be imported"}]
    claims += judge.claims(peer, "1.2", mine)
    left = [
        {"package": "somewhere", "version": "1.2", "name": n, "reason": ""} for n in ("NewSolver",) * lying or ("",)
    ]
    for name, part in {"audit": rows, "audit_claims": claims, "audit_unregistered": left}.items():
        pd.DataFrame(part).to_csv(tmp_path / f"{name}.csv", index=False)

    def data(name):
        path = tmp_path / f"{name}.csv"
        return pd.read_csv(path) if path.exists() else None

    judged, covered = PAGE.judged(data)
    assert f"energy that could be judged {4 - lying} hold" in judged.text
    assert judged.holds is not lying
    assert covered.text.startswith("1 integrators of 1 packages were audited (somewhere 1.2)")
    assert "not audited: nowhere (1 integrators)" in covered.text
    assert ("of somewhere NewSolver (data/audit_unregistered.csv)" in covered.text) is lying
    assert "Of the 12 declarations of the controls" in covered.text
    assert "12 come out as declared" in covered.text
    shown = PAGE.table(data).frame
    assert ("(`phasebench audit --peer rk4-mislabelled`)" in set(shown.get("what would mend it", ()))) is lying
    assert "nowhere cannot be imported" in set(shown["measured"])
    (picture,) = PAGE.figures(data, tmp_path)
    assert (tmp_path / picture.file).stat().st_size > 2000


def test_the_terminal_shows_rows_and_claims(controls):
    console = Console(file=io.StringIO(), width=300)
    show(Audit(controls.rows, controls.claims, ["a remark"]), console)
    text = console.file.getvalue()
    assert "12 claims, 0 contradicted" in text
    assert all(id in text for id in (*CONTROLS, "a remark"))
