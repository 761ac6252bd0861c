"""Imports point one way, integrators <- reference <- benchmarks, and heavy packages wait until they are needed."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
#: Each package with those of the project that it may import.
MAY = {
    "integrators": {"integrators"},
    "reference": {"reference", "integrators"},
    "benchmarks": {"benchmarks", "reference", "integrators"},
}
PROJECT = {*MAY, "tests", "reports"}
HEAVY = ("heyoka", "rebound", "matplotlib", "pandas", "scipy")


def imported(text: str, package: str) -> set[str]:
    """The first names of everything that a source imports, at whatever depth; ``package`` is the dotted home."""
    names = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names |= {a.name.split(".")[0] for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            home = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            names.add((home + (node.module or "").split("."))[0])
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) in (
            "import_module",
            "__import__",
        ):
            first = node.args[0] if node.args else None
            if isinstance(first, ast.Constant) and isinstance(first.value, str) and not first.value.startswith("."):
                names.add(first.value.split(".")[0])
    return names


SOURCES = [p for package in MAY for p in sorted((ROOT / package).rglob("*.py"))]


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_point_one_way(path):
    relative = path.relative_to(ROOT)
    found = imported(path.read_text(), ".".join(relative.parent.parts)) & PROJECT
    assert found <= MAY[relative.parts[0]]


def test_control_a_wrong_import_is_seen():
    assert imported("def f():\n    import benchmarks.problems", "integrators") == {"benchmarks"}
    assert imported("from reference import exact", "integrators") == {"reference"}
    assert imported("from . import solve\nfrom .vector import add", "integrators") == {"integrators"}
    assert imported("from ..problems import problem", "benchmarks.figures") == {"benchmarks"}
    assert imported("importlib.import_module('reference.taylor')", "integrators") == {"reference"}
    assert {p.relative_to(ROOT).parts[0] for p in SOURCES} >= {"integrators", "benchmarks"}


def test_the_integrators_import_neither_references_nor_other_solvers():
    for path in (ROOT / "integrators").rglob("*.py"):
        assert not imported(path.read_text(), "integrators") & set(HEAVY), path.name


def fresh(code: str):
    """What ``code`` prints in a fresh process, as JSON."""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=dict(os.environ), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("statement", ["import integrators", "import reference", "import benchmarks.problems"])
def test_heavy_packages_are_not_loaded(statement):
    loaded = fresh(f"{statement}\nimport sys, json\nprint(json.dumps([m for m in {HEAVY!r} if m in sys.modules]))")
    # Numba imports SciPy's top level by itself, its solvers it does not.
    assert set(loaded) <= ({"scipy"} if "problems" in statement else set())


def test_the_solvers_of_scipy_are_not_loaded():
    assert fresh("import benchmarks.problems, sys, json\nprint(json.dumps('scipy.integrate' in sys.modules))") is False


def test_an_integration_loads_no_other_solver():
    code = (
        "from integrators import Hamiltonian, integrate\nimport sys, json\n"
        "s = integrate(Hamiltonian(q='q', p='p', H='p**2/2 - cos(q)'), 'scheme-i', h=0.1, steps=2, q0=[1], p0=[0])\n"
        f"print(json.dumps([s.status, [m for m in {HEAVY!r} if m != 'scipy' and m in sys.modules]]))"
    )
    assert fresh(code) == ["ok", []]


def test_control_heavy_packages_would_be_seen():
    assert fresh("import scipy, sys, json\nprint(json.dumps('scipy' in sys.modules))") is True


PUBLIC = ("integrate", "method", "Hamiltonian", "METHODS", "Solution", "InvalidInput")
#: Imports the public names in every order of two, each from a package that is fresh, and prints which came as modules.
PAIRS = """
import importlib, json, sys, types
wrong = []
for first in {public!r}:
    for name in {public!r}:
        for loaded in [m for m in sys.modules if m.split(".")[0] == "integrators"]:
            del sys.modules[loaded]
        package = importlib.import_module("integrators")
        getattr(package, first)
        if isinstance(getattr(package, name), types.ModuleType):
            wrong.append([first, name])
print(json.dumps(wrong))
"""


def test_public_names_are_the_objects_whatever_was_imported_first():
    """``integrate`` and ``method`` are also names of modules, which the import of another name may bring in."""
    assert fresh(PAIRS.format(public=PUBLIC)) == []


def test_public_names_survive_the_import_of_their_modules():
    code = "import integrators.driver, integrators.record, integrators.registry, json, types\n"
    code += "from integrators import integrate, method\n"
    code += "print(json.dumps([isinstance(x, types.ModuleType) for x in (integrate, method)]))"
    assert fresh(code) == [False, False]
