"""The house: imports point one way, heavy packages wait until they are needed, no file is loaded under two names."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
#: Each folder with those of the project that it may import.
MAY = {
    "integrators": {"integrators"},
    "reference": {"reference", "integrators"},
    "benchmarks": {"benchmarks", "reference", "integrators"},
}
#: The rooms of a folder from the bottom up: a room imports those before it, and itself.
ROOMS = {
    "integrators": (
        ("errors", "threads"),
        ("coefficients",),
        ("record",),
        ("engine",),
        ("systems",),
        ("records",),
        ("registry",),
        ("families",),
        ("request",),
        ("solution",),
        ("outcome",),
        ("prepared",),
        ("trajectory",),
        ("driver",),
        ("lots",),
        ("singles",),
        ("crossings",),
        ("ensemble",),
        ("section",),
    ),
    "reference": (("tables",), ("solvers",), ("peers",), ("certificates",)),
    "benchmarks": (
        ("problems",),
        ("rows",),
        ("measure",),
        ("advice",),
        ("page", "bibliography", "history"),
        ("workprecision",),
        ("certificate",),
        ("experiments",),
        ("report",),
        ("cli",),
        ("__main__", "conftest"),
    ),
}
HEAVY = ("heyoka", "rebound", "matplotlib", "pandas", "scipy")
#: SciPy's sparse matrices and minimizers, which solve no equation of motion.
ALGEBRA = ("scipy.sparse.", "scipy.optimize.")


def imported(text: str, package: str) -> set[str]:
    """The dotted names of everything that a source imports, at whatever depth; ``package`` is the dotted home."""
    names = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            home = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join(home + ([node.module] if node.module else []))
            names |= {f"{base}.{a.name}" for a in node.names}
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) in (
            "import_module",
            "__import__",
        ):
            first = node.args[0] if node.args else None
            if isinstance(first, ast.Constant) and isinstance(first.value, str) and not first.value.startswith("."):
                names.add(first.value)
    return names


def package_of(path: Path) -> str:
    """The dotted package of a source file."""
    return ".".join(("phasebench", *path.relative_to(ROOT).parent.parts))


def folders(names: set[str]) -> set[str]:
    """Those of the project's folders that are imported."""
    return {n.split(".")[1] for n in names if n.startswith("phasebench.") and n.split(".")[1] in MAY}


SOURCES = [p for folder in MAY for p in sorted((ROOT / folder).rglob("*.py"))]


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_point_one_way(path):
    names = imported(path.read_text(), package_of(path))
    assert folders(names) <= MAY[path.relative_to(ROOT).parts[0]]
    first = {n.split(".")[0] for n in names}
    assert not first & {*MAY, "tests", "reports", "support"}, "the import name is phasebench"


def upwards(folder: str, room: str, names: set[str]) -> set[str]:
    """The rooms of the same folder that a source in ``room`` imports against the direction."""
    level = {r: i for i, rooms in enumerate(ROOMS[folder]) for r in rooms}
    here = {n.split(".")[2] for n in names if n.startswith(f"phasebench.{folder}.") and n.count(".") >= 2}
    return {r for r in here if r in level and level[r] > level[room]}


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_rooms_import_downwards(path):
    folder, *rest = path.relative_to(ROOT).parts
    room = rest[0].removesuffix(".py")
    if room == "__init__":
        return
    assert room in {r for rooms in ROOMS[folder] for r in rooms}, f"{room} has no place in the house"
    assert not upwards(folder, room, imported(path.read_text(), package_of(path)))


def test_control_a_wrong_import_is_seen():
    assert folders(imported("def f():\n    import phasebench.benchmarks.problems", "phasebench.integrators")) == {
        "benchmarks"
    }
    assert folders(imported("from phasebench.reference.solvers import exact", "phasebench.integrators")) == {
        "reference"
    }
    assert folders(imported("from . import solve\nfrom .vector import add", "phasebench.integrators.engine")) == {
        "integrators"
    }
    assert upwards("integrators", "engine", {"phasebench.integrators.families.splitting"}) == {"families"}
    assert upwards("integrators", "families", {"phasebench.integrators.engine.vector.add"}) == set()
    assert {p.relative_to(ROOT).parts[0] for p in SOURCES} == set(MAY)


