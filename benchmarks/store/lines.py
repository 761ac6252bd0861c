"""Stores a table as JSON lines, one row a line: the rows of a user's own run (``phasebench run``).

Besides its columns a row holds the id of its cell (``cell``), the number of the cell's rows (``of``), and its
provenance.  A cell counts as measured only if all of its rows can be read.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from phasebench.integrators.errors import InvalidInput
from phasebench.reference.files import write_file

from . import schema, workers
from .cells import ALONE, POOL, UNCOMPILED, Cell
from .cluster import Cluster
from .journal import Entry, Journal, lock
from .json_text import json_text
from .run import entry

#: Deadline of a run without time limit.
NEVER = float("inf")
ABOUT = ("cell", "of", "content", "date", "machine", "spent")


def read(path: Path, table: str) -> dict[str, Entry]:
    """Read the complete cells of a JSON lines file, by id; raises InvalidInput if unreadable."""
    cells: dict[str, list[dict]] = {}
    for line in _lines(path):
        try:
            row = json.loads(line)
            cells.setdefault(row["cell"], []).append(row)
        except (ValueError, KeyError, TypeError):
            continue
        schema.check(row, path)
        row.pop(schema.FIELD, None)
    entries = {}
    for id, members in cells.items():
        about = members[0]
        if len(members) == about.get("of") and set(ABOUT) <= set(about):
            rows = [{k: v for k, v in row.items() if k not in ABOUT} for row in members]
            entries[id] = Entry(id, *(about[k] for k in ABOUT[2:]), {table: rows})
    return entries


def of_scenes(path: Path) -> bool | None:
    """True if a JSON lines file has rows of scenes, False for rows of one problem, by its first row; or None."""
    for line in _lines(path):
        try:
            return "cell" in json.loads(line)
        except (ValueError, TypeError):
            continue
    return None


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInput(f"{path} is no file of rows: {error}") from None


def write(path: Path, entries: Mapping[str, Entry], table: str) -> None:
    """Write the rows that the cells have in one table, replacing the file at once; raises InvalidInput."""
    lines = [
        {
            schema.FIELD: schema.VERSION,
            "cell": e.cell,
            "of": len(e.rows[table]),
            **{k: getattr(e, k) for k in ABOUT[2:]},
            **row,
        }
        for e in entries.values()
        for row in e.rows[table]
    ]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, "".join(json_text(line) + "\n" for line in lines))
    except OSError as error:
        raise InvalidInput(f"{path} cannot be written: {error.strerror}") from None


def _answers(cells: Sequence[Cell], jobs: int, cluster: Cluster | None) -> Iterator[tuple[Cell, workers.Answer]]:
    """Measure cells; yield each with its `Answer`.  In parallel runs the timed cells come last."""
    if not jobs and cluster is None:
        yield from workers.measure(cells, POOL, NEVER)
        return
    for where in (POOL, UNCOMPILED, ALONE):
        lane = [cell for cell in cells if cell.where == where]
        if lane:
            yield from workers.measure(lane, workers.PINNED if where == ALONE else where, NEVER, jobs, cluster)


def measure(
    path: Path,
    cells: Sequence[Cell],
    progress: Callable[[str, int, int, float], None],
    jobs: int = 0,
    cluster: Cluster | None = None,
) -> tuple[dict[str, Entry], list[str], int]:
    """Measure the cells that are new or changed, and write all their rows to the file ``path``.

    Finished cells of a killed run stay in a file beside ``path``, from which the next run continues.  Cells are
    measured in this process, in ``jobs`` processes or on a ``cluster``.  Returns (entry by cell id, texts of what
    failed, the number of cells that were not measured again).
    """
    with lock(path.parent, f".{path.name}.lock"):
        return _measure(path, cells, progress, jobs, cluster)


def _measure(
    path: Path,
    cells: Sequence[Cell],
    progress: Callable[[str, int, int, float], None],
    jobs: int,
    cluster: Cluster | None,
) -> tuple[dict[str, Entry], list[str], int]:
    table = cells[0].tables[0] if cells else ""
    journal = Journal(path.with_name(f"{path.name}.part"))
    known = read(path, table) | journal.entries
    todo = [c for c in cells if c.id not in known or known[c.id].content != c.content]
    failed = []
    for done, (cell, answer) in enumerate(_answers(todo, jobs, cluster), 1):
        progress(cell.label, done, len(todo), 0.0)
        if answer.error is not None:
            known.pop(cell.id, None)
            failed.append(f"{cell.label}: {answer.error}")
            continue
        known[cell.id] = entry(cell, answer)
        journal.put(known[cell.id])
    write(path, known, table)
    journal.drop([*journal.entries])
    return {c.id: known[c.id] for c in cells if c.id in known}, failed, len(cells) - len(todo)
