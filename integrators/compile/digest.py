"""Digests of source code: what machine code and measured numbers depend on, a module with all that it imports.

Of a module "package.module:function" only what the function refers to counts, directly or not.

Comments, docstrings, annotations, layout, messages of exceptions and names of local variables are left out, since they
change no number.  What was found in a file is kept in `cache` under the hash of its bytes, so that a process reads its
sources and parses none.
"""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from . import cache as store
from .essence import essence, is_typed

if TYPE_CHECKING:
    from phasebench.integrators.record import Method

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "phasebench"
#: Packages whose modules are not followed: what a number takes from them is data that a cell hashes itself (a method's
#: record, a problem, a peer), or nothing (rows on disk, the style of figures).
DATA = (
    f"{PACKAGE}.integrators.registry",
    f"{PACKAGE}.integrators.records",
    f"{PACKAGE}.reference.peers",
    f"{PACKAGE}.benchmarks.problems",
    f"{PACKAGE}.benchmarks.store",
    f"{PACKAGE}.benchmarks.style",
)
#: Modules that no number depends on: they keep files, show progress, word messages, draw.
SILENT = frozenset(
    f"{PACKAGE}.{name}"
    for name in (
        "integrators.compile.cache",
        "integrators.compile.digest",
        "integrators.compile.essence",
        "integrators.compile.preparation",
        "integrators.compile.progress",
        "integrators.errors",
        "integrators.systems.deferred",
        "benchmarks.measure.figures",
        "reference.files",
        "reference.installed",
    )
)
#: Modules in which a text with a blank is for people, and is no code; statuses and names of columns have no blanks.
WORDED = frozenset(
    f"{PACKAGE}.integrators.{name}"
    for name in ("driver", "outcome", "prepared", "request", "solution", "statuses", "trajectory")
)
#: How source files are read: a change of it must not find what was found in another way.
HOW = b"".join(Path(__file__).with_name(name).read_bytes() for name in ("digest.py", "essence.py"))
#: The entry of `store` with what was found in source files: their hash -> [digest, names of imported modules].
KNOWN = f"sources-{hashlib.sha256(HOW).hexdigest()[:16]}.json"
#: The most files of which it is kept.
MOST = 5000


@cache
def path_of(module: str, root: Path = ROOT) -> Path | None:
    """The source file of a module of this project; None for other modules."""
    first, *rest = module.partition(":")[0].split(".")
    if first != PACKAGE or not rest:
        return None
    path = root.joinpath(*rest)
    if path.is_dir():
        return path / "__init__.py"
    path = path.with_suffix(".py")
    return path if path.exists() else None


def imports(source: str | ast.AST, module: str, package: bool = False) -> set[str]:
    """Dotted names of everything that a source imports, also inside functions; ``package`` marks an __init__.py.

    What only a type checker reads (``if TYPE_CHECKING:``) is left out, and a package of which modules alone are named.
    """
    parts = module.partition(":")[0].split(".")
    names = set()
    for node in _run_nodes(ast.parse(source) if isinstance(source, str) else source):
        if isinstance(node, ast.Import):
            names |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            home = parts[: len(parts) - node.level + package] if node.level else []
            base = ".".join([*home, *([node.module] if node.module else [])])
            found = {f"{base}.{a.name}" for a in node.names}
            names |= found if all(map(path_of, found)) else {base, *found}
    return names


