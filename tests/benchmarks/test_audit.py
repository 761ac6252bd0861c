"""The audit: controls come out as declared, false claims are contradicted, hanging peers end."""

from __future__ import annotations

import io
import time
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from phasebench.benchmarks.audit import cases, claims, measures, worker
from phasebench.benchmarks.audit.audit import Audit, audit, select
from phasebench.benchmarks.audit.table import show
from phasebench.benchmarks.judge import evidence
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, UNJUDGED
from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.store.workers import Worker
from phasebench.integrators.errors import InvalidInput
from phasebench.reference.peers import Run
from support import toy_cells
from support.planted import control

#: The study has the other control.
CONTROLS = ("stormer-verlet", "rk4", "gauss-2")


@pytest.fixture(scope="module")
def controls():
    """The audit of the control peers: methods of this project whose declared properties are known."""
    return audit(CONTROLS, isolate=False)


def verdicts(found, peer):
    return {c["property"]: c["verdict"] for c in found.claims if c["peer"] == peer}


def relabel(id, **claims):
    """A control peer (a method of this project) under another id and with some claims replaced."""
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
        if row["measure"] in claims.KEPT:
            assert evidence.keeps_structure(row) is (id != "rk4"), row


#: Stability limits on the harmonic oscillator: 2, sqrt(8), and none for Gauss methods.
@pytest.mark.parametrize(("id", "limit"), [("stormer-verlet", 2.0), ("rk4", 8**0.5), ("gauss-2", None)])
def test_known_stability_limits(controls, id, limit):
    row = next(r for r in controls.rows if r["peer"] == id and r["measure"] == "stability")
    assert row["unconditional"] is (limit is None)
    assert limit is None or abs(row["value"] - limit) < 1e-6


@pytest.mark.parametrize("id", CONTROLS)
def test_cost_is_per_step(controls, id):
    row = next(r for r in controls.rows if r["peer"] == id and r["measure"] == "cost")
    assert row["value"] == pytest.approx(row["per_time"] * row["h"])
    assert 1e-3 < row["value"] < 10, "microseconds"


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
def test_false_claim_alone_is_contradicted(controls, id, false):
    liar = relabel(id, **false)
    mine = [r | {"peer": liar.id} for r in controls.rows if r["peer"] == id]
    found = {c["property"]: c for c in claims.judgements(liar, "1", mine)}
    (name,) = false
    assert {n for n, c in found.items() if c["verdict"] != HOLDS} == {name}
    assert found[name]["verdict"] == CONTRADICTED
    assert found[name]["command"] == f"phasebench audit --peer {liar.id}"
    assert found[name]["problems"]


def test_false_claim_of_an_unregistered_peer():
    """The full audit finds the one false claim of a peer that is in no registry."""
    found = audit([relabel("rk4", order=None, symplectic=True)], quick=True)
    assert [c["property"] for c in found.contradictions] == ["symplectic"]


def test_two_step_method_has_no_step_matrix():
    """Leapfrog as a two-step method starts with an Euler step: two steps are not one step applied twice."""

    def run(task):
        field = task.system.vector_field()
        rows = [task.state, task.state + task.h * field(0.0, task.state)]
        for _ in range(task.steps - 1):
            rows.append(rows[-2] + 2 * task.h * field(0.0, rows[-1]))
        return Run.of_states(np.array(rows)[task.numbers], task.steps, 0, 0.0)

    row = worker.row(replace(control("rk4"), id="two-step", run=run), "stability", "harmonic-oscillator")
    assert row["status"] == "skipped"
    assert "more than the state" in row["reason"]


def test_small_leading_error_term_shows_at_fine_steps():
    """A clean h^2 error turns into a rough h^1 error at fine steps: the order is 1."""
    k = np.arange(24)
    h = 0.5 / np.sqrt(2.0) ** k
    error = 0.1 * np.where(k < 12, h**2, h * h[12] * (1 + 0.01 * np.sin(37.0 * k)))
    assert abs(metrics.order(h, error).value - 2) < 0.01, "the control: the best fit is that of the coarse steps"
    found, _ = measures.asymptotic(h, error, 1e-15)
    assert abs(found.value - 1) < 0.05
    found, bend = measures.asymptotic(h[:8], 0.1 * (h[:8] ** 2 + 0.05 * h[:8]), 1e-15)
    assert found.value - bend < 1.9, "the bend is in the interval"


def test_accumulated_round_off_is_no_order():
    h = 1 / np.sqrt(2.0) ** np.arange(24)
    found, _ = measures.asymptotic(h, 1e-2 * h**8 + 1e-15 / h, 1e-16)
    assert abs(found.value - 8) < 0.1


