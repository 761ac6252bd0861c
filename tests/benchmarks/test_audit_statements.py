"""Statements in the documentation of packages: quoted exactly, true and false ones judged, tested by standalone
scripts.
"""

from __future__ import annotations

import ast
import importlib
import importlib.metadata
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.audit import page, statement_cells, statements, unregistered
from phasebench.benchmarks.experiments.audit.said import BY_SCRIPT, STATEMENTS
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, UNDERSTATED, UNJUDGED
from phasebench.benchmarks.store import cells, tables
from phasebench.reference.peers import BY_ID, PEERS
from support.commands import call
from support.needs import need
from support.pages import REPORTS

OK = "1.0e-16"
#: The orders that SUNDIALS states, of q and of H.
SPRK = tuple(f"{x:.2f}" for x in (1, 2, 2, 2, 3, 3, 4, 6, 8, 4, 5, 4, 5) for _ in "qH")
#: script -> (values for which its statements hold, values for which they do not, the verdict on the latter).
VALUES = {
    "galpy_dt": (("1e-15", "1.8", OK), ("1.8", "1e-15", OK), CONTRADICTED),
    "desolver_fixed_steps": (("0.10, 0.10",) * 5, ("0.10, 0.10", "0.10, 0.30", *("0.10, 0.10",) * 3), CONTRADICTED),
    "desolver_radau_iia_3": (("1.0", "1.0", "2.98"), ("1.0", "1.0833", "1.00"), CONTRADICTED),
    "desolver_orders": (("8.01", "6.98", "6.1", "1.0"), ("7.02", "4.01", "4.00", "0.40"), CONTRADICTED),
    "desolver_richardson": ((OK, OK, OK, "True"), (OK, "1.9e-05", OK, "True"), CONTRADICTED),
    "desolver_richardson_default": (("1e-3", "1e-2"), ("0.0e+00", "1e-2"), CONTRADICTED),
    "desolver_lobatto_iiib_2": (("False", "True", "1e-3"), ("False", "True", "0.0e+00"), UNDERSTATED),
    "gala_time_dependent": (("2.0", "4.0", "5.0"), ("2.0", "1.0", "5.0"), CONTRADICTED),
    "gala_leapfrog_energy": ((OK, OK), ("2.50e-03", OK), CONTRADICTED),
    "gala_rk5_coefficients": (("0.4", OK), (OK, "0.4"), CONTRADICTED),
    "gala_dopri853_order": (("5.0",), ("7.93",), UNDERSTATED),
    "gala_dopri853_defaults": (("1e-6", "1e-6", "1e-5"), ("1e-5", "1e-6", "0.00e+00"), CONTRADICTED),
    "blackjax_stability": (("2.000", "4.662", "2.553"), ("1.4", "3.0", "2.553"), CONTRADICTED),
    "blackjax_midpoint": ((OK, OK, OK, OK), ("2.4e-06", OK, OK, OK), CONTRADICTED),
    "mujoco_free_body": (("0", "-0.56", "50000", "2.89", "2.00"), ("4", "0.1", "50000", "2.89", "1.0"), CONTRADICTED),
    "mujoco_rk4": (("1.5e-04", *("2.0e-01",) * 3), ("1.5e-01", *("2.0e-02",) * 3), CONTRADICTED),
    "jax_md_step": (("float64", "0.1", "0.0e+00"), ("float64", "0.10000000149011612", "1.5e-08"), CONTRADICTED),
    "openmm_variable_verlet": (("4.0e-02", "1.4e-04"), ("1.4e-04", "4.0e-02"), CONTRADICTED),
    "pynamicalsys_newton": (("a state", "a state"), ("a state", "RuntimeError"), CONTRADICTED),
    "pyhamsys_projection": (("symmetric", "1e-3"), ("midpoint", "0.0e+00"), CONTRADICTED),
    "pyhamsys_extension": ((OK, OK), (OK, "3.2e-08"), CONTRADICTED),
    "pyhamsys_step": (("0.0995", "0.0299", "0.1", "1.0"), ("0.0995", "0.0299", "0.0391", "0.2"), CONTRADICTED),
    "pyhamsys_times": (("0.13, 1.27",) * 2, ("0.13, 1.27", "0.10, 1.24"), CONTRADICTED),
    "diffrax_sil3": (("3.0", "2.99", "0.3333"), ("3.0", "2.1", "0.3889"), CONTRADICTED),
    "diffrax_reversible_heun": (("5.9e-15", "1e-5"), ("1e-5", "1e-5"), CONTRADICTED),
    "diffrax_a_stability": (("-1e-4", "1e-6", "0.0", "1e-6"), ("-1e-4", "1e-6", "1e-3", "1e-6"), CONTRADICTED),
    "rebound_janus_reversible": (("0",) * 5, ("0", "0", "3", "0", "0"), CONTRADICTED),
    "rebound_leapfrog_order_4": (("2.0", "2.0", "6.0", "8.0"), ("2.0", "3.99", "6.0", "8.0"), UNDERSTATED),
    "rebound_correctors": (("2.0", "3.99", "5.99"), ("2.0", "2.01", "5.99"), CONTRADICTED),
    "rebound_whfast_bitwise": (("12", "0"), ("12", "3"), CONTRADICTED),
    "scipy_orders": (("3.0", "5.04", "7.97"), ("3.0", "4.04", "7.97"), CONTRADICTED),
    "galpy_ias15_tolerance": (("1e-3", "1e-2"), ("0.0e+00", "1e-2"), CONTRADICTED),
    "heyoka_tolerance": (("3.6e-14", "4.1e-14"), ("3.6e-14", "4.1e-11"), CONTRADICTED),
    "sundials_orders": (SPRK, (*SPRK[:18], "3.03", *SPRK[19:]), CONTRADICTED),
    "boost_velocity_verlet": (("1.02", "1"), ("2.00", "1"), UNDERSTATED),
    "sundials_memory": (("0", "0"), ("100", "0"), CONTRADICTED),
    "sundials_time_dependent": (("2.01", "3.99", "6.0", "0.5"), ("2.01", "1.00", "6.0", "1.0"), CONTRADICTED),
    "sundials_relaxation": (("std::bad_cast", "0", "0"), ("std::bad_cast",) * 3, CONTRADICTED),
    "sundials_names": (("5", "5", "10", "10"), ("5", "6", "10", "10"), CONTRADICTED),
    "sundials_compensated": (("1.6e-14", "4.4e-16"), ("1.6e-14", "1.5e-14"), CONTRADICTED),
    "sundials_kepler": ((OK,) * 9, (*(OK,) * 8, "1.2e-08"), CONTRADICTED),
}


