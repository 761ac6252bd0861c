"""What of a source file its results depend on: its syntax without what is for people."""

from __future__ import annotations

import ast
from collections.abc import Mapping

#: Modules whose names stand in annotations.
TYPES = ("__future__", "typing", "collections.abc")
#: Fields of syntax nodes that change no number; the last three are not the same in all versions of Python.
UNUSED = {"annotation", "returns", "type_comment", "ctx", "kind", "type_params"}
#: A function that calls one of these may look its local variables up by their names.
BY_NAME = {"locals", "vars", "eval", "exec"}


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
        if is_typed(node):
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


def is_typed(node: ast.AST) -> bool:
    """True for a node of ``if TYPE_CHECKING:``, which only a type checker reads."""
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
