"""Mutants of a file: copies with one number, sign, comparison, condition, return or call changed.

The operators are a selection of Cosmic Ray's and three of our own: `Number`, `Swap` and `ReturnNothing`. Annotations,
docstrings, decorators and drawing code are not mutated.
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
#: Drawing code, which is judged by eye: functions with this return type, these prefixes or these variables.
DRAWN, DRAWING, BRUSHES = "Picture", ("draw", "_draw"), {"axes", "style"}
LOOKS = {"alpha", "dpi", "figsize", "fontsize", "linewidth", "markersize", "zorder"}
#: Keyword arguments that do not change a result: checks, speed and looks.
SILENT = {"strict", "stacklevel", "low_memory"} | LOOKS
#: Functions whose arguments after the first choose how much is shown, or how many digits.
SHOWING = {"listed", "number"}


class _Own(Operator):
    """A mutation operator of our own, applied at most once per node."""

    def mutation_positions(self, node) -> Iterator:
        """Yield the position of the node if the operator applies to it."""
        if self.found(node):
            yield node.start_pos, node.end_pos

    @classmethod
    def examples(cls):
        """No examples (required by Cosmic Ray)."""
        return ()


class Number(_Own):
    """Replace an integer n by n + 1, another number x by 10 x (zero by one)."""

    def found(self, node) -> bool:
        """Whether the node is a decimal number."""
        return node.type == "number" and not node.value.lower().startswith(("0x", "0b", "0o"))

    def mutate(self, node, index):
        """The node with its number replaced."""
        value = ast.literal_eval(node.value)
        node.value = repr(value + 1 if isinstance(value, int) else 10 * value or 1.0)
        return node


class Swap(_Own):
    """Swap min and max, any and all and the other pairs of `SWAPPED`."""

    def found(self, node) -> bool:
        """Whether the node is a name in `SWAPPED` that is called."""
        called = node.get_next_leaf() if node.type == "name" and node.value in SWAPPED else None
        return called is not None and called.value == "("

    def mutate(self, node, index):
        """The node with its name swapped."""
        node.value = SWAPPED[node.value]
        return node


class ReturnNothing(_Own):
    """Return None instead of a value."""

    def found(self, node) -> bool:
        """Whether the node returns a value other than a keyword."""
        return node.type == "return_stmt" and node.children[1].type != "keyword"

    def mutate(self, node, index):
        """The node with None in place of the value."""
        node.children[1] = parse(" None").children[0]
        return node


_OWN = {kind.__name__: kind for kind in (Number, Swap, ReturnNothing)}


@dataclass(frozen=True)
class Mutant:
    """A file with one change.

    Attributes
    ----------
    path : the file, from the root of the project
    line : the first changed line
    before, after : the changed lines, old and new
    where : dotted name of the enclosing functions and classes
    code : text of the changed file
    copy : number of earlier mutants of the file with the same text
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
        """Identifier of the mutant that does not depend on line numbers."""
        return f"{self.path}::{self.where}: {self.before} -> {self.after}" + f" ({self.copy + 1})" * (self.copy > 0)

    @property
    def place(self) -> str:
        """Sort key that puts the mutants of a file in a pseudo-random, reproducible order."""
        return hashlib.sha256(self.id.encode()).hexdigest()


@cache
def _operator(name: str) -> Operator:
    return _OWN[name]() if name in _OWN else get_operator(f"core/{name}")()


def mutants(root: Path, path: str) -> list[Mutant]:
    """All mutants of a file that change its meaning, in the order of its lines."""
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
    """(first line, last line, lines to skip) of each statement of a module; decorators and drawing code are skipped."""
    for node in ast.parse(code).body:
        heads = [d for n in ast.walk(node) for d in getattr(n, "decorator_list", ())]
        first = min([node.lineno, *(d.lineno for d in heads)]) - 1
        silent = [*heads, *(n for n in ast.walk(node) if isinstance(n, ast.FunctionDef) and _drawing(n))]
        yield first, node.end_lineno, {line for n in silent for line in range(n.lineno, n.end_lineno + 1)}


def _drawing(function: ast.FunctionDef) -> bool:
    """Whether a function draws."""
    made = ast.unparse(function.returns) if function.returns else ""
    named = {n.id for n in ast.walk(function) if isinstance(n, ast.Name)}
    return function.name.startswith(DRAWING) or DRAWN in made or bool(named & BRUSHES)


def _changed(chunk: str) -> Iterator[str]:
    """Yield a statement with each single mutation that changes its meaning."""
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
    """The syntax tree without annotations, docstrings and silent arguments; empty if the code does not parse."""
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
    """(first changed line, old text, new text) of a mutation."""
    old, new = code.splitlines(), changed.splitlines()
    blocks = difflib.SequenceMatcher(None, old, new, autojunk=False).get_opcodes()
    (_, a, b, c, d), *_ = [block for block in blocks if block[0] != "equal"]
    return a + 1, " ".join(x.strip() for x in old[a:b]), " ".join(x.strip() for x in new[c:d])


def _scopes(code: str) -> list[tuple[int, int, str]]:
    kinds = (ast.FunctionDef, ast.ClassDef)
    return [(n.lineno, n.end_lineno, n.name) for n in ast.walk(ast.parse(code)) if isinstance(n, kinds)]


def _within(scopes: list[tuple[int, int, str]], line: int) -> str:
    """Dotted name of the functions and classes around a line."""
    return ".".join(name for first, last, name in sorted(scopes) if first <= line <= last)