# -- quotations ---------------------------------------------------------------------------------------------------


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
INSTALLED = [s for s in STATEMENTS if s.where and not s.where.startswith("guide:")]


@pytest.mark.parametrize("statement", INSTALLED, ids=lambda s: f"{s.script}-{s.where}")
def test_quotation_is_in_the_installed_package(statement):
    pytest.importorskip(statement.package, exc_type=ImportError)
    text = " ".join(documentation(statement.where).split())
    assert statement.said in text
    assert statement.said[::-1] not in text


def test_statements_are_complete():
    for s in STATEMENTS:
        assert s.link.startswith("https://")
        assert s.severity in (*statements.SEVERITIES, "")
        assert bool(s.severity) <= bool(s.mend), s.script
        assert all(peer in BY_ID for peer, _ in s.covers)
        assert len(s.mend) <= 76, s.script
    assert {p.stem for p in statements.SCRIPTS.glob("*.py")} == set(BY_SCRIPT)


@pytest.mark.parametrize("script", BY_SCRIPT)
def test_script_is_short_and_does_without_this_suite(script):
    text = (statements.SCRIPTS / f"{script}.py").read_text()
    assert "phasebench" not in text
    assert text.startswith('"""')
    assert len(text.splitlines()) <= 36


# -- verdicts -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("script", [s for s in BY_SCRIPT if s != "rebound_whfast_orders"])
def test_verdict_follows_the_printed_values(script):
    good, bad, verdict = VALUES[script]
    assert {s.verdict(list(good)) for s in BY_SCRIPT[script]} == {HOLDS}
    assert {s.verdict(list(bad)) for s in BY_SCRIPT[script]} == {verdict}
    for s in BY_SCRIPT[script]:
        row = statements.row(s, list(bad), "a = 1")
        assert row["verdict"] == verdict
        assert 0 < len(row["shows"]) <= 135, "a line of the page's table has at most 400 characters"
        assert statements.row(s, [], "", "no package")["verdict"] == UNJUDGED
    assert any(s.severity and s.mend for s in BY_SCRIPT[script]) or verdict == CONTRADICTED


