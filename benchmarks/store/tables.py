"""The tables of rows on disk: a CSV file each, and beside it what is known of the measurements that made its rows.

``NAME.csv`` has the rows.  ``NAME.keys`` has a line for each cell (one measurement): the values that identify its rows,
how many they are, and the columns `PROVENANCE`: ``content`` (the hash of what the rows depend on), ``digest`` (of the
rows; if one was edited, lost or doubled, the cell counts as not measured), ``run`` (which run measured them), ``spent``
(its seconds) and ``state``: empty, or `STALE` if the code has changed since.  ``NAME.json`` lists the runs, each with
date, commit and machine, and describes the machines.

A run takes no row away: what it does not measure stays, also the rows of measurements that the suite no longer makes,
until they are removed on request.  Rows that agree with the stored ones (`agree`) are not written.
"""

from __future__ import annotations

import csv
import hashlib
import io
import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasebench.integrators.errors import InvalidInput
from phasebench.reference.files import write_file

from . import provenance, schema
from .cells import Cell, text
from .digits import stored_text
from .journal import Entry

if TYPE_CHECKING:
    import pandas as pd

CURRENT, STALE = "", "stale"
PROVENANCE = ("content", "run", "spent", "digest", "state")
#: Stands for the date, commit and machine of rows of which they are not known.
NO_RUN = "- - -"
#: Stands for the commit of rows that were measured outside of the repository.
UNKNOWN = "-"
#: The column of a keys file with the number of rows.
COUNT = "rows"
KEYS = ".keys"

Row = dict[str, str]


def read(folder: Path, name: str, stale: bool = True) -> tuple[pd.DataFrame, dict] | tuple[None, None]:
    """A table of a report folder and the metadata of its JSON file, or (None, None) if absent; raises InvalidInput.

    Rows measured by an earlier version of the code are included unless ``stale`` is False.
    """
    import pandas as pd

    path = folder / "data" / f"{name}.csv"
    if not path.exists():
        return None, None
    try:
        about = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        schema.check(about, path)
        frame = pd.read_csv(path, keep_default_na=True, low_memory=False)
    except InvalidInput:
        raise
    except (OSError, ValueError) as error:
        raise InvalidInput(f"{path} cannot be read ({error}); `pytest benchmarks` measures it again") from None
    if about.get("stale") and not stale:
        table = Table(folder / "data", name)
        old = {id(row) for key, known in table.keys.items() if known["state"] == STALE for row in table.rows_of(key)}
        frame = frame[[id(row) not in old for row in table.rows]].reset_index(drop=True)
    return (frame, about) if len(frame) else (None, None)


def read_lines(path: Path) -> list[Row]:
    """The lines of a CSV file, dicts of texts by column; [] if there is none."""
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8", errors="replace") as stream:
        return [{k: v or "" for k, v in row.items() if k} for row in csv.DictReader(stream)]


def as_csv(rows: Sequence[Mapping[str, object]], columns: Sequence[str]) -> str:
    """Rows as CSV text: doubles by their shortest digits, empty cells for None and NaN."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([text(row.get(c)) for c in columns] for row in rows)
    return out.getvalue()


#: What identifies the rows of a cell in a table: pairs (column, text), sorted.
Key = tuple[tuple[str, str], ...]


def key_of(cell: Cell) -> Key:
    """The key of a cell's rows in each of its tables, all of whose cells have the same columns."""
    return tuple(sorted((k, text(v)) for k, v in cell.key.items()))


