"""Digests of the source code that a measured number depends on: a module and everything that it imports.

Comments, docstrings, annotations and layout are left out, since they change no number.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

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


def path_of(module: str, root: Path = ROOT) -> Path | None:
    """The source file of a module of this project; None for other modules."""
    first, *rest = module.split(".")
    if first != PACKAGE or not rest:
        return None
    path = root.joinpath(*rest)
    if path.is_dir():
        return path / "__init__.py"
    path = path.with_suffix(".py")
    return path if path.exists() else None


def imports(text: str, module: str, package: bool = False) -> set[str]:
    """Dotted names of everything that a source imports, also inside functions; ``package`` marks an __init__.py.

    What only a type checker reads (``if TYPE_CHECKING:``) is left out.
    """
    parts = module.split(".")
    names = set()
    for node in _run_nodes(ast.parse(text)):
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


def essence(text: str) -> str:
    """The part of a source file on which its results depend, as text, to be hashed.

    It is the syntax tree without comments, docstrings, annotations, and the imports that only annotations need.
    """
    return _essence(ast.parse(text))


#: Modules whose names stand in annotations.
TYPES = ("__future__", "typing", "collections.abc")
#: Fields of syntax nodes that change no number; the last three are not the same in all versions of Python.
UNUSED = {"annotation", "returns", "type_comment", "ctx", "kind", "type_params"}


def _essence(node: object) -> str:
    if isinstance(node, list):
        return "[" + ",".join(filter(None, map(_essence, node))) + "]"
    if not isinstance(node, ast.AST):
        return repr(node)
    if isinstance(node, ast.ImportFrom) and node.module in TYPES:
        return ""
    if _is_typed(node):
        return "".join(map(_essence, node.orelse))
    fields = dict(ast.iter_fields(node))
    if (
        isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef))
        and ast.get_docstring(node, clean=False) is not None
    ):
        fields["body"] = fields["body"][1:]
    return f"{type(node).__name__}({','.join(_essence(v) for k, v in fields.items() if k not in UNUSED)})"


def _is_typed(node: ast.AST) -> bool:
    """True for a node of ``if TYPE_CHECKING:``, which only a type checker reads."""
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


@cache
def _file(path: Path, module: str) -> tuple[str, frozenset[str]]:
    """Return (digest of the code of a source file, names of the modules of this project that it imports)."""
    text = path.read_text()
    names = imports(text, module, package=path.name == "__init__.py")
    return hashlib.sha256(essence(text).encode()).hexdigest(), frozenset(n for n in names if n.startswith(PACKAGE))


def _depends(module: str, start: str) -> bool:
    """True if the code of ``module``, imported directly or not by ``start``, counts for the digest of ``start``.

    A module in one of the packages `DATA` counts only for modules of the same package: what other modules take from it
    is hashed as data.
    """
    room = next((d for d in DATA if module == d or module.startswith(f"{d}.")), None)
    return room is None or module == start or (module != room and start.startswith(f"{room}."))


@cache
def closure(module: str, root: Path = ROOT) -> dict[str, str]:
    """Return a dict: module -> digest of its code, for ``module`` and all that it imports, directly or not.

    Modules of other projects are left out, and those in a package of `DATA` unless ``module`` is in that package, too.
    """
    files: dict[str, str] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = path_of(name, root)
        if path is None or name in files or not _depends(name, module):
            continue
        files[name], more = _file(path, name)
        waiting += more
    return files


def digest(modules: Iterable[str], root: Path = ROOT) -> str:
    """One digest of several modules with all that they import."""
    together: dict[str, str] = {}
    for module in modules:
        together |= closure(module, root)
    return hashlib.sha256(repr(sorted(together.items())).encode()).hexdigest()
