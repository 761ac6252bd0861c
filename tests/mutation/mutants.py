"""The mutants of a file: each is the file with one number, sign, comparison, condition, return or choice changed.

The changes are Cosmic Ray's, one or two of each kind, and three of our own: another number, a value that is not
returned, and the greater taken for the less.  A change of an annotation, a docstring, a decorator or a figure is none.
"""

from __future__ import annotations

import ast
import difflib
import hashlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator
from parso import parse

_BINARY = "Add_Sub Sub_Add Mul_Div Div_Mul FloorDiv_Mul Mod_Mul Pow_Mul BitOr_BitAnd BitAnd_BitOr"
_COMPARISONS = "Eq_NotEq NotEq_Eq Lt_LtE Lt_GtE LtE_Lt LtE_Gt Gt_GtE Gt_LtE GtE_Gt GtE_Lt Is_IsNot IsNot_Is"
_UNARY = "Delete_USub Delete_Not Delete_Invert"
_OTHERS = "AddNot ReplaceTrueWithFalse ReplaceFalseWithTrue ReplaceAndWithOr ReplaceOrWithAnd"
_LOOPS = "ZeroIterationForLoop ReplaceBreakWithContinue ReplaceContinueWithBreak"
NAMES = (
    *(f"ReplaceBinaryOperator_{x}" for x in _BINARY.split()),
    *(f"ReplaceComparisonOperator_{x}" for x in _COMPARISONS.split()),
    *(f"ReplaceUnaryOperator_{x}" for x in _UNARY.split()),
    *_OTHERS.split(),
    *_LOOPS.split(),
)
SWAPPED = {"min": "max", "any": "all", "idxmin": "idxmax", "argmin": "argmax", "head": "tail", "notna": "isna"}
SWAPPED |= {other: name for name, other in SWAPPED.items()} | {"median": "max", "sum": "max"}
#: What is judged by eye: functions that return this, begin so or use these, and arguments.
DRAWN, DRAWING, BRUSHES = "Picture", ("draw", "_draw"), {"axes", "style"}
LOOKS = {"alpha", "dpi", "figsize", "fontsize", "linewidth", "markersize", "zorder"}
#: Arguments that check or hurry and change no result.
SILENT = {"strict", "stacklevel", "low_memory"} | LOOKS
#: Functions of which the arguments after the first say how much is shown, or to how many digits.
SHOWING = {"listed", "number"}


class _Own(Operator):
    """A change that Cosmic Ray does not make, at most one of a node."""

    def mutation_positions(self, node) -> Iterator:
        """Where it is made."""
        if self.found(node):
            yield node.start_pos, node.end_pos

    @classmethod
    def examples(cls):
        """None."""
        return ()


class Number(_Own):
    """One more than an integer, ten times another number."""

    def found(self, node) -> bool:
        """Whether it is a number that can be read."""
        return node.type == "number" and not node.value.lower().startswith(("0x", "0b", "0o"))

    def mutate(self, node, index):
        """The node with the other number."""
        value = ast.literal_eval(node.value)
        node.value = repr(value + 1 if isinstance(value, int) else 10 * value or 1.0)
        return node


class Swap(_Own):
    """The greater for the less, any for all."""

    def found(self, node) -> bool:
        """Whether a name is called that has an opposite."""
        called = node.get_next_leaf() if node.type == "name" and node.value in SWAPPED else None
        return called is not None and called.value == "("

    def mutate(self, node, index):
        """The node with its opposite."""
        node.value = SWAPPED[node.value]
        return node


class ReturnNothing(_Own):
    """A value that is not returned."""

    def found(self, node) -> bool:
        """Whether a value is."""
        return node.type == "return_stmt" and node.children[1].type != "keyword"

    def mutate(self, node, index):
        """The node without it."""
        node.children[1] = parse(" None").children[0]
        return node


_OWN = {kind.__name__: kind for kind in (Number, Swap, ReturnNothing)}


@dataclass(frozen=True)
class Mutant:
    """A file with one change.

    Attributes
    ----------
    path : of the file, from the root of the project
    line : the first that differs
    before, after : the lines that differ
    where : the functions that they are in
    code : the changed file
    copy : how many others of the file read the same
    """

    path: str
    line: int
    before: str
    after: str
    where: str
    code: str = field(repr=False)
    copy: int = 0

    @property
    def id(self) -> str:
        """What tells it from others, wherever its lines have moved."""
        return f"{self.path}::{self.where}: {self.before} -> {self.after}" + f" ({self.copy + 1})" * (self.copy > 0)

    @property
    def place(self) -> str:
        """Its place in the order in which the mutants of a file are tried, which is by no rule."""
        return hashlib.sha256(self.id.encode()).hexdigest()