@pytest.mark.parametrize(
    ("order", "verdict"),
    [("4.29", HOLDS), ("3.71", HOLDS), ("4.4", UNJUDGED), ("4.51", UNDERSTATED), ("3.49", CONTRADICTED)],
)
def test_verdict_on_a_measured_order(order, verdict):
    assert statements.near(0, 4)([order]) == verdict


@pytest.mark.parametrize(("value", "verdict"), [("-9e-7", HOLDS), ("5e-6", UNJUDGED), ("-1.1e-5", CONTRADICTED)])
def test_verdict_on_a_bound(value, verdict):
    assert statements.below(1e-6)(["0", value]) == verdict
    assert statements.below(1e-6, 0)(["0", value]) == HOLDS


@pytest.mark.parametrize(
    ("judge", "values", "verdict"),
    [
        (statements.near(0, 2.0), ["2.5"], UNDERSTATED),
        (statements.near(0, 2.0), ["1.5"], CONTRADICTED),
        (statements.below(0.5), ["0.5", "-0.5"], HOLDS),
        (statements.below(0.5), ["0.1", "5.0"], UNJUDGED),
        (statements.below(0.5, 0), ["0.1", "9.0"], HOLDS),
        (statements.a_l_stable, ["1e-12", "0.99e-4", "0", "0"], HOLDS),
        (statements.a_l_stable, ["0", "0", "2e-12", "0"], CONTRADICTED),
        (statements.a_l_stable, ["0", "1e-4", "0", "0"], CONTRADICTED),
        (statements.a_l_stable, ["0", "0", "0", "9e-4"], CONTRADICTED),
        (statements.judge_denial(0, 1), ["False", "0.9e-12"], UNDERSTATED),
        (statements.judge_denial(0, 1), ["False", "1e-12"], HOLDS),
        (statements.judge_denial(0, 1), ["True", "0"], HOLDS),
        (statements.steps_near((1.0, 4.0), 0.25), ["1.25", "3.0"], HOLDS),
        (statements.steps_near((1.0, 4.0), 0.25), ["1.25", "2.9"], CONTRADICTED),
        (statements.differs(1), ["1", "0.0"], CONTRADICTED),
        (statements.differs(0), ["1e-300"], HOLDS),
    ],
)
def test_verdict_thresholds(judge, values, verdict):
    assert judge(values) == verdict


def version_is(monkeypatch, version_of):
    for module in (statements, cells):
        monkeypatch.setattr(module, "version_of", version_of)


def test_package_version_is_in_rows_and_cell_contents(monkeypatch):
    statement = STATEMENTS[0]
    version_is(monkeypatch, lambda package: "1.2")
    assert statements.row(statement, [])["version"] == "1.2"
    before = {c.key["script"]: c.content for c in statement_cells.cells()}
    version_is(monkeypatch, lambda package: "1.3")
    after = {c.key["script"]: c for c in statement_cells.cells()}
    assert all(before[script] != c.content and not c.outdated(before[script]) for script, c in after.items())
    version_is(monkeypatch, lambda package: None)
    assert statements.row(statement, [], reason="not there")["version"] == "absent"
    assert not any(c.available for c in statement_cells.cells())


def test_worst_of_several_verdicts_counts():
    def of(verdict):
        return lambda values: verdict

    every = statements.every
    assert every(of(HOLDS), of(CONTRADICTED), of(UNDERSTATED))([]) == CONTRADICTED
    assert every(of(HOLDS), of(UNJUDGED), of(UNDERSTATED))([]) == UNJUDGED
    assert every(of(HOLDS), of(UNDERSTATED))([]) == UNDERSTATED
    assert every(of(HOLDS), of(HOLDS))([]) == HOLDS


# -- scripts ------------------------------------------------------------------------------------------------------


def test_printed_assignments_are_parsed():
    assert statements.parse_output("Using a backend\na = b = 1\nx, y = 2.0, 3\n") == {"a = b": "1", "x, y": "2.0, 3"}


