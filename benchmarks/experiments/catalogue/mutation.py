"""What the suite notices of changes to itself: the score that ``python tests/mutation`` keeps of each file.

A mutant is a file with one number, sign, comparison, condition or return changed.  It is killed where a test fails; it
survives where none does, unless it is argued to change nothing.
"""

from __future__ import annotations

import csv
import hashlib
from pathlib import Path

from phasebench.benchmarks.rows import sources

SCORE = sources.ROOT / "tests" / "mutation" / "score.csv"
COUNTS = ("mutants", "tried", "killed", "equivalent")
#: Between the survivors of a file.
AND = " && "


def frame(score: Path = SCORE, root: Path = sources.ROOT) -> list[dict[str, object]]:
    """A row for each file that was judged."""
    with score.open(newline="") as lines:
        return [_row(of, root) for of in csv.DictReader(lines)]


def _row(of: dict[str, str], root: Path) -> dict[str, object]:
    counts = {name: int(of[name]) for name in COUNTS}
    survived = len(of["survived"].split(AND)) if of["survived"] else 0
    return {"file": of["path"]} | counts | {"survived": survived, "as judged": digest(root / of["path"]) == of["hash"]}


def digest(file: Path) -> str:
    """What tells a file's content from another's; empty for none."""
    return hashlib.sha256(file.read_bytes()).hexdigest()[:12] if file.is_file() else ""


def digests(score: Path = SCORE, root: Path = sources.ROOT) -> list[str]:
    """What the rows depend on."""
    with score.open(newline="") as lines:
        return [digest(score), *(digest(root / of["path"]) for of in csv.DictReader(lines))]
