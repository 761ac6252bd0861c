"""Reads the columns of a stored series: CSV, columns by blanks, logs of OpenMM, LAMMPS and ASE, GROMACS xvg."""

from __future__ import annotations

import csv
import re
from pathlib import Path

from phasebench.integrators.errors import InvalidInput

Columns = dict[str, list[str]]
#: A label of an xvg file: of an axis, or of a set of data.
LABEL = re.compile(r'@\s+(?:(?P<axis>[xy])axis\s+label|s(?P<set>\d+)\s+legend)\s+"(?P<text>.*)"')
UNIT = re.compile(r"\s*[(\[](?P<unit>[^)\]]*)[)\]]\s*$")


def read(path: Path) -> Columns:
    """The columns of a file as text, by name, or number where they have none; raises InvalidInput."""
    try:
        lines = [line for line in path.read_text(encoding="utf-8-sig").splitlines() if line.strip()]
        if not any(not line.startswith(("#", "@")) for line in lines):
            raise InvalidInput(f"{path} is empty: its first line must name the columns")
        if any(line.startswith("@") for line in lines):
            return _xvg(path, lines)
        first = next(line for line in lines if not line.startswith("#"))
        return _csv(path, lines) if "," in first else _blanks(path, lines)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InvalidInput(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from None


def unit_of(name: str) -> str:
    """Return the unit that a name ends with, as in "Time (ps)" or "Etot[eV]"; "" if none."""
    found = UNIT.search(name)
    return found["unit"] if found else ""


def plain(name: str) -> str:
    """Return a name without its unit, in small letters."""
    return UNIT.sub("", name).strip().lower()


def _numeric(row: list[str]) -> bool:
    try:
        return bool([float(x) for x in row])
    except ValueError:
        return False


def _table(path: Path, heads: list[str], rows: list[list[str]]) -> Columns:
    heads = [head.strip() for head in heads]
    short = next((i for i, row in enumerate(rows, 1) if len(row) != len(heads)), None)
    if short is not None:
        raise InvalidInput(f"{path}: row {short} has {len(rows[short - 1])} entries for {len(heads)} columns")
    return {head: [row[k] for row in rows] for k, head in enumerate(heads)}


def _headed(path: Path, comments: list[list[str]], rows: list[list[str]]) -> Columns:
    """The columns that the first row names or, if it has numbers, the last comment of as many words."""
    if not _numeric(rows[0]):
        return _table(path, rows[0], rows[1:])
    named = [names for names in comments if len(names) == len(rows[0]) and not _numeric(names)]
    return _table(path, named[-1] if named else [str(k) for k in range(1, len(rows[0]) + 1)], rows)


def _csv(path: Path, lines: list[str]) -> Columns:
    comments = list(csv.reader(line.lstrip("# ") for line in lines if line.startswith("#")))
    return _headed(path, comments, list(csv.reader(line for line in lines if not line.startswith("#"))))


def _blanks(path: Path, lines: list[str]) -> Columns:
    """The columns of a table by blanks, or of all tables of a log that have the names of its longest one.

    A line of a log is part of a table if it has a number for each of the names that stand last above it.
    """
    comments = [line.lstrip("# ").split() for line in lines if line.startswith("#")]
    rows = [line.split() for line in lines if not line.startswith("#")]
    if _numeric(rows[0]):
        return _headed(path, comments, rows)
    tables: dict[tuple[str, ...], list[list[str]]] = {}
    names: tuple[str, ...] = ()
    for row, after in zip(rows, [*rows[1:], []], strict=True):
        if not _numeric(row):
            # A message in the midst of a table, such as a warning, ends it for nothing but a new line of names.
            names = tuple(row) if len(after) == len(row) and _numeric(after) else names
        elif len(row) == len(names):
            table = tables.setdefault(names, [])
            # A log's next run begins with the last row of the run before.
            if not table or table[-1][0] != row[0]:
                table.append(row)
    if not tables:
        return _headed(path, comments, rows)
    names, longest = max(tables.items(), key=lambda item: len(item[1]))
    return _table(path, list(names), longest)


def _xvg(path: Path, lines: list[str]) -> Columns:
    labels = [found for line in lines if (found := LABEL.match(line))]
    rows = [line.split() for line in lines if not line.startswith(("#", "@", "&"))]
    heads = [str(k) for k in range(1, len(rows[0]) + 1)]
    unit = next((unit_of(x["text"]) for x in labels if x["axis"] == "y"), "")
    for found in labels:
        if found["axis"] == "x":
            heads[0] = found["text"]
        elif found["set"] and int(found["set"]) + 1 < len(heads):
            heads[int(found["set"]) + 1] = f"{found['text']} ({unit})" if unit else found["text"]
    return _table(path, heads, rows)
