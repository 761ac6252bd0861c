"""A table as JSON lines, a row a line, for runs that a user keeps in a file of his own.

Beside its columns a row says of its cell the id (``cell``), how many rows it has (``of``), and its provenance.  A cell
of which a row is missing or cannot be read is not taken for measured.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from phasebench.integrators.errors import InvalidInput
from phasebench.reference.tables import write_file

from . import workers
from .cells import ALONE, POOL, UNCOMPILED, Cell
from .cluster import Cluster
from .journal import Entry, Journal
from .run import entry

#: The deadline of a run that has none.
NEVER = float("inf")
ABOUT = ("cell", "of", "content", "date", "machine", "spent")


def read(path: Path, table: str) -> dict[str, Entry]:
    """The whole cells of a file by id; raises InvalidInput where it cannot be read."""
    try:
        lines = path.read_text().splitlines()
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInput(f"{path} is no file of rows: {error}") from None
    cells: dict[str, list[dict]] = {}
    for line in lines:
        try:
            row = json.loads(line)
            cells.setdefault(row["cell"], []).append(row)
        except (ValueError, KeyError, TypeError):
            continue
    entries = {}
    for id, members in cells.items():
        about = members[0]
        if len(members) == about.get("of") and set(ABOUT) <= set(about):
            rows = [{k: v for k, v in row.items() if k not in ABOUT} for row in members]
            entries[id] = Entry(id, *(about[k] for k in ABOUT[2:]), {table: rows})
    return entries


def write(path: Path, entries: Mapping[str, Entry], table: str) -> None:
    """Write the rows of the cells, whole or not at all; raises InvalidInput where it cannot."""
    lines = [
        {"cell": e.cell, "of": len(e.rows[table]), **{k: getattr(e, k) for k in ABOUT[2:]}, **row}
        for e in entries.values()
        for row in e.rows[table]
    ]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, "".join(json.dumps(line, default=lambda x: x.item()) + "\n" for line in lines))
    except OSError as error:
        raise InvalidInput(f"{path} cannot be written: {error.strerror}") from None


def _measured(cells: Sequence[Cell], jobs: int, cluster: Cluster | None) -> Iterator[tuple]:
    """(cell, rows or None, why not, seconds) of the cells as they are finished, those that are timed at the end."""
    if not jobs and cluster is None:
        yield from workers.measured(cells, "", 0, NEVER)
        return
    for where in (POOL, UNCOMPILED, ALONE):
        lane = [cell for cell in cells if cell.where == where]
        place = workers.PINNED if where == ALONE else where
        if lane and cluster is not None:
            yield from cluster.measured(lane, place, NEVER)
        elif lane:
            yield from workers.measured(lane, place, jobs, NEVER)


def measure(
    path: Path, cells: Sequence[Cell], progress, jobs: int = 0, cluster: Cluster | None = None
) -> tuple[dict[str, Entry], list[str], int]:
    """The cells' entries, why others failed, and how many were in the file and have not changed.

    A killed run leaves its finished cells in a file beside, from which the next one goes on.  Cells are measured in
    this process, in so many others (``jobs``), or on a ``cluster``; those that are timed each
    on a core of its own, where none of the others is meanwhile.
    """
    table = cells[0].tables[0] if cells else ""
    journal = Journal(path.with_name(f"{path.name}.part"))
    known = read(path, table) | journal.entries
    todo = [c for c in cells if c.id not in known or known[c.id].content != c.content]
    failed = []
    for done, (cell, rows, error, seconds) in enumerate(_measured(todo, jobs, cluster), 1):
        progress(cell.label, done, len(todo), 0.0)
        if error is not None:
            known.pop(cell.id, None)
            failed.append(f"{cell.label}: {error}")
            continue
        known[cell.id] = entry(cell, rows, seconds, cluster.machines.get(cell.id) if cluster else None)
        journal.put(known[cell.id])
    write(path, known, table)
    journal.drop([*journal.entries])
    return {c.id: known[c.id] for c in cells if c.id in known}, failed, len(cells) - len(todo)
