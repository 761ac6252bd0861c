"""The score: of each file how many mutants were tried and what came of them, kept in ``score.csv``.

The mutants of a file are tried in an order by no rule; of `tried` the first so many were.  A line whose hash is not the
file's is of the file as it was before.
"""

from __future__ import annotations

import csv
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from phasebench.benchmarks.experiments.catalogue.mutation import AND, COUNTS, digest

KEPT = Path(__file__).with_name("score.csv")


@dataclass(frozen=True)
class Score:
    """Of a file.

    Attributes
    ----------
    path : from the root of the project
    hash : of its content
    mutants, tried : how many there are, how many were tried
    killed, equivalent : how many tests noticed, how many are argued to change nothing
    survived : what no test noticed
    """

    path: str
    hash: str
    mutants: int
    tried: int
    killed: int
    equivalent: int
    survived: tuple[str, ...] = ()


def read(kept: Path = KEPT) -> dict[str, Score]:
    """The scores by path."""
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


def unargued(scores: dict[str, Score], root: Path) -> list[str]:
    """The survivors of files that are as they were when they were judged."""
    return [mutant for s in scores.values() if same(s, root) for mutant in s.survived]


def table(scores: dict[str, Score], root: Path) -> list[tuple]:
    """(file, mutants, tried, killed, equivalent, survived, as judged or changed since) of each file, and of all."""
    lines = [
        (
            s.path,
            s.mutants,
            s.tried,
            s.killed,
            s.equivalent,
            len(s.survived),
            "as judged" if same(s, root) else "changed",
        )
        for _, s in sorted(scores.items())
    ]
    return [*lines, ("all", *(sum(line[k] for line in lines) for k in range(1, 6)), "")]


def same(of: Score, root: Path) -> bool:
    """Whether a file is as it was when it was judged."""
    return digest(root / of.path) == of.hash


def write(scores: dict[str, Score], kept: Path = KEPT) -> None:
    """Keep scores, by path."""
    with kept.open("w", newline="") as lines:
        writer = csv.DictWriter(lines, [f.name for f in fields(Score)], lineterminator="\n")
        writer.writeheader()
        for _, score in sorted(scores.items()):
            writer.writerow(asdict(score) | {"survived": AND.join(score.survived)})
