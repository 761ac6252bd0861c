"""What the suite notices of changes to itself: the score that ``python tests/mutation`` keeps of each file.

A mutant is a file with one number, sign, comparison, condition or return changed.  It is killed where a test fails; it
survives where none does, unless it is argued to change nothing.  A file that is not in the score has a row too: what was
not judged is never passed.
"""

from __future__ import annotations

import ast
import csv
import hashlib
from pathlib import Path

from phasebench.benchmarks.rows import sources

SCORE = sources.ROOT / "tests" / "mutation" / "score.csv"
COUNTS = ("mutants", "tried", "killed", "equivalent")
#: Between the survivors of a file.
AND = " && "
#: What the score is to cover, and what begins the name of a file of tests there.
FOLDERS, TESTS = ("benchmarks", "integrators", "reference"), "bench_"


def frame(score: Path = SCORE, root: Path = sources.ROOT) -> list[dict[str, object]]:
    """A row for each file that was judged, and for each that was not."""
    lines = _lines(score)
    rows = [_row(of, root) for of in lines]
    none = {"judged": False, **dict.fromkeys((*COUNTS, "survived"), 0), "as judged": False}
    rows += [{"file": path} | none for path in unjudged(lines, root)]
    return sorted(rows, key=lambda row: str(row["file"]))


def _lines(score: Path) -> list[dict[str, str]]:
    with score.open(newline="") as lines:
        return list(csv.DictReader(lines))


def _row(of: dict[str, str], root: Path) -> dict[str, object]:
    counts = {name: int(of[name]) for name in COUNTS}
    survived = len(of["survived"].split(AND)) if of["survived"] else 0
    known = {"judged": True} | counts | {"survived": survived, "as judged": digest(root / of["path"]) == of["hash"]}
    return {"file": of["path"]} | known


def unjudged(lines: list[dict[str, str]], root: Path = sources.ROOT) -> list[str]:
    """The files of `FOLDERS` that are not in the score, without tests and those in which there is nothing to change."""
    judged = {of["path"] for of in lines}
    files = {p.relative_to(root).as_posix(): p for folder in FOLDERS for p in (root / folder).rglob("*.py")}
    left = {path: p for path, p in files.items() if path not in judged and TESTS not in p.name}
    return sorted(path for path, p in left.items() if changeable(p.read_text()))


def changeable(code: str) -> bool:
    """Whether a source has a function, a comparison or a number, and so mutants."""
    return any(
        isinstance(node, (ast.FunctionDef, ast.Compare))
        or (isinstance(node, ast.Constant) and type(node.value) in (int, float))
        for node in ast.walk(ast.parse(code))
    )


def digest(file: Path) -> str:
    """What tells a file's content from another's; empty for none."""
    return hashlib.sha256(file.read_bytes()).hexdigest()[:12] if file.is_file() else ""


def digests(score: Path = SCORE, root: Path = sources.ROOT) -> list[str]:
    """What the rows depend on."""
    lines = _lines(score)
    return [digest(score), *(digest(root / of["path"]) for of in lines), *unjudged(lines, root)]