def test_failing_or_silent_script_judges_nothing(tmp_path, monkeypatch):
    path = tmp_path / "a.py"
    texts = ("raise ImportError('no such package')", "no such package"), ("", "it printed nothing")
    for text, why in (*texts, ("print('a = 1'); raise ValueError('half way')", "half way")):
        path.write_text(text)
        values, lines, reason = statements.run(path)
        assert (values, lines) == ([], "")
        assert why in reason
    path.write_text("import time; time.sleep(9)")
    monkeypatch.setattr(statements, "SECONDS", 0.2)
    assert "more than 0.2 s" in statements.run(path)[2]


def printed_forms(path: Path) -> list[re.Pattern]:
    """What a script's calls of print can write, from its source: a regular expression each."""
    calls = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call)]
    texts = [n.args[0] for n in calls if isinstance(n.func, ast.Name) and n.func.id == "print"]
    parts = [getattr(text, "values", [text]) for text in texts]
    return [
        re.compile("".join(re.escape(p.value) if isinstance(p, ast.Constant) else ".*" for p in row)) for row in parts
    ]


def foreign_lines(row: dict) -> list[str]:
    """The printed values of a stored row of the statements that the script itself cannot have printed."""
    forms = printed_forms(statements.SCRIPTS / f"{row['script']}.py")
    return [line for line in row["printed"].split("; ") if not any(form.fullmatch(line) for form in forms)]


def test_what_a_package_prints_is_not_taken_for_a_value():
    stored = tables.Table(REPORTS / "data", "audit_statements").rows
    assert {row["script"] for row in stored} == set(BY_SCRIPT)
    assert {row["script"]: lines for row in stored if (lines := foreign_lines(row))} == {}
    stray = {"script": "pynamicalsys_newton", "printed": "with 50 iterations = a state; max_iter = 1"}
    assert foreign_lines(stray) == ["max_iter = 1"]


@pytest.mark.parametrize(
    ("script", "verdict"),
    [
        ("rebound_janus_reversible", HOLDS),
        ("rebound_leapfrog_order_4", UNDERSTATED),
        ("gala_rk5_coefficients", CONTRADICTED),
        ("desolver_radau_iia_3", CONTRADICTED),
        ("sundials_orders", CONTRADICTED),
        ("sundials_time_dependent", CONTRADICTED),
        ("sundials_relaxation", CONTRADICTED),
        ("sundials_names", CONTRADICTED),
        ("sundials_kepler", HOLDS),
    ],
)
def test_scripts_give_the_verdicts_of_the_page(script, verdict):
    pytest.importorskip(BY_SCRIPT[script][0].package)
    (row,) = statement_cells.measure_rows(script)["audit_statements"]
    assert (row["verdict"], row["reason"]) == (verdict, "")


def test_each_script_is_a_cell_that_depends_on_its_text_and_its_statements(monkeypatch, tmp_path):
    def contents() -> dict[str, str]:
        return {c.key["script"]: c.content for c in statement_cells.cells()}

    before, copies = contents(), tmp_path / "scripts"
    assert set(before) == set(BY_SCRIPT)
    shutil.copytree(statements.SCRIPTS, copies)
    monkeypatch.setattr(statements, "SCRIPTS", copies)
    with (copies / "galpy_dt.py").open("a") as script:
        script.write("print()\n")
    after = contents()
    assert {script for script in before if after[script] != before[script]} == {"galpy_dt"}
    said, *others = BY_SCRIPT["galpy_dt"]
    monkeypatch.setattr(statement_cells, "BY_SCRIPT", {"galpy_dt": [replace(said, said="other words"), *others]})
    assert contents()["galpy_dt"] != after["galpy_dt"]


def test_command_runs_scripts_of_the_audited_packages(monkeypatch):
    from phasebench.benchmarks.experiments.audit import audit

    asked = {"rebound_leapfrog_order_4": BY_SCRIPT["rebound_leapfrog_order_4"], "galpy_dt": BY_SCRIPT["galpy_dt"]}
    monkeypatch.setattr(statement_cells, "BY_SCRIPT", asked)
    monkeypatch.setattr(audit, "audit", lambda *a, **k: audit.Audit(rows=[{"package": "rebound"}]))
    told = json.loads(call("audit", "--peer", "rebound-leapfrog", "--scripts", "--json").stdout)
    assert [(r["script"], r["verdict"]) for r in told["statements"]] == [("rebound_leapfrog_order_4", UNDERSTATED)]
    without = json.loads(call("audit", "--peer", "rebound-leapfrog", "--json").stdout)
    assert "statements" not in without


