"""What of the source code a measured number depends on, as a digest: the files that a module imports, and theirs.

Comments, docstrings and blank lines do not count: they change no number.
"""

from __future__ import annotations

import ast
import hashlib
import io
import tokenize
from collections.abc import Iterable
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "phasebench"
#: Rooms that are not followed into: what a number takes from them is data, which a cell names by itself (a method's
#: record, a problem, a peer), or does not depend on them (rows on disk).
DATA = (
    f"{PACKAGE}.integrators.registry",
    f"{PACKAGE}.integrators.records",
    f"{PACKAGE}.reference.peers",
    f"{PACKAGE}.benchmarks.problems",
    f"{PACKAGE}.benchmarks.rows",
)


def path_of(module: str, root: Path = ROOT) -> Path | None:
    """The source file of a module of this project, None of another's."""
    first, *rest = module.split(".")
    if first != PACKAGE or not rest:
        return None
    path = root.joinpath(*rest)
    if path.is_dir():
        return path / "__init__.py"
    path = path.with_suffix(".py")
    return path if path.exists() else None


def imports(text: str, module: str, package: bool = False) -> set[str]:
    """The dotted names of everything that a source imports, at whatever depth; ``package``: it is an __init__."""
    parts = module.split(".")
    names = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            home = parts[: len(parts) - node.level + package] if node.level else []
            base = ".".join([*home, *([node.module] if node.module else [])])
            names |= {base, *(f"{base}.{a.name}" for a in node.names)}
    return names


def essence(text: str) -> str:
    """A source without comments, docstrings and blank lines."""
    lines = text.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column]
    for node in ast.walk(ast.parse(text)):
        body = getattr(node, "body", None)
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and ast.get_docstring(node) is not None:
            first = body[0]
            lines[first.lineno - 1 : first.end_lineno] = [""] * (first.end_lineno - first.lineno + 1)
    return "\n".join(line.rstrip() for line in lines if line.strip())


@cache
def _file(path: Path, module: str) -> tuple[str, frozenset[str]]:
    """(digest of a source's essence, modules of this project that it imports)."""
    text = path.read_text()
    names = imports(text, module, package=path.name == "__init__.py")
    return hashlib.sha256(essence(text).encode()).hexdigest(), frozenset(n for n in names if n.startswith(PACKAGE))


def _followed(module: str, start: str) -> bool:
    """Whether a module counts for ``start``: those of `DATA` do for their neighbours alone, their list for nobody."""
    room = next((d for d in DATA if module == d or module.startswith(f"{d}.")), None)
    return room is None or module == start or (module != room and start.startswith(f"{room}."))


@cache
def closure(module: str, root: Path = ROOT) -> dict[str, str]:
    """Module -> digest of the module and of all that it imports, at whatever depth, short of `DATA`."""
    files: dict[str, str] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = path_of(name, root)
        if path is None or name in files or not _followed(name, module):
            continue
        files[name], more = _file(path, name)
        waiting += more
    return files


def digest(modules: Iterable[str], root: Path = ROOT) -> str:
    """The digest of several modules with all that they import."""
    together: dict[str, str] = {}
    for module in modules:
        together |= closure(module, root)
    return hashlib.sha256(repr(sorted(together.items())).encode()).hexdigest()
