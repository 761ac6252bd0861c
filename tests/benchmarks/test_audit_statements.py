"""Statements of packages' documentation: quoted exactly, judged by what scripts print, scripts that stand alone."""

from __future__ import annotations

import importlib
import importlib.metadata
import json
import re
import shutil
from pathlib import Path

import pytest

from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, UNDERSTATED, UNJUDGED
from phasebench.benchmarks.store import cells, tables
from phasebench.benchmarks.studies import audit as study
from phasebench.benchmarks.studies.audit import statements, unregistered
from phasebench.benchmarks.studies.audit.statements import BY_SCRIPT
from support.commands import call
from support.pages import REPORTS

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
        ("{0} ~ 4", "4.29", HOLDS),
        ("{0} ~ 4", "3.71", HOLDS),
        ("{0} ~ 4", "4.4", UNJUDGED),
        ("{0} ~ 4", "4.5", UNDERSTATED),
        ("{0} ~ 4", "3.5", CONTRADICTED),
        ("{0} <= 1e-6", "-1e-6", HOLDS),
        ("{0} <= 1e-6", "9e-6", UNJUDGED),
        ("{0} <= 1e-6", "-1.1e-5", CONTRADICTED),
        ("{0} <= 0", "1e-300", CONTRADICTED),
        ("0 < {0}", "0.0e+00", CONTRADICTED),
        ("0 < {0}", "1e-300", HOLDS),
        ("{0} < 0.1 * {0}", "-1", HOLDS),
        ("{0} < 3 * 2", "6.1", CONTRADICTED),
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
        ("rebound_janus_reversible", HOLDS),
        ("rebound_leapfrog_order_4", UNDERSTATED),
        ("gala_rk5_coefficients", CONTRADICTED),
        *((f"sundials_{s}", CONTRADICTED) for s in ("orders", "relaxation")),
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
    without = json.loads(call("audit", "--peer", "rebound-leapfrog", "--json").stdout)
    assert "statements" not in without


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