# -- the page -----------------------------------------------------------------------------------------------------


def frame(**verdicts):
    rows = [statements.row(s, list(VALUES[s.script][1])) for s in STATEMENTS if s.script in VALUES]
    return pd.DataFrame([r | {"verdict": verdicts.get(r["script"], HOLDS)} for r in rows])


def test_claim_covered_by_a_statement_is_shown_once():
    about = {"package": "desolver", "version": "5", "property": "order", "claim": "order 3", "verdict": CONTRADICTED}
    about |= {"measured": "1.0", "command": "phasebench audit"}
    claimed = pd.DataFrame([about | {"peer": p} for p in ("desolver-radau-iia-3", "desolver-rk4")])
    found = pd.DataFrame(
        {"package": "desolver", "peer": list(claimed["peer"]), "measure": "package", "status": "ok", "reason": ""}
    )
    tables = {"audit": found, "audit_claims": claimed, "audit_statements": frame(desolver_radau_iia_3=CONTRADICTED)}
    shown = page.table(tables.get).frame
    assert list(shown["said"]) == [shown["said"][0], "desolver-rk4: order 3"]


# -- unregistered integrators -------------------------------------------------------------------------------------


def names(package):
    return [r["name"] for r in unregistered.measure_rows(package)["audit_unregistered"]]


def test_new_integrator_of_a_package_is_listed(monkeypatch):
    import scipy.integrate

    before = names("scipy")
    assert before == ["BDF", "RK23", "RK45"]
    monkeypatch.setattr(scipy.integrate, "RK99", type("RK99", (scipy.integrate.RK45,), {}), raising=False)
    assert names("scipy") == [*before, "RK99"]
    scipys = next(m for m in unregistered.PACKAGES if m.PEERS[0].package == "scipy")
    monkeypatch.setattr(scipys, "PEERS", tuple(p for p in scipys.PEERS if "radau" not in p.id))
    assert "Radau" in names("scipy")


def test_unused_rebound_options_are_listed(monkeypatch):
    found = names("rebound")
    assert "whfast corrector2 1" in found
    assert "whfast512 corrector 17" not in found
    assert any(n.startswith("whfast coordinates DEMOCRATIC") for n in found)
    assert any(n.startswith("eos phi0 LF6") for n in found)
    assert not any(n.startswith(("whfast kernel", "janus", "leapfrog", "bs")) for n in found)
    from phasebench.reference.peers import rebound

    monkeypatch.setattr(rebound, "PEERS", tuple(p for p in rebound.PEERS if p.settings.get("kernel") != "lazy"))
    assert "whfast kernel LAZY" in names("rebound")


@pytest.mark.parametrize(
    ("package", "left"),
    [
        ("desolver", ["DIRK3LStable"]),
        *((package, [""]) for package in ("gala", "pyhamsys", "galpy", "sundials4py", "pynamicalsys")),
        ("gsl", ["bsimp", "msadams", "msbdf", "rk1imp", "rk2", "rkck", "rkf45"]),
    ],
)
def test_unregistered_names_of_other_packages(package, left):
    need(package)
    assert names(package) == left


@pytest.mark.parametrize(
    ("package", "named", "used"),
    [
        ("boost", "velocity_verlet", "symplectic_rkn_sb3a_m4_mclachlan"),
        ("boost", "rosenbrock4", "runge_kutta_dopri5"),
        ("ase", "Langevin", "VelocityVerlet"),
        ("jax_md", "nvt_nose_hoover", "nve"),
    ],
)
def test_a_peer_is_not_among_those_that_are_left_out(package, named, used):
    need(package)
    found = names(package)
    assert named in found
    assert used not in found


def test_every_package_is_searched():
    assert {c.key["package"] for c in unregistered.cells()} == {peer.package for peer in PEERS}


def test_absent_package_is_reported(monkeypatch):
    def absent():
        raise ImportError("No module named 'gala'")

    monkeypatch.setitem(unregistered.LOOKS, "gala", absent)
    (row,) = unregistered.measure_rows("gala")["audit_unregistered"]
    assert (row["name"], "cannot be imported" in row["reason"]) == ("", True)
