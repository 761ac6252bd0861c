"""Import rules: one direction between folders, no heavy package at import, no file loaded under two names."""

from __future__ import annotations

import ast
import importlib
import json
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
#: Folder -> the folders of the project that it may import.
MAY = {
    "integrators": {"integrators"},
    "reference": {"reference", "integrators"},
    "benchmarks": {"benchmarks", "reference", "integrators"},
}
#: The subpackages of each folder from the bottom up, levels apart by <: each imports only itself and those before it.
LEVELS = {
    "integrators": "errors statuses threads < keywords names < record < compile < coefficients < values < stepping"
    " < systems < records < registry < families < request < solution < outcome < prepared < trajectory < driver"
    " < batches < scalar_fallback < crossings < ensemble < section",
    "reference": "files native < installed < solvers < peers < certificates",
    "benchmarks": "style < problems < judge < measure < store < ladder < advice < page bibliography < workprecision"
    " < audit certificate < studies < report < cli < conftest",
}
ROOMS = {folder: [level.split() for level in levels.split("<")] for folder, levels in LEVELS.items()}
HEAVY = ("heyoka", "rebound", "matplotlib", "pandas", "scipy")
#: Parts of SciPy that the integrators may use: they solve no differential equation.
ALGEBRA = ("scipy.sparse.", "scipy.optimize.")
SOURCES = [p for folder in MAY for p in sorted((ROOT / folder).rglob("*.py"))]


@cache
def imports_of(text: str, package: str) -> frozenset[str]:
    """Dotted names of all imports in a source text, nested ones too; ``package`` resolves the relative ones."""
    names, tree = set(), ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING":
            node.body = []  # imports for annotations only
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            home = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join(home + ([node.module] if node.module else []))
            names |= {f"{base}.{a.name}" for a in node.names}
        elif isinstance(node, ast.Call) and node.args:
            called, first = getattr(node.func, "attr", getattr(node.func, "id", "")), node.args[0]
            name = first.value if isinstance(first, ast.Constant) and isinstance(first.value, str) else "."
            if called in ("import_module", "__import__") and not name.startswith("."):
                names.add(name)
    return frozenset(names)


@cache
def found(path: Path) -> frozenset[str]:
    """What a source file imports."""
    return imports_of(path.read_text(), package_of(path))


def package_of(path: Path) -> str:
    """The dotted package of a source file."""
    return ".".join(("phasebench", *path.relative_to(ROOT).parent.parts))


def folders(names: set[str]) -> set[str]:
    """The project's folders among imported dotted names."""
    return {n.split(".")[1] for n in names if n.startswith("phasebench.") and n.split(".")[1] in MAY}


def upwards(folder: str, room: str, names: set[str]) -> set[str]:
    """Subpackages on a level above ``room`` that a source in ``room``, a subpackage of ``folder``, imports."""
    level = {r: i for i, rooms in enumerate(ROOMS[folder]) for r in rooms}
    here = {n.split(".")[2] for n in names if n.startswith(f"phasebench.{folder}.") and n.count(".") >= 2}
    return {r for r in here if r in level and level[r] > level[room]}


def elsewhere(own: str, names: set[str]) -> set[str]:
    """Other studies, and parts of advice or certificates, that the study ``own`` imports."""
    inner = [n.split(".")[2:4] for n in names if n.startswith("phasebench.benchmarks.")]
    studies = {part for room, part in (x for x in inner if len(x) == 2) if room == "studies"}
    return (studies | {x[0] for x in inner if x[0] in ("advice", "certificate")}) - {own, "index"}


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    """The sets of modules that import each other directly or through others (cycles of the import graph)."""
    reached = {}
    for start in graph:
        seen, todo = set(), [start]
        while todo:
            for following in graph.get(todo.pop(), ()):
                if following not in seen:
                    seen.add(following)
                    todo.append(following)
        reached[start] = seen
    together = {frozenset({m, *(x for x in reached[m] if m in reached[x])}) for m in graph if m in reached[m]}
    return [set(c) for c in together]


def test_imports_point_one_way():
    for path in SOURCES:
        assert folders(found(path)) <= MAY[path.relative_to(ROOT).parts[0]], path
        first = {n.split(".")[0] for n in found(path)}
        assert not first & {*MAY, "tests", "reports", "support"}, f"{path}: the import name is phasebench"


def test_subpackages_import_downwards():
    for path in SOURCES:
        folder, *rest = path.relative_to(ROOT).parts
        room = rest[0].removesuffix(".py")
        if room != "__init__":
            assert room in {r for rooms in ROOMS[folder] for r in rooms}, f"{room} has no place in the house"
            assert not upwards(folder, room, found(path)), path


def test_a_study_imports_no_other():
    studies = [p for p in SOURCES if "studies" in p.parts and p.stem != "__init__"]
    assert studies
    for path in studies:
        own = path.relative_to(ROOT / "benchmarks" / "studies").with_suffix("").parts[0]
        assert not elsewhere(own, found(path)), path


def test_no_modules_import_each_other():
    """Imports inside functions count."""
    sources = {package_of(p) if p.stem == "__init__" else f"{package_of(p)}.{p.stem}": p for p in SOURCES}
    graph = {}
    for name, path in sources.items():
        targets = set()
        for target in found(path):
            while target and target not in sources:
                target = target.rpartition(".")[0]
            targets.add(target)
        graph[name] = targets - {"", name}
    assert len(graph) > 400
    assert circles(graph) == []


