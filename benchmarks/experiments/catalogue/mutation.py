"""Read the score of the suite's mutation tests, which ``python tests/mutation`` stores for each source file.

A mutant is a file with one number, sign, comparison, condition or return changed.  It is killed if a test fails,
otherwise it survives.  A file without a score has a row too, as not judged.
"""

from __future__ import annotations

import ast
import csv
import hashlib
from pathlib import Path

from phasebench.integrators.compile import digest as sources

SCORE = sources.ROOT / "tests" / "mutation" / "score.csv"
COUNTS = ("mutants", "tried", "killed")
#: Separator between the survivors of a file.
AND = " && "
#: The folders that the score should cover, and the prefix of the test files in them.
FOLDERS, TESTS = ("benchmarks", "integrators", "reference"), "bench_"


def frame(score: Path = SCORE, root: Path = sources.ROOT) -> list[dict[str, object]]:
    """Make a row for each source file: how many mutants it has, how many were tried and killed; zeros if not judged.

    ``score`` is the file of the stored score, ``root`` the project's folder.
    """
    lines = _lines(score)
    rows = [_row(of, root) for of in lines]
    none = {"judged": False, **dict.fromkeys((*COUNTS, "survived"), 0), "as judged": False}
    rows += [{"file": path} | none for path in files_without_score(lines, root)]
    return sorted(rows, key=lambda row: str(row["file"]))


def _lines(score: Path) -> list[dict[str, str]]:
    with score.open(newline="") as lines:
        return list(csv.DictReader(lines))


def _row(of: dict[str, str], root: Path) -> dict[str, object]:
    counts = {name: int(of[name]) for name in COUNTS}
    known = (
        {"judged": True}
        | counts
        | {"survived": counts["tried"] - counts["killed"], "as judged": digest(root / of["path"]) == of["hash"]}
    )
    return {"file": of["path"]} | known


def files_without_score(lines: list[dict[str, str]], root: Path = sources.ROOT) -> list[str]:
    """Return the paths of the source files in `FOLDERS` that have no score and could have mutants.

    ``lines`` are the lines of the stored score, dicts with the key "path"; ``root`` is the project's folder.
    """
    judged = {of["path"] for of in lines}
    files = {p.relative_to(root).as_posix(): p for folder in FOLDERS for p in (root / folder).rglob("*.py")}
    left = {path: p for path, p in files.items() if path not in judged and TESTS not in p.name}
    return sorted(path for path, p in left.items() if changeable(p.read_text()))


def changeable(code: str) -> bool:
    """True if Python source has a function, a comparison, a number or a truth value, and therefore mutants.

    Decorators are not changed.
    """
    tree = ast.parse(code)
    decorators = {x for n in ast.walk(tree) for d in getattr(n, "decorator_list", ()) for x in ast.walk(d)}
    return any(
        isinstance(node, (ast.FunctionDef, ast.Compare))
        or (isinstance(node, ast.Constant) and type(node.value) in (bool, int, float))
        for node in ast.walk(tree)
        if node not in decorators
    )


def digest(file: Path) -> str:
    """Return the first digits of the SHA-256 hash of a file's content; "" if there is no file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()[:12] if file.is_file() else ""


def digests(score: Path = SCORE, root: Path = sources.ROOT) -> list[str]:
    """Return hashes of the stored score and of the scored files, and the paths of source files without a score.

    The rows of `frame` change only if these do.
    """
    lines = _lines(score)
    return [digest(score), *(digest(root / of["path"]) for of in lines), *files_without_score(lines, root)]