def test_the_integrators_import_neither_references_nor_other_solvers():
    for path in (ROOT / "integrators").rglob("*.py"):
        names = {n for n in imported(path.read_text(), package_of(path)) if not n.startswith(ALGEBRA)}
        assert not {n.split(".")[0] for n in names} & set(HEAVY), path.name


def test_every_package_is_installed():
    """setuptools maps the folders by a list: a folder that is missing there is missing in an installation."""
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    found = [package_of(p) for folder in MAY for p in (ROOT / folder).rglob("__init__.py")]
    assert sorted(listed) == sorted(["phasebench", *found])


def fresh(code: str):
    """What ``code`` prints in a fresh process, as JSON."""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=dict(os.environ), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize(
    "statement",
    [
        "import phasebench",
        "import phasebench.integrators",
        "import phasebench.reference",
        "import phasebench.benchmarks.problems",
    ],
)
def test_heavy_packages_are_not_loaded(statement):
    heavy = (*HEAVY, "scipy.integrate")
    loaded = fresh(f"{statement}\nimport sys, json\nprint(json.dumps([m for m in {heavy!r} if m in sys.modules]))")
    # Numba imports SciPy's top level by itself, its solvers it does not.
    assert set(loaded) <= ({"scipy"} if "problems" in statement else set())


def test_an_integration_loads_no_other_solver():
    code = (
        "from phasebench import Hamiltonian, integrate\nimport sys, json\n"
        "s = integrate(Hamiltonian(q='q', p='p', H='p**2/2 - cos(q)'), 'scheme-i', h=0.1, steps=2, q0=[1], p0=[0])\n"
        f"print(json.dumps([s.status, [m for m in {HEAVY!r} if m != 'scipy' and m in sys.modules]]))"
    )
    assert fresh(code) == ["ok", []]


def test_control_heavy_packages_would_be_seen():
    assert fresh("import scipy.integrate, sys, json\nprint(json.dumps('scipy.integrate' in sys.modules))") is True


PUBLIC = ("integrate", "method", "Hamiltonian", "METHODS", "Solution", "InvalidInput")
#: Imports the public names in every order of two, each from a package that is fresh, and prints which came as modules.
PAIRS = """
import importlib, json, sys, types
wrong = []
for first in {public!r}:
    for name in {public!r}:
        for loaded in [m for m in sys.modules if m.split(".")[0] == "phasebench"]:
            del sys.modules[loaded]
        package = importlib.import_module("phasebench")
        getattr(package, first)
        if isinstance(getattr(package, name), types.ModuleType):
            wrong.append([first, name])
print(json.dumps(wrong))
"""


def test_public_names_are_the_objects_whatever_was_imported_first():
    """``integrate`` and ``method`` are also names of modules, which the import of another name may bring in."""
    assert fresh(PAIRS.format(public=PUBLIC)) == []


#: Collects the main job as `pytest benchmarks` does and prints the files of the project that have two modules.
TWICE = """
import json, sys, pytest
pytest.main(["benchmarks", "--collect-only", "-q", "-p", "no:cacheprovider"])
import phasebench.benchmarks.cli, phasebench.benchmarks.report
seen = {}
for name, module in list(sys.modules.items()):
    file = getattr(module, "__file__", None) or ""
    if file.startswith(ROOT) and "/tests/" not in file[len(ROOT) :]:
        seen.setdefault(file, []).append(name)
bare = lambda f: f.endswith("__init__.py") and len(__import__("ast").parse(open(f).read()).body) <= 1
print()
print(json.dumps([len(seen), {f: n for f, n in seen.items() if len(n) > 1 and not bare(f)}]))
"""


def test_no_source_is_loaded_under_two_names():
    """A file of which there are two modules has two InvalidInputs; pytest names the packages of benches itself, which
    therefore hold nothing but a docstring."""
    count, twice = fresh(f"ROOT = {str(ROOT)!r}" + TWICE)
    assert count > 40
    assert twice == {}
