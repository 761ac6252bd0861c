"""The tables on disk: a CSV file each, every row with what it depends on, when and on what machine it was measured.

The columns of provenance are ``content`` (the hash of what the row depends on), ``date``, ``machine``
(described in the JSON file beside), ``spent`` (the seconds that its cell took), ``digest`` (of all rows of its cell, in
every table: one that was changed, lost or doubled since makes them count as not measured) and ``state``: `CURRENT`, or
`STALE` where the code has changed since and the row was not measured again.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from phasebench.integrators.errors import InvalidInput
from phasebench.reference.tables import write_file

from . import provenance
from .cells import Cell, text
from .journal import Entry

CURRENT, STALE = "current", "stale"
PROVENANCE = ("content", "date", "machine", "spent", "digest", "state")

Row = dict[str, str]


def read(folder: Path, name: str, stale: bool = True):
    """The table ``name`` as a DataFrame and what is known of its run; (None, None) where it was not measured.

    Rows that were measured by an earlier version of the code are among them unless ``stale`` is False:
    ``about["stale"]`` says how many there are.
    """
    import pandas as pd

    path = folder / "data" / f"{name}.csv"
    if not path.exists():
        return None, None
    try:
        about = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        frame = pd.read_csv(path, keep_default_na=True, low_memory=False)
    except (OSError, ValueError) as error:
        raise InvalidInput(f"{path} cannot be read ({error}); `pytest benchmarks` measures it again") from None
    if "state" in frame:
        about["stale"] = int((frame["state"] == STALE).sum())
        frame = frame if stale else frame[frame["state"] != STALE].reset_index(drop=True)
        frame = frame.drop(columns=list(PROVENANCE), errors="ignore")
    return (frame, about) if len(frame) else (None, None)


class Table:
    """A table as text, so that rows that were not measured again stay as they are, to the byte."""

    def __init__(self, folder: Path, name: str):
        self.name, self.path = name, folder / f"{name}.csv"
        self.rows: list[Row] = []
        if self.path.exists():
            with self.path.open(newline="", encoding="utf-8", errors="replace") as stream:
                self.rows = [{k: v or "" for k, v in row.items() if k} for row in csv.DictReader(stream)]
        try:
            self.about = json.loads(self.path.with_suffix(".json").read_text(encoding="utf-8"))
        except (OSError, ValueError):  # it is not there, or was cut: nothing is known
            self.about = {}
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

    def write(self, cells: Sequence[Cell], entries: Mapping[str, Entry], fresh: set[str], quick: bool) -> None:
        """Write the rows of ``cells``: those of ``entries``, and for the others the rows that were there.

        ``fresh`` has the ids of those of the others whose rows are of this version.
        """
        rows: list[Row] = []
        for cell in cells:
            entry, state = entries.get(cell.id), CURRENT if cell.id in fresh else STALE
            rows += fresh_rows(entry, self.name) if entry else [r | {"state": state} for r in self.of(cell)]
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
    rows = {name: [{k: text(v) for k, v in row.items()} for row in members] for name, members in entry.rows.items()}
    about |= {"spent": text(round(entry.spent, 3)), "digest": digest(rows), "state": CURRENT}
    return [row | about for row in rows.get(table, [])]


def digest(rows: Mapping[str, Sequence[Row]]) -> str:
    """Of the rows of a cell, by table, without their provenance and what is missing."""
    plain = {
        name: [sorted((k, v) for k, v in row.items() if v and k not in PROVENANCE) for row in members]
        for name, members in rows.items()
        if members
    }
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()[:12]


def version(cell: Cell, stored: Mapping[str, Table]) -> str | None:
    """The hash of what the stored rows of a cell depend on; None where they are not all those that were measured."""
    found = {name: stored[name].of(cell) for name in cell.tables}
    said = {(row.get("content"), row.get("digest")) for rows in found.values() for row in rows}
    if len(said) != 1:
        return None
    ((content, told),) = said
    return content if told == digest(found) else None


def write_lines(path: Path, lines: Sequence[Mapping[str, object]]) -> None:
    """Write lines without provenance, of the same columns, as a CSV file: whole or not at all."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(lines[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    write_file(path, text.getvalue())


def take(folder: Path, name: str, entries: Mapping[str, Entry]) -> None:
    """Write the cells of a user's own run as the table ``name``, in place of the one that was there."""
    rows = [row for e in entries.values() for row in fresh_rows(e, name)]
    quick = any(row.get("tier") == "quick" for row in rows)
    Table(folder, name).replace(rows, provenance.summary() | {"quick": quick})


def write(folder: Path, cells: Sequence[Cell], entries: Mapping[str, Entry], quick: bool = False) -> None:
    """Write every table of the cells into ``folder``."""
    by_table: dict[str, list[Cell]] = {}
    for cell in cells:
        for table in cell.tables:
            by_table.setdefault(table, []).append(cell)
    stored = {name: Table(folder, name) for name in by_table}
    fresh = {c.id for c in cells if c.id not in entries and version(c, stored) == c.content}
    for name, members in by_table.items():
        if stored[name].rows or any(c.id in entries for c in members):
            stored[name].write(members, entries, fresh, quick)
