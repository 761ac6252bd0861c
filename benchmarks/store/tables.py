"""The tables of rows on disk: one CSV file each; every row has its provenance.

The columns of provenance are ``content`` (the hash of what the row depends on), ``date``, ``machine`` (described in the
JSON file beside the table), ``spent`` (the seconds that its cell, the measurement that made the row, took), ``digest``
(of all rows of its cell in all tables; if a row was edited, lost or doubled, the cell counts as not measured) and
``state``: `CURRENT`, or `STALE` if the code changed after the measurement.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from phasebench.integrators.errors import InvalidInput
from phasebench.reference.files import write_file

from . import provenance, schema
from .cells import Cell, text
from .journal import Entry

if TYPE_CHECKING:
    import pandas as pd

CURRENT, STALE = "current", "stale"
PROVENANCE = ("content", "date", "machine", "spent", "digest", "state")

Row = dict[str, str]


def read(folder: Path, name: str, stale: bool = True) -> tuple[pd.DataFrame, dict] | tuple[None, None]:
    """Read a table of a report folder; return (DataFrame, metadata from its JSON file), or (None, None) if absent.

    Rows measured by an earlier version of the code are included unless ``stale`` is False; their number is the entry
    "stale" of the metadata.  Raises InvalidInput if the files cannot be read.
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
    if "state" in frame:
        about["stale"] = int((frame["state"] == STALE).sum())
        frame = frame if stale else frame[frame["state"] != STALE].reset_index(drop=True)
        frame = frame.drop(columns=list(PROVENANCE), errors="ignore")
    return (frame, about) if len(frame) else (None, None)


def as_csv(rows: Sequence[Mapping[str, object]], columns: Sequence[str]) -> str:
    """Rows as CSV text: doubles by their shortest digits, empty cells for None and NaN."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([text(row.get(c)) for c in columns] for row in rows)
    return out.getvalue()


class Table:
    """A stored table, with cells as text, so that rows that are not measured again stay the same to the byte.

    Attributes
    ----------
    name, path : the name of the table, and its CSV file
    rows : its rows, dicts of texts by column
    about : the metadata in the JSON file beside it; {} if there is none
    """

    def __init__(self, folder: Path, name: str) -> None:
        self.name, self.path = name, folder / f"{name}.csv"
        self.rows: list[Row] = []
        if self.path.exists():
            with self.path.open(newline="", encoding="utf-8", errors="replace") as stream:
                self.rows = [{k: v or "" for k, v in row.items() if k} for row in csv.DictReader(stream)]
        try:
            self.about = json.loads(self.path.with_suffix(".json").read_text(encoding="utf-8"))
        except (OSError, ValueError):  # missing or truncated: no metadata
            self.about = {}
        schema.check(self.about, self.path)
        self._found: dict[tuple, dict[tuple, list[Row]]] = {}

    def of(self, cell: Cell) -> list[Row]:
        """The stored rows of a cell (one measurement) in this table."""
        columns = tuple(cell.key)
        if columns not in self._found:
            index: dict[tuple, list[Row]] = {}
            for row in self.rows:
                index.setdefault(tuple(row.get(c, "") for c in columns), []).append(row)
            self._found[columns] = index
        return self._found[columns].get(tuple(text(v) for v in cell.key.values()), [])

    def write(self, cells: Sequence[Cell], entries: Mapping[str, Entry], fresh: set[str], quick: bool) -> None:
        """Write the table's rows of ``cells``: the new ones in ``entries``, and the stored ones of the other cells.

        ``fresh`` has the ids of cells whose stored rows belong to this version of the code.
        """
        rows: list[Row] = []
        for cell in cells:
            entry, state = entries.get(cell.id), CURRENT if cell.id in fresh else STALE
            rows += fresh_rows(entry, self.name) if entry else [r | {"state": state} for r in self.of(cell)]
        about = provenance.summary() | {"quick": quick} if any(c.id in entries for c in cells) else self.about
        self.replace(rows, about)

    def replace(self, rows: Sequence[Row], about: Mapping[str, object]) -> None:
        """Overwrite the table with ``rows``, and the JSON file beside it with the metadata ``about``.

        Descriptions of the machines on which the rows were measured are added to the metadata.
        """
        columns = {c: None for row in rows for c in row}
        first = [c for c in (self.rows[0] if self.rows else ()) if c in columns and c not in PROVENANCE]
        names = [*dict.fromkeys([*first, *(c for c in columns if c not in PROVENANCE)]), *PROVENANCE]
        machines = {m for r in rows if (m := r.get("machine"))}
        known = self.about.get("machines", {}) | {provenance.machine(): provenance.summary()}
        about = {
            **about,
            schema.FIELD: schema.VERSION,
            "stale": sum(r.get("state") == STALE for r in rows),
            "machines": {m: known[m] for m in sorted(machines) if m in known},
        }
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_file(self.path, as_csv(rows, names))
        write_file(self.path.with_suffix(".json"), json.dumps(about, indent=1) + "\n")


def fresh_rows(entry: Entry, table: str) -> list[Row]:
    """The rows that a finished cell (one measurement) adds to one table, as text, with their columns of provenance."""
    about = {"content": entry.content, "date": entry.date, "machine": entry.machine}
    rows = {name: [{k: text(v) for k, v in row.items()} for row in members] for name, members in entry.rows.items()}
    about |= {"spent": text(round(entry.spent, 3)), "digest": digest(rows), "state": CURRENT}
    return [row | about for row in rows.get(table, [])]


def digest(rows: Mapping[str, Sequence[Row]]) -> str:
    """Digest of the rows of one measurement (table -> rows), without columns of provenance and empty table cells."""
    plain = {
        name: [sorted((k, v) for k, v in row.items() if v and k not in PROVENANCE) for row in members]
        for name, members in rows.items()
        if members
    }
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()[:12]


def version(cell: Cell, stored: Mapping[str, Table]) -> str | None:
    """The hash of the code and data with which the stored rows of a cell (one measurement) were measured.

    None if rows are missing, or were edited or lost since.  ``stored`` are the tables by name.
    """
    found = {name: stored[name].of(cell) for name in cell.tables}
    said = {(row.get("content"), row.get("digest")) for rows in found.values() for row in rows}
    if len(said) != 1:
        return None
    ((content, told),) = said
    return content if told == digest(found) else None


def take(folder: Path, name: str, entries: Mapping[str, Entry]) -> None:
    """Overwrite the table ``name`` in ``folder`` with the rows of finished cells (``entries``) of a user's run."""
    rows = [row for e in entries.values() for row in fresh_rows(e, name)]
    quick = any(row.get("tier") == "quick" for row in rows)
    Table(folder, name).replace(rows, provenance.summary() | {"quick": quick})


def write(folder: Path, cells: Sequence[Cell], entries: Mapping[str, Entry], quick: bool = False) -> None:
    """Write every table of the cells into ``folder``; cells without an entry keep their stored rows."""
    by_table: dict[str, list[Cell]] = {}
    for cell in cells:
        for table in cell.tables:
            by_table.setdefault(table, []).append(cell)
    stored = {name: Table(folder, name) for name in by_table}
    fresh = {c.id for c in cells if c.id not in entries and version(c, stored) == c.content}
    for name, members in by_table.items():
        if stored[name].rows or any(c.id in entries for c in members):
            stored[name].write(members, entries, fresh, quick)
