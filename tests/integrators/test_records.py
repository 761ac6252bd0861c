"""Records of methods: ids, declared classes, requirements, citations."""

from __future__ import annotations

import re

import pytest
from typer.testing import CliRunner

from phasebench.benchmarks import bibliography
from phasebench.benchmarks.cli import app
from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.integrators.record import BOUNDED, DRIFT, EXACT, NONE, ROUND_OFF
from phasebench.integrators.record import TRAITS as MEANINGS
from phasebench.integrators.registry import BY_ID, METHODS, method
from phasebench.reference.peers import PEERS

TRAITS = set(problem("pendulum").system.traits)
IDS = [m.id for m in METHODS]


def test_ids_of_methods_are_unique():
    assert len(set(IDS)) == len(IDS)


@pytest.mark.parametrize("id", IDS)
def test_a_record_is_complete(id):
    m = BY_ID[id]
    assert re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", m.id)
    assert m.name
    assert m.source
    assert m.order >= 1
    assert {m.energy, m.quadratic} <= {EXACT, ROUND_OFF, BOUNDED, DRIFT, NONE}
    assert set(m.requires) <= TRAITS, "no system has such a trait"
    assert m.cite
    assert set(m.cite) <= set(bibliography.entries()), "the bibliography lacks a key"


def test_methods_peers_and_problems_are_keys_of_dicts():
    names = {x: x.id for x in (*METHODS, *PEERS, *map(problem, PROBLEMS))}
    assert len(names) == len({*names.values()})
    assert {method("scheme-i", lam=0.5): 1}[method("scheme-i", lam="1/2")] == 1
    assert method("scheme-i", lam=0.5) != method("scheme-i", lam=0.25)


def test_what_gives_a_system_a_trait_is_said_of_every_trait():
    assert set(MEANINGS) == TRAITS


def test_every_work_of_the_bibliography_is_cited():
    works = {key for m in METHODS for key in m.cite} | {key for name in PROBLEMS for key in problem(name).cite}
    assert set(bibliography.entries()) == works


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_problem_cites_its_works(name):
    assert problem(name).source
    assert problem(name).cite
    assert set(problem(name).cite) <= set(bibliography.entries()), "the bibliography lacks a key"


@pytest.mark.parametrize("key", bibliography.entries())
def test_an_entry_is_bibtex(key):
    text = bibliography.entries()[key]
    assert text.count("{") == text.count("}")
    fields = dict(re.findall(r"^  (\w+) = \{(.*)\},?$", text, re.MULTILINE))
    assert {"title", "author"} <= set(fields)
    assert fields.get("year", "2000").isdigit()
    assert not re.search(r"\}\n  \w+ =", text), "a comma is missing"


def test_no_two_methods_have_the_same_data():
    """One method under two ids would count twice."""
    seen = {}
    for m in METHODS:
        key = (m.family, repr(m.data), m.requires)
        assert key not in seen, f"{m.id} is {seen[key]}"
        seen[key] = m.id


def test_a_parameter_changes_a_record_and_its_label():
    a, b = method("scheme-i", lam=-1), method("scheme-i", lam=2)
    assert a.data != b.data
    assert a.label != b.label


def cite(*arguments):
    """Run `phasebench cite`."""
    return CliRunner().invoke(app, ["cite", *arguments])


def test_cite_prints_each_work_once():
    text = cite("scheme-v", "scheme-iv", "avf").stdout
    assert text.count("@misc{wang-talk,") == 1
    assert "@article{quispel2008," in text
    assert "verlet" not in text


def test_cite_of_a_report_lists_the_works_of_its_methods(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "rows.csv").write_text("id,h\navf,0.1\nstormer-verlet,0.1\nheyoka,0.1\n")
    text = cite("--reports", str(tmp_path)).stdout
    assert {"quispel2008", "verlet1967"} <= set(re.findall(r"^@\w+\{([^,]+),", text, re.MULTILINE))
    assert "kutta1901" not in text


def test_cite_reports_errors(tmp_path):
    unknown = cite("scheme-vi")
    assert unknown.exit_code == 2
    assert "scheme-v" in unknown.stderr
    empty = cite("--reports", str(tmp_path))
    assert empty.exit_code == 2
    assert "pytest benchmarks" in " ".join(empty.stderr.split())