@cache
def _operator(name: str) -> Operator:
    return _OWN[name]() if name in _OWN else get_operator(f"core/{name}")()


def mutants(root: Path, path: str) -> list[Mutant]:
    """Those of a file that change what it does, by lines."""
    code = (root / path).read_text()
    lines, scopes = code.splitlines(keepends=True), _scopes(code)
    found: list[Mutant] = []
    seen: Counter[str] = Counter()
    for first, last, skipped in _chunks(code):
        chunk = "".join(lines[first:last])
        for changed in _changed(chunk):
            row, before, after = _difference(chunk, changed)
            where = _within(scopes, first + row)
            if first + row in skipped:
                continue
            whole = "".join([*lines[:first], changed, *lines[last:]])
            mutant = Mutant(path, first + row, before, after, where, whole)
            found.append(replace(mutant, copy=seen[mutant.id]))
            seen[mutant.id] += 1
    return sorted(found, key=lambda m: m.line)


def _chunks(code: str) -> Iterator[tuple[int, int, set[int]]]:
    """The lines of each statement of a module, and which of them decorate or draw."""
    for node in ast.parse(code).body:
        heads = [d for n in ast.walk(node) for d in getattr(n, "decorator_list", ())]
        first = min([node.lineno, *(d.lineno for d in heads)]) - 1
        silent = [*heads, *(n for n in ast.walk(node) if isinstance(n, ast.FunctionDef) and _drawing(n))]
        yield first, node.end_lineno, {line for n in silent for line in range(n.lineno, n.end_lineno + 1)}


def _drawing(function: ast.FunctionDef) -> bool:
    made = ast.unparse(function.returns) if function.returns else ""
    named = {n.id for n in ast.walk(function) if isinstance(n, ast.Name)}
    return function.name.startswith(DRAWING) or DRAWN in made or bool(named & BRUSHES)


def _changed(chunk: str) -> Iterator[str]:
    """A statement with each of the changes that changes its meaning."""
    seen, nodes = {_meaning(chunk), ""}, list(ast_nodes(get_ast(chunk)))
    for name in (*NAMES, *_OWN):
        operator = _operator(name)
        for occurrence in range(sum(1 for node in nodes for _ in operator.mutation_positions(node))):
            changed = mutate_code(chunk, operator, occurrence)
            meaning = "" if changed is None else _meaning(changed)
            if meaning not in seen:
                seen.add(meaning)
                yield changed


def _meaning(code: str) -> str:
    """The code's tree without annotations, docstrings and looks; empty for what is not Python."""
    try:
        tree = ast.parse(code)
    except SyntaxError:
        return ""
    for node in ast.walk(tree):
        for part in ("annotation", "returns"):
            if hasattr(node, part) and not (isinstance(node, ast.AnnAssign) and node.value is None):
                setattr(node, part, None if part == "returns" or isinstance(node, ast.arg) else ast.Constant(0))
        if isinstance(node, ast.AnnAssign) and node.value is None:
            node.annotation = ast.Constant(0)
        if isinstance(node, ast.Call):
            node.keywords = [k for k in node.keywords if k.arg not in SILENT]
            if getattr(node.func, "id", None) in SHOWING:
                node.args = node.args[:1]
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            node.value = ast.Constant(0)
    return ast.dump(tree)


def _difference(code: str, changed: str) -> tuple[int, str, str]:
    old, new = code.splitlines(), changed.splitlines()
    blocks = difflib.SequenceMatcher(None, old, new, autojunk=False).get_opcodes()
    (_, a, b, c, d), *_ = [block for block in blocks if block[0] != "equal"]
    return a + 1, " ".join(x.strip() for x in old[a:b]), " ".join(x.strip() for x in new[c:d])


def _scopes(code: str) -> list[tuple[int, int, str]]:
    kinds = (ast.FunctionDef, ast.ClassDef)
    return [(n.lineno, n.end_lineno, n.name) for n in ast.walk(ast.parse(code)) if isinstance(n, kinds)]


def _within(scopes: list[tuple[int, int, str]], line: int) -> str:
    return ".".join(name for first, last, name in sorted(scopes) if first <= line <= last)