def test_absent_package_is_skipped_with_its_reason():
    def load(name):
        raise ImportError(f"No module named '{name}'")

    peer = replace(control("rk4"), id="absent", package="no-such-package", load=load)
    found = audit([peer, "stormer-verlet"], quick=True, isolate=False)
    assert [(r["status"], r["version"]) for r in found.rows if r["peer"] == "absent"] == [("skipped", "absent")]
    assert "no-such-package" in found.rows[0]["reason"]
    assert set(verdicts(found, "absent").values()) == {UNJUDGED}
    assert verdicts(found, "stormer-verlet")["symplectic"] == HOLDS


def test_exceeded_budget_keeps_the_measured_part():
    rk4 = control("rk4")

    def slow(*args):
        time.sleep(0.02)
        return rk4.run(*args)

    worker.row(rk4, worker.PREPARE)
    row = worker.row(replace(rk4, id="slow", run=slow), "order", "henon-heiles:box", 0.1)
    assert "budget" in row["reason"]
    assert row["finest_error"] > 1e-6
    assert row["seconds"] < 2
    assert "budget" not in worker.row(rk4, "order", "henon-heiles:box", 10.0)["reason"]


def test_hanging_measure_is_killed(monkeypatch):
    monkeypatch.setattr(worker, "LOADING", 0.0)
    monkeypatch.setattr(worker, "MORE", 0.05)
    with Worker() as apart:
        monkeypatch.setattr(worker, "shared_worker", lambda: apart)
        row = worker.row_elsewhere(control("rk4"), "order", "henon-heiles:box", 0.01)
        assert apart.process is None
    assert row["status"] == "timeout"
    assert "did not return" in row["reason"]


def test_dead_process_gives_an_invalid_row(monkeypatch, importable):
    monkeypatch.setattr(worker, "row", toy_cells.die_of)
    with Worker() as apart:
        monkeypatch.setattr(worker, "shared_worker", lambda: apart)
        row = worker.row_elsewhere(control("rk4"), "order", "henon-heiles:box", 0.01)
    assert (row["peer"], row["status"]) == ("rk4", "invalid")
    assert "died" in row["reason"]


def test_isolated_peer_measures_the_same():
    rows = [audit(["rk4"], quick=True, budget=100, isolate=isolate).rows for isolate in (True, False)]
    kept = [[{k: v for k, v in r.items() if k != "seconds"} for r in part] for part in rows]
    assert kept[0] == kept[1]


def test_peer_that_raises_gives_rows():
    def broken(*args):
        raise RuntimeError("no such potential")

    found = audit([replace(control("rk4"), id="broken", run=broken)], quick=True)
    assert [r["measure"] for r in found.rows] == [worker.PREPARE, "order", "symplecticity"]
    assert {r["status"] for r in found.rows[1:]} <= {"invalid", "diverged"}
    assert all("no such potential" in r["reason"] for r in found.rows[1:])
    assert {c["verdict"] for c in found.claims} == {UNJUDGED}


def test_selection_by_peer_and_package_name():
    assert {p.kind for p in select(["scipy"])} == {"scipy"}
    assert [p.id for p in select(["rk4", "heyoka", "rk4"])] == ["rk4", "heyoka"]
    with pytest.raises(InvalidInput, match="did you mean"):
        select(["rebound-leapfog"])


def test_cases_start_in_general_position():
    for case in cases.CASES:
        if case.problem == "outer-solar-system":
            continue
        made, (q, p) = cases.problem(case), cases.start(case)
        H = made.system.observe(made.system.H, np.array([made.q0, q]), np.array([made.p0, p]))
        assert abs(H[1] - H[0]) < 1e-12 * (1 + abs(H[0])), case.problem
        moving = [v for x, v in zip(q, p, strict=True) if (x, v) != (0, 0)]  # not confined to a plane
        assert np.abs(moving).min() > 1e-3, case.problem


def test_terminal_shows_rows_and_claims(controls):
    console = Console(file=io.StringIO(), width=300)
    show(Audit(controls.rows, controls.claims, ["a remark"]), console)
    text = console.file.getvalue()
    assert "12 claims, 0 contradicted" in text
    assert all(id in text for id in (*CONTROLS, "a remark"))


def test_output_is_as_wide_as_the_terminal_and_every_number_has_a_name(controls, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    console = Console(file=io.StringIO())
    show(Audit(controls.rows, controls.claims), console)
    printed = console.file.getvalue().splitlines()
    assert max(map(len, printed)) <= 80
    assert sum(line.startswith("  order measured ") for line in printed) == len(CONTROLS)