class Table:
    """A stored table, with cells as text, so that rows that are not measured again stay the same to the byte.

    ``keys`` maps the key of a measurement's rows to its line of the keys file.
    """

    def __init__(self, folder: Path, name: str) -> None:
        self.name, self.path = name, folder / f"{name}.csv"
        try:
            self.about = json.loads(self.path.with_suffix(".json").read_text(encoding="utf-8"))
        except (OSError, ValueError):  # missing or truncated: no metadata
            self.about = {}
        schema.check(self.about, self.path)
        runs = self.about.get("runs", {})
        self.rows = read_lines(self.path)
        self.keys: dict[Key, Row] = {}
        for line in read_lines(self.path.with_suffix(KEYS)):
            known = {k: line.get(k, "") for k in (*PROVENANCE, COUNT)} | {"run": runs.get(line.get("run"), NO_RUN)}
            self.keys[tuple(sorted((k, v) for k, v in line.items() if k not in known))] = known
        self._found: dict[tuple, dict[tuple, list[Row]]] = {}

    def rows_of(self, key: Key) -> list[Row]:
        """The stored rows with this key."""
        columns = tuple(k for k, _ in key)
        if columns not in self._found:
            index: dict[tuple, list[Row]] = {}
            for row in self.rows:
                index.setdefault(tuple(row.get(c, "") for c in columns), []).append(row)
            self._found[columns] = index
        return self._found[columns].get(tuple(v for _, v in key), [])

    def of(self, cell: Cell) -> list[Row]:
        """The stored rows of a cell (one measurement) in this table."""
        return self.rows_of(key_of(cell))

    def intact(self, cell: Cell) -> Row | None:
        """What is known of a cell's stored rows, as `keys` has it; None if rows are missing, were edited or lost."""
        known = self.keys.get(key_of(cell))
        return known if known is not None and known["digest"] == digest(self.of(cell)) else None

    def replace(self, rows: Sequence[Row], keys: Mapping[Key, Row], about: Mapping[str, object]) -> None:
        """Overwrite the table and the JSON file beside it; files that would be the same are left alone."""
        known = self.about.get("machines", {}) | {provenance.machine(): provenance.summary()}
        runs = _numbered({line["run"] for line in keys.values()}, self.about.get("runs", {}))
        machines = sorted({run.split()[-1] for run in runs} & {*known})
        about = {
            **about,
            schema.FIELD: schema.VERSION,
            "stale": sum(int(line[COUNT]) for line in keys.values() if line["state"] == STALE),
            "runs": {number: run for run, number in runs.items()},
            "machines": {m: known[m] for m in machines},
        }
        first = [c for c in (self.rows[0] if self.rows else ()) if any(c in row for row in rows)]
        columns = list(dict.fromkeys([*first, *(c for row in rows for c in row)]))
        names = list(dict.fromkeys(c for key in keys for c, _ in key))
        lines = [{**dict(key), **line, "run": runs[line["run"]]} for key, line in keys.items()]
        self.path.parent.mkdir(parents=True, exist_ok=True)
        for suffix, content in (
            (".csv", as_csv(rows, columns)),
            (KEYS, as_csv(lines, [*names, COUNT, *PROVENANCE])),
            (".json", json.dumps(about, indent=1) + "\n"),
        ):
            path = self.path.with_suffix(suffix)
            if not path.exists() or path.read_bytes() != content.encode():
                write_file(path, content)


def _numbered(runs: set[str], before: Mapping[str, str]) -> dict[str, str]:
    """Run -> its number; those that had one ``before`` (number -> run) keep it, so that few lines change."""
    out = {run: number for number, run in before.items() if run in runs}
    free = (str(k) for k in itertools.count() if str(k) not in before)
    return out | {run: next(free) for run in sorted(runs - {*out})}


@dataclass
class Written:
    """What `write` did: ids of the cells whose rows came out otherwise, and the rows of no cell, by table."""

    changed: set[str] = field(default_factory=set)
    orphans: dict[str, int] = field(default_factory=dict)


def known_of(entry: Entry, rows: Sequence[Row]) -> Row:
    """The line of a keys file for the ``rows`` that a finished cell adds to a table."""
    return {
        "content": entry.content,
        "run": " ".join([entry.date, entry.commit or UNKNOWN, entry.machine]),
        "spent": text(round(entry.spent, 3)),
        "digest": digest(rows),
        "state": CURRENT,
        COUNT: str(len(rows)),
    }


