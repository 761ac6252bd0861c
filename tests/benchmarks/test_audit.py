"""The audit: controls come out as declared, false claims are contradicted, peers that hang, die or change a mode.

What a peer's rows tell is in `test_judge`.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.audit import cases, claims, measures, worker
from phasebench.benchmarks.audit.audit import audit, select
from phasebench.benchmarks.judge import evidence
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, UNJUDGED
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.store import workers
from phasebench.benchmarks.store.workers import Worker
from phasebench.benchmarks.studies.audit import modes
from phasebench.integrators.errors import InvalidInput
from phasebench.reference.peers import Run
from support import toy_cells
from support.flushing import flush, only_there
from support.planted import control

#: Stability limits on the harmonic oscillator and gradients a step; the study has the other control.
CONTROLS = {"stormer-verlet": (2.0, 1), "rk4": (8**0.5, 4)}


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
    rows = {r["measure"]: r for r in controls.rows if r["peer"] == id}
    assert {r["status"] for r in rows.values()} == {"ok"}
    assert {*rows} == {worker.PREPARE, *measures.FIXED}
    assert verdicts(controls, id) == dict.fromkeys(("order", "symplectic", "reversible", "energy"), HOLDS)
    assert not controls.remarks, "all that is found is declared"
    assert {evidence.keeps_structure(r) for name, r in rows.items() if name in claims.KEPT} == {id != "rk4"}
    limit, gradients = CONTROLS[id]
    assert abs(rows["stability"]["value"] - limit) < 1e-6
    cost = rows["cost"]
    assert cost["evaluations"] == pytest.approx(gradients, rel=0.01)
    assert cost["value"] == pytest.approx(cost["per_time"] * cost["h"])


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
    assert {n: c["verdict"] for n, c in found.items() if c["verdict"] != HOLDS} == {name: CONTRADICTED}
    assert found[name]["command"] == f"phasebench audit --peer {liar.id}"


def test_false_claim_of_an_unregistered_peer():
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
    assert (row["status"], "more than the state" in row["reason"]) == ("skipped", True)


def test_order_is_that_at_fine_steps_above_round_off():
    """An h^2 error turns into an h^1 error; the interval contains a bend; accumulated round-off is no order."""
    k = np.arange(24)
    h = 0.5 / np.sqrt(2.0) ** k
    rough = 0.1 * np.where(k < 12, h**2, h * h[12] * (1 + 0.01 * np.sin(37.0 * k)))
    assert abs(measures.asymptotic(h, rough, 1e-15)[0].value - 1) < 0.05
    found, bend = measures.asymptotic(h[:8], 0.1 * (h[:8] ** 2 + 0.05 * h[:8]), 1e-15)
    assert found.value - bend < 1.9
    assert abs(measures.asymptotic(2 * h, 1e-2 * (2 * h) ** 8 + 1e-15 / h, 1e-16)[0].value - 8) < 0.1


# -- peers that fail ---------------------------------------------------------------------------------------------------


def failing(error, after=lambda: None):
    """A function that calls ``after`` and raises the error."""

    def function(*_):
        after()
        raise error

    return function


def test_absent_and_broken_packages_give_rows():
    absent = replace(control("rk4"), id="absent", package="no-such-package", load=failing(ImportError("none")))
    broken = replace(control("rk4"), id="broken", run=failing(RuntimeError("no such potential")))
    found = audit([absent, broken, "stormer-verlet"], quick=True, isolate=False)
    rows = {id: [r for r in found.rows if r["peer"] == id] for id in ("absent", "broken")}
    assert [(r["status"], r["version"]) for r in rows["absent"]] == [("skipped", "absent")]
    assert "no-such-package" in rows["absent"][0]["reason"]
    assert {r["status"] for r in rows["broken"][1:]} <= {"invalid", "diverged"}
    assert all("no such potential" in r["reason"] for r in rows["broken"][1:])
    assert {*verdicts(found, "absent").values(), *verdicts(found, "broken").values()} == {UNJUDGED}
    assert verdicts(found, "stormer-verlet")["symplectic"] == HOLDS


def test_exceeded_budget_keeps_the_measured_part(monkeypatch):
    """A run takes 0.02 s on the test's clock."""
    rk4, now = control("rk4"), [0.0]

    def slow(*args):
        now[0] += 0.02
        return rk4.run(*args)

    for module in (worker, measures):
        monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now[0]))
    row, whole = (worker.row(replace(rk4, run=slow), "order", "henon-heiles:box", budget) for budget in (0.1, 100.0))
    assert ("budget" in row["reason"], row["finest_error"] > 1e-6) == (True, True)
    assert "budget" not in whole["reason"]