def test_control_a_wrong_import_is_seen():
    for text, folder in (
        ("def f():\n    import phasebench.benchmarks.problems", "benchmarks"),
        ("from phasebench.reference.solvers import exact", "reference"),
        ("from . import solve\nfrom .vector import add", "integrators"),
        ("importlib.import_module('phasebench.reference.peers')", "reference"),
    ):
        assert folders(imports_of(text, "phasebench.integrators.stepping")) == {folder}
    assert upwards("integrators", "stepping", {"phasebench.integrators.families.splitting"}) == {"families"}
    assert upwards("integrators", "families", {"phasebench.integrators.values.vector.add"}) == set()
    wrong = {"phasebench.benchmarks.studies.trade.front", "phasebench.benchmarks.advice.advise.advise"}
    assert elsewhere("kepler", wrong) == {"trade", "advice"}
    assert elsewhere("advice", wrong) == {"trade"}
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [{"a", "b", "c"}]


@pytest.mark.parametrize(("module", "apart"), [("brute", True), ("__init__", False)])
def test_the_control_of_advice_shares_no_code_with_it(module, apart):
    """The brute-force check of advice imports nothing from the search; the study does (control)."""
    names = found(ROOT / "benchmarks" / "studies" / "advice" / f"{module}.py")
    searching = ("phasebench.benchmarks.advice.", "phasebench.benchmarks.ladder.")
    assert (not any(n.startswith(searching) for n in names)) == apart


def test_integrators_import_no_other_solver():
    for path in (ROOT / "integrators").rglob("*.py"):
        names = {n for n in found(path) if not n.startswith(ALGEBRA)}
        assert not {n.split(".")[0] for n in names} & set(HEAVY), path.name


def test_every_folder_of_sources_is_a_package():
    """setuptools finds packages by their __init__, through the links."""
    assert all((ROOT / "phasebench" / folder).samefile(ROOT / folder) for folder in MAY)
    assert not {p.parent for p in SOURCES if not p.with_name("__init__.py").exists()}


def test_names_that_a_module_offers_exist():
    offering = [
        importlib.import_module(f"{package_of(p)}.{p.stem}".removesuffix(".__init__"))
        for p in SOURCES
        if "\n__all__ = [" in p.read_text()
    ]
    assert len(offering) >= 4
    assert not [f"{m.__name__}.{n}" for m in offering for n in m.__all__ if not hasattr(m, n)]


# -- in a fresh process -----------------------------------------------------------------------------------------------


def fresh(code: str):
    """Run code in a fresh Python process and return the last line it prints, read as JSON."""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


#: Imports and uses parts one after the other; prints the heavy packages that are loaded after each.
LOADS = f"""
import json, sys
loaded = lambda: [m for m in {(*HEAVY, "scipy.integrate")!r} if m in sys.modules]
import phasebench.integrators
seen = [loaded()]
import phasebench.benchmarks.problems
from phasebench import Hamiltonian, integrate
s = integrate(Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)"), "scheme-i", h=0.1, steps=2, q0=[1], p0=[0])
assert s.status == "ok"
seen.append(loaded())
import scipy.integrate
print(json.dumps([*seen, loaded()]))
"""


def test_heavy_packages_are_not_loaded():
    """Numba itself imports the top level of SciPy. Of the references `test_solvers` shows it."""
    integrators, integration, control = map(set, fresh(LOADS))
    assert not integrators
    assert integration <= {"scipy"}
    assert control == {"scipy", "scipy.integrate"}


#: Imports a public name into a fresh package and prints those that are modules then.
PAIRS = """
import importlib, json, sys, types
wrong = []
for first in ("Hamiltonian", "Solution", "method"):
    for loaded in [m for m in sys.modules if m.split(".")[0] == "phasebench"]:
        del sys.modules[loaded]
    package = importlib.import_module("phasebench")
    getattr(package, first)
    names = [n for n in ("integrate", "method") if isinstance(getattr(package, n), types.ModuleType)]
    wrong += [[first, n] for n in names]
print(json.dumps(wrong))
"""


def test_public_names_are_never_their_modules():
    """Modules have the names ``integrate`` and ``method`` as well; importing another name must not bring them in."""
    assert fresh(PAIRS) == []


#: Collects a bench as `pytest benchmarks` does; prints the project's files loaded as two modules.
TWICE = """
import json, os, sys, pytest
pytest.main(["benchmarks/store/bench_canary.py", "--collect-only", "-q", "-p", "no:cacheprovider"])
import phasebench.benchmarks.cli, phasebench.benchmarks.report
seen = {}
for name, module in list(sys.modules.items()):
    file = getattr(module, "__file__", None)
    file = os.path.realpath(file) if file else ""
    if file.startswith(ROOT) and "/tests/" not in file[len(ROOT) :]:
        seen.setdefault(file, []).append(name)
bare = lambda f: f.endswith("__init__.py") and len(__import__("ast").parse(open(f).read()).body) <= 1
print()
print(json.dumps([len(seen), {f: n for f, n in seen.items() if len(n) > 1 and not bare(f)}]))
"""


def test_no_source_is_loaded_under_two_names():
    """A file loaded twice would define two classes InvalidInput. Packages of benches, which pytest loads under a name
    of its own, must hold nothing but a docstring."""
    packages = [p.with_name("__init__.py") for p in (ROOT / "benchmarks").glob("*/bench_*.py")]
    assert [p for p in packages if len(ast.parse(p.read_text()).body) > 1] == []
    count, twice = fresh(f"ROOT = {str(ROOT)!r}" + TWICE)
    assert count > 40
    assert twice == {}
