"""The audit: controls come out as declared, false claims are contradicted, peers that hang, die or change a mode.

What a peer's rows tell is in `test_judge`.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.audit import cases, claims, measures, worker
from phasebench.benchmarks.audit.audit import audit, select
from phasebench.benchmarks.judge import evidence
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, UNDERSTATED, UNJUDGED
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.store import cells, tables, workers
from phasebench.benchmarks.store.workers import Worker
from phasebench.benchmarks.studies import audit as study
from phasebench.benchmarks.studies.audit import modes, statements, unregistered
from phasebench.benchmarks.studies.audit.statements import BY_SCRIPT
from phasebench.integrators.errors import InvalidInput
from phasebench.reference.peers import Run
from support import toy_cells
from support.commands import call
from support.flushing import flush, only_there
from support.pages import REPORTS
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
        ("rk4", {"reversible": True}),
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


# -- statements of packages' documentation -----------------------------------------------------------------------------


STATEMENTS = [s for members in BY_SCRIPT.values() for s in members]


@pytest.fixture(scope="module")
def stored():
    """The committed rows of statements, by script."""
    rows = tables.Table(REPORTS / "data", "audit_statements").rows
    return {script: [row for row in rows if row["script"] == script] for script in BY_SCRIPT}


def values(row: dict) -> list[str]:
    """The values that a script printed."""
    return [line.rsplit(" = ", 1)[1] for line in row["printed"].split("; ")]


# -- quotations --------------------------------------------------------------------------------------------------------


def documentation(where: str) -> str:
    """The docstring or the assigned value that ``where`` names, with the assignment as one line of text."""
    module, _, path = where.partition(":")
    if module == "readme":
        told = importlib.metadata.metadata(path)
        return told.get_payload() or told["Description"]
    if module == "source":
        return Path(importlib.import_module(path).__file__).read_text()
    if module == "rebound":
        sim = importlib.import_module("rebound").Simulation()
        sim.integrator = path
        return sim.integrator.__doc__
    if module in ("galpy.orbit", "desolver.integrators", "sundials4py.arkode"):
        importlib.import_module(f"phasebench.reference.peers.{module.split('.')[0]}").load()
    found = importlib.import_module(module)
    for name in path.split("."):
        called = re.fullmatch(r"(\w+)\((\w+)\)", name)
        owner, found = found, getattr(found, called[1])(getattr(found, called[2])) if called else getattr(found, name)
        last = name
    return found.__doc__ if callable(found) else f"{last} = {found}" if owner else ""


#: A guide does not come with its package.
INSTALLED = [s for s in STATEMENTS if not s.where.startswith("guide:")]


@pytest.mark.parametrize("statement", INSTALLED, ids=lambda s: f"{s.script}-{s.where}")
def test_quotation_is_in_the_installed_package(statement):
    pytest.importorskip(statement.package, exc_type=ImportError)
    text = " ".join(documentation(statement.where).split())
    assert statement.said in text
    assert statement.said[::-1] not in text


# -- verdicts ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("script", BY_SCRIPT)
def test_the_stored_rows_are_those_of_the_printed_values(script, stored):
    for statement, row in zip(BY_SCRIPT[script], stored[script], strict=True):
        found = statements.row(statement, values(row), row["printed"])
        assert {k: row[k] or "" for k in found if k != "version"} == {k: found[k] for k in found if k != "version"}
        assert len(found["shows"]) <= 135, "a line of the page's table has at most 400 characters"
        assert statements.row(statement, [], "", "no package")["verdict"] == UNJUDGED


@pytest.mark.parametrize(
    ("condition", "printed", "verdict"),
    [
        ("{0} ~ 4", "3.71", HOLDS),
        ("{0} ~ 4", "4.4", UNJUDGED),
        ("{0} ~ 4", "4.5", UNDERSTATED),
        ("{0} ~ 4", "3.5", CONTRADICTED),
        ("{0} <= 1e-6", "9e-6", UNJUDGED),
        ("{0} <= 1e-6", "-1.1e-5", CONTRADICTED),
        ("{0} <= 0", "1e-300", CONTRADICTED),
        ("0 < {0}", "0.0e+00", CONTRADICTED),
        ("{0} < 0.1 * {0}", "-1", HOLDS),
        ("{0} == symmetric", "symmetric", HOLDS),
        ("{0} == symmetric", "midpoint", CONTRADICTED),
        ("0 in a, 0; {0}", "0", HOLDS),
        ("0 in a, 0; {0}", "00", CONTRADICTED),
    ],
)
def test_verdict_on_a_condition(condition, printed, verdict):
    assert statements.judge(condition, [printed]) == verdict


# -- scripts -----------------------------------------------------------------------------------------------------------


def test_only_a_scripts_own_lines_are_its_values(tmp_path, monkeypatch):
    for name in ("__main__.py", "shared.py"):
        shutil.copy(statements.file_of("galpy_dt").with_name(name), tmp_path)
    file = tmp_path / "of_a.py"
    monkeypatch.setattr(statements, "file_of", lambda script: file)

    def run(body: str):
        file.write_text(f"def a_b():\n    print('stray = 1')\n    {body}\n    yield 'x = y', 2\n")
        return statements.run("a_b")

    assert run("pass") == (["2"], "x = y = 2", "")
    assert run("yield 'half', 1; raise ValueError('half way')") == ([], "", "ValueError: half way")
    assert "no_such" in run("import no_such")[2]
    assert run("return")[2] == "it printed nothing"
    monkeypatch.setattr(statements, "SECONDS", 0.2)
    assert "more than 0.2 s" in run("import time; time.sleep(9)")[2]


@pytest.mark.parametrize(
    ("script", "verdict"),
    [
        ("rebound_leapfrog_order_4", UNDERSTATED),
        ("gala_rk5_coefficients", CONTRADICTED),
        ("sundials_orders", CONTRADICTED),
        ("sundials_kepler", HOLDS),
    ],
)
def test_scripts_give_the_verdicts_of_the_page(script, verdict):
    pytest.importorskip(BY_SCRIPT[script][0].package)
    (row,) = statements.measure(script)
    assert (row["verdict"], row["reason"]) == (verdict, "")


def contents() -> dict[str, cells.Cell]:
    return {c.key["script"]: c for c in study.STUDY.cells() if "script" in c.key}


def test_rows_of_a_script_depend_on_its_text_its_statements_and_its_package(monkeypatch, tmp_path):
    before, copies = contents(), tmp_path / "scripts"
    shutil.copytree(statements.file_of("galpy_dt").parent, copies)
    with (copies / "of_galpy.py").open("a") as script:
        script.write("print()\n")
    files = statements.file_of
    with monkeypatch.context() as patch:
        patch.setattr(statements, "file_of", lambda script: copies / files(script).name)
        after = contents()
    changed = {s for s in before if after[s].outdated(before[s].content)}
    assert changed == {s for s in before if s.startswith("galpy_")}
    for version in ("1.3", None):
        monkeypatch.setattr(cells, "version_of", lambda package, version=version: version)
        after = contents()
        assert not any(after[s].outdated(before[s].content) for s in before)
        assert {c.available for c in after.values()} == {bool(version)}


def test_command_runs_scripts_of_the_audited_packages(monkeypatch):
    from phasebench.benchmarks.audit import audit

    asked = {s: BY_SCRIPT[s] for s in ("rebound_leapfrog_order_4", "galpy_dt")}
    monkeypatch.setattr(statements, "BY_SCRIPT", asked)
    monkeypatch.setattr(audit, "audit", lambda *a, **k: audit.Audit(rows=[{"package": "rebound"}]))
    told = json.loads(call("audit", "--peer", "rebound-leapfrog", "--scripts", "--json").stdout)
    assert [(r["script"], r["verdict"]) for r in told["statements"]] == [("rebound_leapfrog_order_4", UNDERSTATED)]
    assert "statements" not in json.loads(call("audit", "--peer", "rebound-leapfrog", "--json").stdout)


# -- unregistered integrators ------------------------------------------------------------------------------------------


def names(package):
    return [r["name"] for r in unregistered.measure(package)]


def test_new_integrator_of_a_package_is_listed(monkeypatch):
    import scipy.integrate

    before = names("scipy")
    assert before == ["BDF", "RK23", "RK45"]
    monkeypatch.setattr(scipy.integrate, "RK99", type("RK99", (scipy.integrate.RK45,), {}), raising=False)
    assert names("scipy") == [*before, "RK99"]
    scipys = next(m for m in unregistered.PACKAGES if m.PEERS[0].package == "scipy")
    monkeypatch.setattr(scipys, "PEERS", tuple(p for p in scipys.PEERS if "radau" not in p.id))
    assert "Radau" in names("scipy")
