"""Stored error tables: CSV with its provenance, written whole or not at all, and compared within bands.

A file starts with lines ``# key: value`` (values in JSON), among them ``columns``, the columns with their kinds, and
``sha256``, the digest of all that follows.  Numbers are written so that reading gives the same double.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import platform
import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

DIRECTORY = Path(__file__).parent
REMEDY = "to record it anew: python -m pytest benchmarks --update-tables"
#: What the file says of itself; no key of a caller's provenance.
RESERVED = ("columns", "sha256")
PACKAGES = ("numpy", "numba", "heyoka", "rebound", "sympy")


class CorruptTable(RuntimeError):
    """A stored table that cannot be trusted; the message names the file, what is wrong and the remedy."""

    def __init__(self, path, what: str):
        super().__init__(f"{path}: {what}; {REMEDY}")


def provenance(problem, **more) -> dict:
    """What a table was computed from: digests of the problem's formulae and initial data, and versions."""
    import sympy as sp

    system = problem.system
    formulae = "|".join(sp.srepr(e) for e in (sp.sympify(system.H), *system.dq, *system.dp))
    data = repr((tuple(map(float, problem.q0)), tuple(map(float, problem.p0))))
    return {
        "problem": problem.label,
        "formulae": hashlib.sha256(formulae.encode()).hexdigest(),
        "initial data": hashlib.sha256(data.encode()).hexdigest(),
        "python": platform.python_version(),
        **{name: version_of(name) for name in PACKAGES},
        **more,
    }


def version_of(package: str) -> str | None:
    """The installed version of a package; None where it is absent."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return None


# -- on disk ----------------------------------------------------------------------------------------------------------


def write(name: str, frame: pd.DataFrame, provenance: Mapping, directory: Path | str = DIRECTORY) -> Path:
    """Store a table (columns of floats, integers, booleans or text) under ``name``; returns its path.

    Raises
    ------
    ValueError
        For a name that is no plain file name, a key or column that the format cannot hold, or no provenance.
    """
    if not provenance:
        raise ValueError("a table needs its provenance")
    for key in provenance:
        if key in RESERVED or not re.fullmatch(r"[A-Za-z0-9][\w. -]*", key):
            raise ValueError(f"the provenance's key {key!r} is reserved or not plain")
    if not frame.columns.is_unique or not all(isinstance(c, str) and c[:1] != "#" for c in frame.columns):
        raise ValueError("the columns' names must be unique text without a leading #")
    frame = frame.infer_objects()
    kinds = {c: _kind(frame[c]) for c in frame.columns}
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(kinds)
    for row in frame.itertuples(index=False, name=None):
        rows.writerow([_cell(x, kind) for x, kind in zip(row, kinds.values(), strict=True)])
    body = text.getvalue()
    header = {**provenance, "columns": kinds, "sha256": _digest(body)}
    lines = [f"# {key}: {json.dumps(value)}\n" for key, value in header.items()]
    path = _path(name, directory)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, "".join(lines) + body)
    return path


def read(name: str, directory: Path | str = DIRECTORY) -> tuple[pd.DataFrame, dict]:
    """The stored table and its provenance.

    Raises
    ------
    FileNotFoundError
        Where there is no such table.
    CorruptTable
        Where its header, columns, cells or checksum are wrong.
    """
    path = _path(name, directory)
    try:
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    except UnicodeDecodeError as error:
        raise CorruptTable(path, f"it is no text ({error})") from None
    header: dict = {}
    at = 0
    for line in lines:
        if not line.startswith("#"):
            break
        key, _, value = line[1:].strip().partition(": ")
        try:
            header[key] = json.loads(value)
        except json.JSONDecodeError:
            raise CorruptTable(path, f"line {at + 1} of its header is not 'key: value': {line.strip()!r}") from None
        at += 1
    missing = [key for key in RESERVED if key not in header]
    if missing:
        raise CorruptTable(path, f"its provenance lacks {' and '.join(missing)}")
    kinds, digest = header.pop("columns"), header.pop("sha256")
    if not header:
        raise CorruptTable(path, "it has no provenance")
    if not isinstance(kinds, dict) or not set(kinds.values()) <= set(READERS):
        raise CorruptTable(path, "its header does not say what the columns are")
    body = "".join(lines[at:])
    frame = _parse(path, body, kinds, at)
    if _digest(body) != digest:
        raise CorruptTable(path, "its rows do not match their checksum")
    return frame, header


def _parse(path: Path, body: str, kinds: dict, before: int) -> pd.DataFrame:
    import pandas as pd

    records = csv.reader(io.StringIO(body))
    names = next(records, [])
    lacking = [c for c in kinds if c not in names]
    if lacking:
        raise CorruptTable(path, f"it lacks the columns {', '.join(lacking)}")
    if names != list(kinds):
        raise CorruptTable(path, f"its columns are {', '.join(names)}, its header names {', '.join(kinds)}")
    columns: dict[str, list] = {c: [] for c in kinds}
    for record in records:
        line = before + records.line_num
        if len(record) != len(kinds):
            raise CorruptTable(path, f"line {line} has {len(record)} cells, not {len(kinds)}")
        for (column, kind), cell in zip(kinds.items(), record, strict=True):
            try:
                columns[column].append(READERS[kind](cell))
            except (ValueError, KeyError):
                raise CorruptTable(path, f"line {line}, column {column}: {cell!r} is no {kind}") from None
    return pd.DataFrame({c: pd.Series(columns[c], dtype=DTYPES[kind]) for c, kind in kinds.items()})


READERS = {"float": float, "int": int, "bool": {"True": True, "False": False}.__getitem__, "text": str}
DTYPES = {"float": "float64", "int": "int64", "bool": "bool", "text": "object"}


def _kind(column: pd.Series) -> str:
    from pandas.api import types

    if types.is_bool_dtype(column):
        return "bool"
    if types.is_integer_dtype(column):
        return "int"
    return "float" if types.is_float_dtype(column) else "text"


def _cell(x, kind: str) -> str:
    if kind == "text":
        return "" if x is None or x != x else str(x)
    return repr(float(x)) if kind == "float" else str(x)


def _digest(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()


def _path(name: str, directory: Path | str) -> Path:
    if not re.fullmatch(r"[A-Za-z0-9][\w.-]*", name):
        raise ValueError(f"{name!r} is no plain name of a table")
    return Path(directory) / f"{name}.csv"


def write_file(path: Path, content: str | bytes) -> None:
    """Write beside, then rename: a reader sees the old table or the new one."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content.encode() if isinstance(content, str) else content)
        os.chmod(temporary, 0o644)  # mkstemp lets only the owner read
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