def _run_nodes(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a syntax tree, without those under ``if TYPE_CHECKING:``."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        waiting += node.orelse if is_typed(node) else ast.iter_child_nodes(node)


def part_of(tree: ast.Module, function: str) -> ast.Module:
    """The statements of a module that define what ``function`` refers to, directly or not, and those without a name."""
    known: dict[str, list[ast.stmt]] = {}
    for statement in tree.body:
        for name in _defined(statement):
            known.setdefault(name, []).append(statement)
    taken = {id(statement) for statement in tree.body if not any(_defined(statement))}
    waiting = [function]
    while waiting:
        for statement in known.pop(waiting.pop(), ()):
            taken.add(id(statement))
            waiting += [n.id for n in ast.walk(statement) if isinstance(n, ast.Name)]
    return ast.Module([statement for statement in tree.body if id(statement) in taken], [])


def _defined(statement: ast.stmt) -> Iterator[str]:
    """The names that a statement at the top of a module defines; none of one that does something else."""
    if isinstance(statement, (ast.FunctionDef, ast.ClassDef)):
        yield statement.name
    elif isinstance(statement, (ast.Import, ast.ImportFrom)):
        yield from (alias.asname or alias.name.partition(".")[0] for alias in statement.names)
    elif isinstance(statement, (ast.Assign, ast.AnnAssign)):
        targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
        names = (node for target in targets for node in ast.walk(target) if isinstance(node, ast.Name))
        yield from (name.id for name in names if isinstance(name.ctx, ast.Store))


@cache
def _known() -> dict[str, list]:
    """What earlier processes found in source files, by the hash of the file and its module's name."""
    content = store.read(KNOWN)
    return {} if content is None else json.loads(content)


@cache
def _file(path: Path, module: str) -> tuple[str, frozenset[str]]:
    """(Digest of the code of a source file, names of the modules of this project that it imports)."""
    content = path.read_bytes()
    key = hashlib.sha256(module.encode() + b" " + content).hexdigest()[:32]
    if key not in _known():
        tree = ast.parse(content)
        _, _, function = module.partition(":")
        tree = part_of(tree, function) if function else tree
        names = imports(tree, module, package=path.name == "__init__.py")
        told = hashlib.sha256(essence(tree, module in WORDED).encode()).hexdigest()
        _known()[key] = [told, sorted(n for n in names if n.startswith(PACKAGE))]
    told, names = _known()[key]
    return told, frozenset(names)


def _depends(module: str, start: str) -> bool:
    """True if the code of ``module`` counts for the digest of ``start``; a package of `DATA` counts for itself."""
    if module in SILENT:
        return False
    room = next((d for d in DATA if module == d or module.startswith(f"{d}.")), None)
    return room is None or module == start or (module != room and start.startswith(f"{room}."))


@cache
def closure(module: str, root: Path = ROOT) -> dict[str, str]:
    """Module -> digest of its code, for ``module`` and all that it imports, directly or not, and that counts."""
    return _follow([module], module, root)


def _follow(modules: Iterable[str], start: str, root: Path) -> dict[str, str]:
    before = len(_known())
    files: dict[str, str] = {}
    waiting = [*modules]
    while waiting:
        name = waiting.pop()
        if name in files or not _depends(name, start):
            continue
        path = path_of(name, root)
        if path is not None:
            files[name], more = _file(path, name)
            waiting += more
    if len(_known()) > before:
        store.write(KNOWN, json.dumps(dict(list(_known().items())[-MOST:])).encode())
    return files


def families(method: Method) -> list[str]:
    """The modules that a method runs on: that of its step, and those of the methods and functions it is made of."""
    modules = [f"{PACKAGE}.integrators.families.{method.family}"]
    modules += [name for part in method.data if hasattr(part, "family") for name in families(part)]
    modules += [part.__module__ for part in method.data if callable(part) and hasattr(part, "__module__")]
    return [name for name in modules if name.startswith(PACKAGE)]


@cache
def of_folder(package: str) -> str:
    """The digest of all modules of a package of this project, such as "integrators.systems", with what they import."""
    files = sorted(ROOT.joinpath(*package.split(".")).rglob("*.py"))
    modules = [".".join([PACKAGE, *path.relative_to(ROOT).with_suffix("").parts]) for path in files]
    modules = [name.removesuffix(".__init__") for name in modules]
    return _hash(_follow(modules, f"{PACKAGE}.{package}.", ROOT))


def digest(modules: Iterable[str], root: Path = ROOT) -> str:
    """One digest of several modules with all that they import."""
    together: dict[str, str] = {}
    for module in modules:
        together |= closure(module, root)
    return _hash(together)


def _hash(files: Mapping[str, str]) -> str:
    return hashlib.sha256(repr(sorted(files.items())).encode()).hexdigest()
