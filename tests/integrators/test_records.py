"""Records of methods: declared properties against a list of the published ones, ids, requirements, citations."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from fractions import Fraction
from pathlib import Path

import mpmath
import pytest
from typer.testing import CliRunner

from phasebench.benchmarks import bibliography
from phasebench.benchmarks.cli import app
from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.integrators.coefficients.table import value
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import BOUNDED, DRIFT, EXACT, NONE, ROUND_OFF
from phasebench.integrators.record import TRAITS as MEANINGS
from phasebench.integrators.records import (
    energy,
    parametric,
    projection,
)
from phasebench.integrators.registry import BY_ID, METHODS, method
from phasebench.reference.peers import PEERS

TRAITS = set(problem("pendulum").system.traits)
ROOT = Path(__file__).resolve().parents[2]
KINDS = ("symmetric", "symplectic", "energy", "quadratic")


def parts(m) -> int | None:
    by_family = {
        "parametric": lambda: len(m.data[1]),
        "runge_kutta": lambda: len(m.data[-1]),
        "splitting": lambda: sum(b != 0 for b in m.data[1]),
        "wisdom_holman": lambda: len(m.data[1]),
        "collocation": lambda: m.data[1],
        "equip": lambda: m.data[0],
        "multistep": lambda: m.earlier + 1,
        "fcirk": lambda: m.data[0],
        "parts": lambda: len(m.data[0]),
        "poisson": lambda: m.data[0],
        "variational": lambda: m.data[2],
        "processed": lambda: sum(b != 0 for b in m.data[0][1]),
        "force_gradient": lambda: sum(any(row[1:]) for row in m.data[0][1:]),
    }
    by_family |= dict.fromkeys(("schemes_iv_v", "averaged", "discrete_gradient"), lambda: len(m.data))
    return by_family[m.family]() if m.family in by_family else None


def declarations(m) -> tuple:
    return *(getattr(m, x) for x in KINDS), m.order, parts(m)


def read(text: str) -> dict[str, tuple[int, int | None]]:
    """{id: (order, n)} from text such as "rk4 4/4, gautschi 2"."""
    found = {}
    for entry in " ".join(text.split()).split(", "):
        id, numbers = entry.split()
        order, _, n = numbers.partition("/")
        found[id] = int(order), int(n) if n else None
    return found


def test_every_record_declares_what_is_published():
    kinds = tomllib.loads(Path(__file__).with_name("published.toml").read_text(encoding="utf-8"))["kind"]
    published = {id: (*[kind[x] for x in KINDS], *of) for kind in kinds for id, of in read(kind["methods"]).items()}
    assert {m.id: declarations(m) for m in METHODS} == published
    suzuki, kutta = projection.SUZUKI, projection.KUTTA_3  # which are not registered
    assert declarations(suzuki) == declarations(method(suzuki.id))
    assert declarations(kutta) == (False, False, DRIFT, DRIFT, 3, 3)


#: Family -> the fractions of the step that a method consists of; rounded to doubles they would cause a clock error.
PARTS = {
    "splitting": lambda data: data,
    "wisdom_holman": lambda data: data[:2],
    "averaged": lambda data: [[row[0] for row in data]],
    "discrete_gradient": lambda data: [data],
    "extended": lambda data: data[:1],
    "semiexplicit": lambda data: data,
    "parametric": lambda data: [[row[0] for row in data[1]]],
    "schemes_iv_v": lambda data: [[c for c, _, _, alternative in data if alternative == 0]],
}


@pytest.mark.parametrize("family", PARTS)
def test_fractions_of_a_step_add_up_to_one(family):
    with mpmath.workdps(50):
        for m in METHODS:
            for parts in PARTS[family](m.data) if m.family == family else ():
                total = mpmath.fsum(value(str(x)) if isinstance(x, Fraction) else x for x in parts)
                assert abs(total - 1) < 1e-40, m.id


def test_default_parameters():
    third = Fraction(1, 3)
    others = {m.id: dict(m.parameters) for m in METHODS if m.parameters and m.parameters != {"lam": third}}
    assert others == {
        "generating-function": {"order": 3, "lam": third},
        "r-respa": {"substeps": 10},
        "wisdom-holman-corrector": {"corrector": 17},
        "fcirk": {"stages": 8},
        **{f"tao-{order}": {"omega": 20} for order in (2, 4, 6)},
    }
    assert all(m(**m.parameters) == m for m in METHODS if m.parameters)


@pytest.mark.parametrize(
    ("id", "name", "good", "bad"),
    [
        ("r-respa", "substeps", (1, 10_000), (0, 10_001, 1.5)),
        ("generating-function", "order", (1, 6), (0, 7)),
        ("wisdom-holman-corrector", "corrector", (3, 17), (0, 4, 9, 19, -3)),
        ("fcirk", "stages", (1, 12), (0, 13, -1)),
        ("tao-2", "omega", (0, 2.5, "1/3"), (-1,)),
    ],
)
def test_values_of_parameters(id, name, good, bad):
    made = [method(id, **{name: x}) for x in good]
    assert len({repr(m.data) for m in made}) == len({m.label for m in made}) == len(good)
    for x in bad:
        with pytest.raises(InvalidInput):
            method(id, **{name: x})


# -- ids and citations ------------------------------------------------------------------------------------------------


def test_records_are_complete():
    assert len(BY_ID) == len(METHODS) == len({(m.family, repr(m.data), m.requires) for m in METHODS})
    for m in METHODS:
        assert re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", m.id)
        assert m.name, m.id
        assert m.source, m.id
        assert m.order >= 1, m.id
        assert {m.energy, m.quadratic} <= {EXACT, ROUND_OFF, BOUNDED, DRIFT, NONE}, m.id
        assert set(m.requires) <= TRAITS, m.id
    for m in (*parametric.METHODS, *energy.METHODS):
        assert all((f"{name}1990" in m.cite) == (f"-{name}-" in m.id) for name in ("yoshida", "suzuki")), m.id
    assert set(MEANINGS) == TRAITS, "what gives a system a trait is said of every trait"


def test_a_listing_reads_no_numbers():
    text = "import sys, phasebench.integrators.registry; print({'numpy', 'mpmath', 'numba'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout == "set()\n"


def test_every_citation_is_in_the_bibliography_and_every_work_is_cited():
    cited = {m.id: m.cite for m in METHODS} | {name: problem(name).cite for name in PROBLEMS}
    assert all(cited.values())
    assert set(bibliography.entries()) == {key for keys in cited.values() for key in keys}
    for key, text in bibliography.entries().items():
        assert text.count("{") == text.count("}"), key
        fields = dict(re.findall(r"^  (\w+) = \{(.*)\},?$", text, re.MULTILINE))
        assert {"title", "author"} <= set(fields), key
        assert fields.get("year", "2000").isdigit(), key
        assert not re.search(r"\}\n  \w+ =", text), f"{key}: a comma is missing"


def test_methods_peers_and_problems_are_keys_of_dicts():
    names = {x: x.id for x in (*METHODS, *PEERS, *map(problem, PROBLEMS))}
    assert len(names) == len({*names.values()})
    assert {method("scheme-i", lam=0.5): 1}[method("scheme-i", lam="1/2")] == 1
    assert method("scheme-i", lam=0.5) != method("scheme-i", lam=0.25)


def cite(*arguments):
    return CliRunner().invoke(app, ["cite", *arguments])


def test_cite(tmp_path):
    text = cite("scheme-v", "scheme-iv", "avf").stdout
    assert text.count("@misc{wang-talk,") == 1
    assert "@article{quispel2008," in text
    assert "verlet" not in text
    unknown = cite("scheme-vi")
    assert unknown.exit_code == 2
    assert "scheme-v" in unknown.stderr
    empty = cite("--reports", str(tmp_path))
    assert empty.exit_code == 2
    assert "pytest benchmarks" in " ".join(empty.stderr.split())
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "rows.csv").write_text("id,h\navf,0.1\nstormer-verlet,0.1\nheyoka,0.1\n")
    text = cite("--reports", str(tmp_path)).stdout
    assert {"quispel2008", "verlet1967"} <= set(re.findall(r"^@\w+\{([^,]+),", text, re.MULTILINE))
    assert "kutta1901" not in text