# -- compared ---------------------------------------------------------------------------------------------------------


def compare(
    measured: pd.DataFrame,
    stored: pd.DataFrame,
    keys: Sequence[str],
    bands: Mapping[str, tuple[float, float]],
) -> pd.DataFrame:
    """The violations: cells outside their band, texts that differ, rows missing or extra.

    Parameters
    ----------
    measured, stored : tables
    keys : the columns that identify a row
    bands : column -> (relative, absolute); |measured - stored| may be at most relative * |stored| + absolute.
        Numbers in columns without a band are not compared; texts and booleans always are, exactly.  NaN equals NaN.

    Returns
    -------
    Table of the columns ``keys``, column, measured, stored, allowed; a row missing or extra has the column "row".

    Raises
    ------
    ValueError
        Where a key or a column with a band is in neither or only one of the tables, or two rows have the same keys.
    """
    import pandas as pd
    from pandas.api import types

    def exact(frame, c):
        return not types.is_numeric_dtype(frame[c]) or types.is_bool_dtype(frame[c])

    measured, stored = measured.infer_objects(), stored.infer_objects()
    new, old = _rows(measured, keys, "measured"), _rows(stored, keys, "stored")
    for column in bands:
        for frame, name in ((measured, "measured"), (stored, "stored")):
            if column not in frame:
                raise ValueError(f"the {name} table has no column '{column}', which has a band")
    others = [c for c in measured if c in stored and c not in keys and c not in bands]
    texts = [c for c in others if exact(measured, c) or exact(stored, c)]
    differences = []
    for key in [*old, *(k for k in new if k not in old)]:
        if key not in new or key not in old:
            presence = ["present" if key in side else "missing" for side in (new, old)]
            differences.append([*key, "row", *presence, "present"])
            continue
        for column, (relative, absolute) in bands.items():
            x, y = float(new[key][column]), float(old[key][column])
            allowed = relative * abs(y) + absolute
            if not (x == y or (x != x and y != y) or abs(x - y) <= allowed < float("inf")):
                differences.append([*key, column, x, y, allowed])
        for column in texts:
            x, y = new[key][column], old[key][column]
            if not _same(x, y):
                differences.append([*key, column, x, y, "equal"])
    return pd.DataFrame(differences, columns=[*keys, "column", "measured", "stored", "allowed"], dtype=object)


def difference(old: pd.DataFrame | None, new: pd.DataFrame, keys: Sequence[str]) -> str:
    """What changes when ``new`` replaces ``old`` (None: there was none), one line a cell; empty where nothing does."""
    if old is None:
        return f"new table of {len(new)} rows"
    before, after = _rows(old, keys, "old"), _rows(new, keys, "new")
    lines = [f"- column {c}" for c in old if c not in new] + [f"+ column {c}" for c in new if c not in old]
    for key in [*before, *(k for k in after if k not in before)]:
        where = ", ".join(f"{k}={v}" for k, v in zip(keys, key, strict=True))
        if key not in after:
            lines.append(f"- row {where}")
        elif key not in before:
            lines.append(f"+ row {where}")
        else:
            for column in (c for c in old if c in new and c not in keys):
                x, y = before[key][column], after[key][column]
                if not _same(x, y):
                    lines.append(f"  {where}: {column} {x} -> {y}{_change(x, y)}")
    return "\n".join(lines)


def _rows(frame: pd.DataFrame, keys: Sequence[str], name: str) -> dict[tuple, dict]:
    """Key -> row; a missing value in a key is None, so that it equals itself."""
    lacking = [k for k in keys if k not in frame]
    if lacking:
        raise ValueError(f"the {name} table has no column {', '.join(map(repr, lacking))} for its key")
    rows: dict[tuple, dict] = {}
    for row in frame.to_dict("records"):
        key = tuple(None if row[k] != row[k] else row[k] for k in keys)
        if key in rows:
            raise ValueError(f"the {name} table has two rows of the key {key}")
        rows[key] = row
    return rows


def _same(x, y) -> bool:
    """Equal, or both missing (None, NaN, the empty text)."""
    missing = [v is None or v != v or v == "" for v in (x, y)]
    return all(missing) or (not any(missing) and x == y)


def _change(x, y) -> str:
    try:
        return f" ({(y - x) / abs(x):+.2%})" if x and x == x and y == y else ""
    except TypeError:
        return ""
