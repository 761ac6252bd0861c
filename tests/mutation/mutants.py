"""The mutants of a file: each is the file with one number, sign, comparison, condition, return or choice changed.

The changes are Cosmic Ray's, one or two of each kind, and two of our own: a value that is not returned, and the greater
taken for the less.  A change of an annotation, a
docstring or a figure is none.
"""

from __future__ import annotations

import ast
import difflib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator
from parso import parse

_BINARY = "Add_Sub Sub_Add Mul_Div Div_Mul FloorDiv_Mul Mod_Mul Pow_Mul BitOr_BitAnd BitAnd_BitOr"
_COMPARISONS = "Eq_NotEq NotEq_Eq Lt_LtE Lt_GtE LtE_Lt LtE_Gt Gt_GtE Gt_LtE GtE_Gt GtE_Lt Is_IsNot IsNot_Is"
_UNARY = "Delete_USub Delete_Not Delete_Invert"
_OTHERS = "NumberReplacer AddNot ReplaceTrueWithFalse ReplaceFalseWithTrue ReplaceAndWithOr ReplaceOrWithAnd"
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
#: What is judged by eye.
DRAWN = {"draw", "drawn"}


class Swap(Operator):
    """The greater for the less, any for all."""

    def mutation_positions(self, node) -> Iterator:
        """Where a name is called that has an opposite."""
        if node.type == "name" and node.value in SWAPPED:
            called = node.get_next_leaf()
            if called is not None and called.value == "(":
                yield node.start_pos, node.end_pos

    def mutate(self, node, index):
        """The node with its opposite."""
        node.value = SWAPPED[node.value]
        return node

    @classmethod
    def examples(cls):
        """One."""
        return ()


class ReturnNothing(Operator):
    """A value that is not returned."""

    def mutation_positions(self, node) -> Iterator:
        """Where a value is."""
        if node.type == "return_stmt" and node.children[1].type != "keyword":
            yield node.start_pos, node.end_pos

    def mutate(self, node, index):
        """The node without it."""
        node.children[1] = parse(" None").children[0]
        return node

    @classmethod
    def examples(cls):
        """None."""
        return ()


@dataclass(frozen=True)
class Mutant:
    """A file with one change.

    Attributes
    ----------
    path : of the file, from the root of the project
    operator, occurrence : which change
    line : its first line
    before, after : the lines that differ
    where : the functions that they are in
    """

    path: str
    operator: str
    occurrence: int
    line: int
    before: str
    after: str
    where: str

    @property
    def id(self) -> str:
        """What tells it from others, wherever its lines have moved."""
        return f"{self.path}::{self.where}: {self.before} -> {self.after}"

    def code(self, root: Path) -> str:
        """The changed file."""
        return mutate_code((root / self.path).read_text(), _operator(self.operator), self.occurrence)


@cache
def _operator(name: str) -> Operator:
    own = {"Swap": Swap, "ReturnNothing": ReturnNothing}
    return own[name]() if name in own else get_operator(f"core/{name}")()


def mutants(root: Path, path: str) -> list[Mutant]:
    """Those of a file that change what it does."""
    code = (root / path).read_text()
    plain, scopes = _meaning(code), _scopes(code)
    found: dict[str, Mutant] = {}
    for name in (*NAMES, "Swap", "ReturnNothing"):
        occurrence = 0
        while (changed := mutate_code(code, _operator(name), occurrence)) is not None:
            redundant = name == "NumberReplacer" and occurrence % 2  # one more, or one less: one will do
            if not redundant and (meaning := _meaning(changed)) not in ("", plain) and meaning not in found:
                line, before, after = _difference(code, changed)
                where = _within(scopes, line)
                if not DRAWN & set(where.split(".")):
                    found[meaning] = Mutant(path, name, occurrence, line, before, after, where)
            occurrence += 1
    return sorted(found.values(), key=lambda m: m.line)


def _meaning(code: str) -> str:
    """The code's tree without annotations and docstrings; empty for what is not Python."""
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
        if isinstance(node, ast.Call):  # whether a length is checked changes no result
            node.keywords = [k for k in node.keywords if k.arg != "strict"]
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
