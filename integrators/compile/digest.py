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
#: Modules that no number depends on: they keep files, show progress, word messages.
SILENT = frozenset(
    f"{PACKAGE}.{name}"
    for name in (
        "integrators.compile.cache",
        "integrators.compile.digest",
        "integrators.compile.preparation",
        "integrators.compile.progress",
        "integrators.errors",
        "integrators.systems.deferred",
        "reference.files",
        "reference.installed",
    )
)
#: Modules in which a text with a blank is for people, and is no code; statuses and names of columns have no blanks.
WORDED = frozenset(
    f"{PACKAGE}.integrators.{name}"
    for name in ("driver", "outcome", "prepared", "request", "solution", "statuses", "trajectory")
)
#: Modules whose names stand in annotations.
TYPES = ("__future__", "typing", "collections.abc")
#: Fields of syntax nodes that change no number; the last three are not the same in all versions of Python.
UNUSED = {"annotation", "returns", "type_comment", "ctx", "kind", "type_params"}
#: A function that calls one of these may look its local variables up by their names.
BY_NAME = {"locals", "vars", "eval", "exec"}
#: The entry of `store` with what was found in source files: their hash -> [digest, names of imported modules].
KNOWN = "sources.json"
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

    What only a type checker reads (``if TYPE_CHECKING:``) is left out.
    """
    parts = module.partition(":")[0].split(".")
    names = set()
    for node in _run_nodes(ast.parse(source) if isinstance(source, str) else source):
        if isinstance(node, ast.Import):
            names |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            home = parts[: len(parts) - node.level + package] if node.level else []
            base = ".".join([*home, *([node.module] if node.module else [])])
            names |= {base, *(f"{base}.{a.name}" for a in node.names)}
    return names


def _run_nodes(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a syntax tree, without those under ``if TYPE_CHECKING:``."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        waiting += node.orelse if _is_typed(node) else ast.iter_child_nodes(node)


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


def essence(source: str | ast.AST, worded: bool = False) -> str:
    """The part of a source file on which its results depend, as text, to be hashed.

    It is the syntax tree without comments, docstrings, annotations, the imports that only annotations need, what is
    said of a raised exception, and names of local variables.  With ``worded`` texts with a blank are left out, too.
    """
    return _Essence(worded).of(ast.parse(source) if isinstance(source, str) else source, {})


class _Essence:
    """Writes syntax trees as text; ``names`` maps local variables of the functions around a node to their numbers."""

    def __init__(self, worded: bool) -> None:
        self.worded = worded

    def of(self, node: object, names: Mapping[str, str]) -> str:
        if isinstance(node, list):
            return "[" + ",".join(filter(None, (self.of(member, names) for member in node))) + "]"
        if not isinstance(node, ast.AST):
            return repr(node)
        if isinstance(node, ast.ImportFrom) and node.module in TYPES:
            return ""
        if _is_typed(node):
            return "".join(self.of(member, names) for member in node.orelse)
        if self.worded and isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            return "words"
        if isinstance(node, ast.Name):
            return f"Name({names.get(node.id, node.id)})"
        fields = dict(ast.iter_fields(node))
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and ast.get_docstring(node, clean=False):
            fields["body"] = fields["body"][1:]
        if isinstance(node, ast.JoinedStr):  # newer versions of Python add empty texts
            fields["values"] = [v for v in node.values if getattr(v, "value", None) != ""]
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            fields["exc"] = node.exc.func
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            names = _local_names(node, names)
        return f"{type(node).__name__}({','.join(self.of(v, names) for k, v in fields.items() if k not in UNUSED)})"


def _local_names(function: ast.AST, outside: Mapping[str, str]) -> dict[str, str]:
    """Number the variables of a function that are assigned as names in its body, in order of first appearance.

    Parameters keep their names, by which they may be passed, and so does what is bound otherwise (by a definition, an
    import, a declaration, in a class).  ``outside`` are the numbers of the variables of functions around it.
    """
    inner = [node for part in ast.iter_child_nodes(function) for node in ast.walk(part)]
    used = {n.id for n in inner if isinstance(n, ast.Name)}
    fixed = {n.arg for n in inner if isinstance(n, ast.arg)}
    for node in inner:
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.ExceptHandler, ast.MatchAs)):
            fixed.add(node.name)
        elif isinstance(node, ast.alias):
            fixed.add(node.asname or node.name.partition(".")[0])
        elif isinstance(node, (ast.Global, ast.Nonlocal)):
            fixed |= {*node.names}
        if isinstance(node, ast.ClassDef):
            fixed |= {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
    out = {name: number for name, number in outside.items() if name not in fixed}
    if used & BY_NAME:
        return {}
    assigned = dict.fromkeys(n.id for n in inner if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store))
    return out | {name: f"%{len(out) + k}" for k, name in enumerate(n for n in assigned if n not in fixed | {*out})}


def _is_typed(node: ast.AST) -> bool:
    """True for a node of ``if TYPE_CHECKING:``, which only a type checker reads."""
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


@cache
def _known() -> dict[str, list]:
    """What earlier processes found in source files, by the hash of the file and its module's name."""
    content = store.read(KNOWN)
    return {} if content is None else json.loads(content)


@cache
def _file(path: Path, module: str) -> tuple[str, frozenset[str]]:
    """Return (digest of the code of a source file, names of the modules of this project that it imports)."""
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
    """True if the code of ``module``, imported directly or not by ``start``, counts for the digest of ``start``.

    A module in one of the packages `DATA` counts only for modules of the same package: what other modules take from it
    is hashed as data.
    """
    if module in SILENT:
        return False
    room = next((d for d in DATA if module == d or module.startswith(f"{d}.")), None)
    return room is None or module == start or (module != room and start.startswith(f"{room}."))


@cache
def closure(module: str, root: Path = ROOT) -> dict[str, str]:
    """Return a dict: module -> digest of its code, for ``module`` and all that it imports, directly or not.

    Modules of other projects are left out, those that are `SILENT`, and those in a package of `DATA` unless ``module``
    is in that package, too.
    """
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
    """The names of the modules that a method runs on: that of its step, and those of the parts that it is made of.

    Parts are methods and functions.
    """
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
