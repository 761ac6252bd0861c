"""The mutation score, stored in ``score.csv``: for each file the number of mutants tried, killed and surviving.

The mutants of a file are tried in a pseudo-random order, the first `tried` of them. A line whose hash differs from the
file's belongs to an earlier version of the file.
"""

from __future__ import annotations

import csv
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from phasebench.benchmarks.experiments.catalogue.mutation import AND, COUNTS, digest

KEPT = Path(__file__).with_name("score.csv")


@dataclass(frozen=True)
class Score:
    """The mutation score of one file.

    Attributes
    ----------
    path : the file, from the root of the project
    hash : of its content
    mutants, tried : number of mutants, and of those tried
    killed : number noticed by a test
    survived : ids of those that no test noticed
    """

    path: str
    hash: str
    mutants: int
    tried: int
    killed: int
    survived: tuple[str, ...] = ()


def read(kept: Path = KEPT) -> dict[str, Score]:
    """Read the scores: {path: Score}."""
    if not kept.exists():
        return {}
    with kept.open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    return {
        row["path"]: Score(
            **{"path": row["path"], "hash": row["hash"]} | {n: int(row[n]) for n in COUNTS},
            survived=tuple(filter(None, row["survived"].split(AND))),
        )
        for row in rows
    }


def table(scores: dict[str, Score], root: Path) -> list[tuple]:
    """Rows (file, mutants, tried, killed, survived, "as judged" or "changed"), the last one of all files."""
    lines = [
        (
            s.path,
            s.mutants,
            s.tried,
            s.killed,
            s.tried - s.killed,
            "as judged" if same(s, root) else "changed",
        )
        for _, s in sorted(scores.items())
    ]
    return [*lines, ("all", *(sum(line[k] for line in lines) for k in range(1, 5)), "")]


def same(of: Score, root: Path) -> bool:
    """Whether a file has not changed since its mutants were judged."""
    return digest(root / of.path) == of.hash


def write(scores: dict[str, Score], kept: Path = KEPT) -> None:
    """Write the scores, sorted by path."""
    with kept.open("w", newline="") as lines:
        writer = csv.DictWriter(lines, [f.name for f in fields(Score)], lineterminator="\n")
        writer.writeheader()
        for _, score in sorted(scores.items()):
            writer.writerow(asdict(score) | {"survived": AND.join(score.survived)})
