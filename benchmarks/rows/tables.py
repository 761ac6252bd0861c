"""The tables on disk: a CSV file each, every row with what it depends on, when and on what machine it was measured.

The columns of provenance are ``content`` (the hash of what the row depends on), ``date``, ``machine``
(described in the JSON file beside), ``spent`` (the seconds that its cell took) and ``state``: `CURRENT`, or `STALE`
where the code has changed since and the row was not measured again.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from phasebench.reference.tables import write_file

from . import provenance
from .cells import Cell, text
from .journal import Entry

CURRENT, STALE = "current", "stale"
PROVENANCE = ("content", "date", "machine", "spent", "state")

Row = dict[str, str]


def read(folder: Path, name: str):
    """The table ``name`` as a DataFrame and what is known of its run; (None, None) where it was not measured.

    Rows that were not measured by this version of the code are left out: ``about["stale"]`` says how many.
    """
    import pandas as pd

    path = folder / "data" / f"{name}.csv"
    if not path.exists():
        return None, None
    about = json.loads((folder / "data" / f"{name}.json").read_text())
    frame = pd.read_csv(path, keep_default_na=True, low_memory=False)
    if "state" in frame:
        frame = frame[frame["state"] != STALE].reset_index(drop=True).drop(columns=list(PROVENANCE))
    return (frame, about) if len(frame) else (None, None)


class Table:
    """A table as text, so that rows that were not measured again stay as they are, to the byte."""

    def __init__(self, folder: Path, name: str):
        self.name, self.path = name, folder / f"{name}.csv"
        self.rows: list[Row] = []
        if self.path.exists():
            with self.path.open(newline="", encoding="utf-8") as stream:
                self.rows = list(csv.DictReader(stream))
        about = self.path.with_suffix(".json")
        self.about = json.loads(about.read_text()) if about.exists() else {}
        self._found: dict[tuple, dict[tuple, list[Row]]] = {}

    def of(self, cell: Cell) -> list[Row]:
        """The rows of a cell."""
        columns = tuple(cell.key)
        if columns not in self._found:
            index: dict[tuple, list[Row]] = {}
            for row in self.rows:
                index.setdefault(tuple(row.get(c, "") for c in columns), []).append(row)
            self._found[columns] = index
        return self._found[columns].get(tuple(text(v) for v in cell.key.values()), [])

    def write(self, cells: Sequence[Cell], entries: Mapping[str, Entry], quick: bool) -> None:
        """Write the rows of ``cells``: those of ``entries``, and for the others the rows that were there."""
        rows: list[Row] = []
        for cell in cells:
            entry = entries.get(cell.id)
            rows += fresh_rows(entry, self.name) if entry else [_judged(r, cell) for r in self.of(cell)]
        about = provenance.summary() | {"quick": quick} if any(c.id in entries for c in cells) else self.about
        self.replace(rows, about)

    def replace(self, rows: Sequence[Row], about: Mapping[str, object]) -> None:
        """Write rows, and ``about`` with the machines that they are of."""
        columns = {c: None for row in rows for c in row}
        first = [c for c in (self.rows[0] if self.rows else ()) if c in columns and c not in PROVENANCE]
        names = [*dict.fromkeys([*first, *(c for c in columns if c not in PROVENANCE)]), *PROVENANCE]
        out = io.StringIO()
        writer = csv.DictWriter(out, names, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        machines = {m for r in rows if (m := r.get("machine"))}
        known = self.about.get("machines", {}) | {provenance.machine(): provenance.summary()}
        about = {
            **about,
            "stale": sum(r.get("state") == STALE for r in rows),
            "machines": {m: known[m] for m in sorted(machines) if m in known},
        }
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_file(self.path, out.getvalue())
        write_file(self.path.with_suffix(".json"), json.dumps(about, indent=1) + "\n")


def fresh_rows(entry: Entry, table: str) -> list[Row]:
    """The rows of a finished cell as text, with their provenance."""
    about = {"content": entry.content, "date": entry.date, "machine": entry.machine}
    about |= {"spent": text(round(entry.spent, 3)), "state": CURRENT}
    return [{k: text(v) for k, v in row.items()} | about for row in entry.rows.get(table, [])]


def take(folder: Path, name: str, entries: Mapping[str, Entry]) -> None:
    """Write the cells of a user's own run as the table ``name``, in place of the one that was there."""
    rows = [row for e in entries.values() for row in fresh_rows(e, name)]
    quick = any(row.get("tier") == "quick" for row in rows)
    Table(folder, name).replace(rows, provenance.summary() | {"quick": quick})


def _judged(row: Row, cell: Cell) -> Row:
    return row | {"state": CURRENT if row.get("content") == cell.content else STALE}


def write(folder: Path, cells: Iterable[Cell], entries: Mapping[str, Entry], quick: bool = False) -> None:
    """Write every table of the cells into ``folder``."""
    by_table: dict[str, list[Cell]] = {}
    for cell in cells:
        for table in cell.tables:
            by_table.setdefault(table, []).append(cell)
    for name, members in by_table.items():
        table = Table(folder, name)
        if table.rows or any(c.id in entries for c in members):
            table.write(members, entries, quick)