def fresh_rows(entry: Entry, table: str, cell: Cell | None = None) -> list[Row]:
    """The rows that a finished cell adds to one table, as text, with as many digits as mean something (`digits`)."""
    exact = frozenset(cell.key) if cell is not None else frozenset()
    return [{k: stored_text(table, k, v, exact) for k, v in row.items()} for row in entry.rows.get(table, [])]


def digest(rows: Sequence[Row]) -> str:
    """Digest of the rows of one measurement in a table, without empty table cells."""
    plain = [sorted((k, v) for k, v in row.items() if v) for row in rows]
    return hashlib.sha256(json.dumps(plain).encode()).hexdigest()[:10]


def version(cell: Cell, stored: Mapping[str, Table]) -> str | None:
    """The hash of what the stored rows of a cell were measured with; None if some are missing, edited or lost."""
    known = [stored[name].intact(cell) for name in cell.tables]
    contents = {line["content"] for line in known if line is not None}
    return contents.pop() if None not in known and len(contents) == 1 else None


def take(folder: Path, name: str, entries: Mapping[str, Entry]) -> None:
    """Overwrite the table ``name`` in ``folder`` with the rows of finished cells (``entries``) of a user's run."""
    rows, keys = [], {}
    for entry in entries.values():
        own = fresh_rows(entry, name)
        rows += own
        keys["cell", entry.cell] = known_of(entry, own)
    keys = {(key,): line for key, line in keys.items()}
    quick = any(row.get("tier") == "quick" for row in rows)
    Table(folder, name).replace(rows, keys, provenance.summary() | {"quick": quick})


def write(
    folder: Path,
    cells: Sequence[Cell],
    entries: Mapping[str, Entry],
    stored: Mapping[str, Table],
    agreed: set[str] = frozenset(),
    quick: bool = False,
    prune: bool = False,
) -> Written:
    """Write every table of the cells into ``folder``; cells without an entry keep their stored rows.

    ``agreed`` are ids of cells whose new rows agree with the stored ones, which stay, with the hash of the new code;
    with ``prune`` stored rows that belong to none of the cells are removed.
    """
    out = Written({id for id in entries if id not in agreed})
    by_table: dict[str, list[Cell]] = {}
    for cell in cells:
        for table in cell.tables:
            by_table.setdefault(table, []).append(cell)
    for name, members in by_table.items():
        table = stored[name]
        if not table.rows and not any(c.id in entries for c in members):
            continue
        groups = {key: (table.rows_of(key), known) for key, known in table.keys.items()}
        own = {key_of(cell): cell for cell in members}
        for key in own:  # of rows whose line in the keys file was lost, nothing is known
            if key not in groups and (rows := table.rows_of(key)):
                groups[key] = rows, dict.fromkeys(PROVENANCE, "") | {"run": NO_RUN, COUNT: str(len(rows))}
        for key, cell in own.items():
            if cell.id in out.changed:
                rows = fresh_rows(entries[cell.id], name, cell)
                groups[key] = rows, known_of(entries[cell.id], rows)
            elif key in groups:
                rows, known = groups[key]
                again = cell.id in agreed and cell.outdated(known["content"])
                content = entries[cell.id].content if again else known["content"]
                state = STALE if cell.outdated(content) or table.intact(cell) is None else CURRENT
                groups[key] = rows, known | {"content": content, "state": state}
        orphans = [key for key in groups if key not in own]
        if orphans and not prune:
            out.orphans[name] = sum(len(groups[key][0]) for key in orphans)
        order = list(groups) if orphans and not prune else [key for key in own if key in groups]
        changed = any(c.id in out.changed or (c.id in entries and table.about.get("quick") != quick) for c in members)
        table.replace(
            [row for key in order for row in groups[key][0]],
            {key: groups[key][1] for key in order},
            provenance.summary() | {"quick": quick} if changed else table.about,
        )
    return out


def origins(folder: Path, name: str) -> list[tuple[Any, ...]]:
    """(Date, commit, machine, number of rows) of each measurement of a table in a report folder."""
    return [(*line["run"].split(), int(line[COUNT])) for line in Table(folder / "data", name).keys.values()]