@pytest.mark.parametrize(("dies", "status"), [(False, "timeout"), (True, "invalid")])
def test_peer_that_hangs_is_killed_and_one_that_dies_has_a_row(monkeypatch, importable, dies, status):
    if dies:
        monkeypatch.setattr(worker, "row", toy_cells.die_of)
    else:
        monkeypatch.setattr(worker, "LOADING", 0.0)
        monkeypatch.setattr(worker, "MORE", 0.05)
    with Worker() as apart:
        monkeypatch.setattr(worker, "shared_worker", lambda: apart)
        row = worker.row_elsewhere(control("rk4"), "order", "henon-heiles:box", 0.01)
        assert apart.process is None
    assert (row["peer"], row["status"]) == ("rk4", status)
    assert ("died" if dies else "did not return") in row["reason"]


def test_selection_and_starts():
    assert {p.kind for p in select(["scipy"])} == {"scipy"}
    assert [p.id for p in select(["rk4", "heyoka", "rk4"])] == ["rk4", "heyoka"]
    with pytest.raises(InvalidInput, match="did you mean"):
        select(["rebound-leapfog"])
    for case in cases.CASES:
        if case.problem != "outer-solar-system":
            made, (q, p) = cases.problem(case), cases.start(case)
            H = made.system.observe(made.system.H, np.array([made.q0, q]), np.array([made.p0, p]))
            assert abs(H[1] - H[0]) < 1e-12 * (1 + abs(H[0])), case.problem
            moving = [v for x, v in zip(q, p, strict=True) if (x, v) != (0, 0)]  # not confined to a plane
            assert np.abs(moving).min() > 1e-3, case.problem


# -- floating-point modes ----------------------------------------------------------------------------------------------


def peer(run=None, **more) -> Integrator:
    """A made-up peer whose run returns its initial state, or is ``run``."""
    still = run or (lambda task: Run.stuck(task, 0, 0, 0.0))
    return Integrator(replace(control("stormer-verlet"), run=still, lacks=lambda problem, system: None, **more))


def flushing(task):
    """A run that sets the processor to flush subnormal numbers to zero."""
    flush()
    return Run.stuck(task, 0, 0, 0.0)


@only_there
@pytest.mark.parametrize(
    ("chosen", "mode", "status"),
    [
        (peer(), modes.KEPT, "ok"),
        (peer(flushing), modes.BY_RUN, "ok"),
        (peer(failing(ValueError("broken"), flush)), modes.BY_RUN, "ok"),
        (peer(failing(ValueError("broken"))), None, "invalid"),
        (peer(load=lambda name: flush()), modes.BY_LOADING, "ok"),
        (peer(load=failing(ImportError("gone"))), None, "skipped"),
    ],
    ids=["kept", "run", "raises-later", "raises", "loading", "gone"],
)
def test_mode_change_by_a_run_is_found(chosen, mode, status):
    try:
        found = modes.row(chosen)
    finally:
        flush(False)
    assert (found["mode"], found["status"], found["problem"]) == (mode, status, "kepler")


@only_there
def test_process_with_a_changed_mode_judges_nobody():
    flush()
    try:
        found = modes.row(peer())
    finally:
        flush(False)
    assert (found["mode"], found["status"]) == (None, "invalid")


IDS = ("rk4", "gauss-2", "rebound-leapfrog")


@pytest.mark.parametrize(
    ("judge", "processes"),
    [
        (toy_cells.judge_well, 1),
        (toy_cells.judge_badly, 3),  # after a change of mode
        (toy_cells.judge_dying_second, 3),  # each was the first of its process
        (toy_cells.judge_dying_of_rk4, 1),
    ],
)
def test_process_is_replaced_where_it_must_be(monkeypatch, importable, judge, processes):
    monkeypatch.setattr(modes, "judge", judge)
    rows = modes.judge_all(IDS)
    assert [r["peer"] for r in rows] == list(IDS)
    assert len({r["in"] for r in rows if "in" in r}) == processes
    if judge is toy_cells.judge_dying_of_rk4:
        assert (rows[0]["status"], rows[0]["mode"], rows[0]["reason"]) == ("invalid", None, workers.DIED)
