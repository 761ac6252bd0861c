"""Compares two stored runs: rows whose status changed, or that became less accurate or significantly slower.

Rows are matched by their texts and by the numbers that describe the run (`SETTINGS`); columns of errors and of times
are recognized by their names.  Times are compared per method and table: the median of its rows' time ratios, with a
95 % interval (`measure.timing`), divided by the median over the table, which measures the speed of the machine.  A
method is slower if the whole interval is above `SLOWER`.
"""

from __future__ import annotations

import json
import subprocess
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.timing import Median, median
from phasebench.integrators.errors import InvalidInput

from . import lines, schema
from .cells import text
from .compare import EXACT, MISSING, ROW, Difference, Pair, differences, match, number
from .digits import ERRORS, SETTINGS, TIMES
from .schema import PROVENANCE

#: Columns in which a change is reported; and columns of text that do not identify a row.
JUDGED = ("status", "verdict")
PROSE = ("reason", "version", "versions", "tier", "source", "printed", "shows", "what", "against", "link")
PROSE += ("order_reason", "intervals", "measured", "time", "units")
#: Tables whose cells are measured in parallel: their seconds are not compared.
BESIDE = ("matrix", "audit", "pde")
#: Smallest ratio of times at which a method counts as slower (or its inverse as faster).
SLOWER = 1.15
#: Smallest number of rows of a method for comparing times.
ENOUGH = 3


class Factor(NamedTuple):
    """Tolerance for two numbers: in modulus they may differ by the factor ``largest``, or both be at most ``floor``."""

    largest: float
    floor: float

    def allows(self, measured: float, stored: float) -> bool:
        """True if neither is more than `largest` times the other, or both are at most the floor."""
        a, b = sorted((abs(measured), abs(stored)))
        return b <= max(self.largest * a, self.floor)


#: Tolerance for errors: a change by more than this factor is reported if it is above round-off.
GROWN = Factor(1.5, 1e-13)


class Change(NamedTuple):
    """A difference between two runs, of a kind of `KINDS`; of times it is that of a method, "1" and the ratio."""

    kind: str
    table: str
    row: str
    column: str
    before: str
    after: str
    ratio: Median | None = None


STATUS, WORSE, BETTER, SLOW, FAST = "status", "less accurate", "more accurate", "slower", "faster"
GONE, NEW = "no longer there", "new"
KINDS = (STATUS, WORSE, SLOW, GONE, BETTER, FAST, NEW)
#: Kinds that a maintainer has to look at.
BAD = (STATUS, WORSE, SLOW, GONE)


def load(name: str) -> dict[str, pd.DataFrame]:
    """The tables of a stored run, table name -> data frame.

    ``name`` is a folder of reports or of their data, a CSV file, a file of rows that ``phasebench run`` wrote (.jsonl),
    or a commit of the repository that has reports.  Raises InvalidInput.
    """
    path = Path(name)
    if path.is_file():
        texts = {"rows" if path.suffix == ".jsonl" else path.stem: _text_of(path)}
    elif path.is_dir():
        folder = path / "data" if (path / "data").is_dir() else path
        texts = {p.stem: _text_of(p) for p in sorted(folder.glob("*.csv"))}
    else:
        texts = _of_commit(name)
    if not texts:
        raise InvalidInput(f"{name} has no tables: give a folder of reports, a CSV file, rows of `run`, or a commit")
    return {table: _read(table, text) for table, text in texts.items()}


def load_pair(before: str, after: str) -> tuple[dict[str, pd.DataFrame], dict[str, pd.DataFrame]]:
    """Read the tables of two runs, as `load` does; two single files are the same table, whatever their names."""
    old, new = load(before), load(after)
    if Path(before).is_file() and Path(after).is_file():
        new = dict(zip(old, new.values(), strict=True))
    if not old.keys() & new.keys():
        raise InvalidInput(f"{before} and {after} have no table in common")
    return old, new


def _text_of(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise InvalidInput(f"{path} cannot be read: {error}") from None


def _of_commit(name: str) -> dict[str, str]:
    def git(*words: str) -> str:
        try:
            done = subprocess.run(["git", *words], capture_output=True, text=True, check=False)
        except OSError:
            done = None
        if done is None or done.returncode:
            raise InvalidInput(f"'{name}' is neither a folder, nor a file, nor a commit of the repository one is in")
        return done.stdout

    if name.startswith("-"):
        raise InvalidInput(f"'{name}' is neither a folder, nor a file, nor a commit")
    root = git("rev-parse", "--show-toplevel").strip()
    paths = git("-C", root, "ls-tree", "--name-only", name, "reports/data/").split()
    return {Path(p).stem: git("-C", root, "show", f"{name}:{p}") for p in paths if p.endswith(".csv")}


def _read(table: str, text: str) -> pd.DataFrame:
    try:
        if text.lstrip().startswith("{"):
            return _of_lines(table, text)
        return pd.read_csv(StringIO(text), low_memory=False)
    except ValueError as error:
        raise InvalidInput(f"the table {table} cannot be read: {error}") from None


def _of_lines(table: str, text: str) -> pd.DataFrame:
    rows = [json.loads(line) for line in text.splitlines() if line.strip()]
    if not all(isinstance(row, dict) and "method" in row for row in rows):
        raise ValueError("a line has no row of a method")
    for row in rows:
        schema.check(row, table)
    return pd.DataFrame(rows).drop(columns=[schema.FIELD, *lines.ABOUT], errors="ignore")


def changes(before: dict[str, pd.DataFrame], after: dict[str, pd.DataFrame]) -> list[Change]:
    """The differences between the tables of two runs, the worst kind first; a table that is gone is one of them."""
    found = [c for table in before if table in after for c in _of_table(table, before[table], after[table])]
    found += [Change(GONE, table, "all rows", "", "", "") for table in before if table not in after]
    return sorted(found, key=lambda c: (KINDS.index(c.kind), c.table, c.row))


def _of_table(table: str, old: pd.DataFrame, new: pd.DataFrame) -> list[Change]:
    key, pairs = _pairs(old, new)
    columns = [c for c in old if c in new and c not in key]
    limits = {c: EXACT if c in JUDGED else GROWN for c in columns if _is_compared(c)}
    out = [_change(table, d) for d in differences(pairs, limits)]
    out += [Change(GONE, table, "all rows", c, "", "") for c in old if c not in new and _is_compared(c)]
    if table in BESIDE:
        return out
    return out + [c for column in columns if TIMES.fullmatch(column) for c in _times(table, column, pairs)]


def _is_compared(column: str) -> bool:
    return column in JUDGED or bool(ERRORS.fullmatch(column))


def _pairs(old: pd.DataFrame, new: pd.DataFrame) -> tuple[list[str], list[Pair]]:
    key = [c for c in old if c in new and _is_key(c, old, new)]
    return key, match(new.to_dict("records"), old.to_dict("records"), key)


def _change(table: str, d: Difference) -> Change:
    """A difference as a `Change`; an error that only one of the two runs has as a number is `GONE`, or `NEW`."""
    row = ", ".join(filter(None, d.key))
    if d.column == ROW:
        return Change(GONE if d.measured == MISSING else NEW, table, row, "", "", "")
    a, b = number(d.stored), number(d.measured)
    if a is None or b is None:
        kind = STATUS if a is b else GONE if b is None else NEW
        return Change(kind, table, row, d.column, text(d.stored), text(d.measured))
    a, b = abs(a), abs(b)
    x = b / a if a else np.inf
    return Change(WORSE if b > a else BETTER, table, row, d.column, f"{a:.3g}", f"{b:.3g}", Median(x, x, x))


def _is_key(column: str, *tables: pd.DataFrame) -> bool:
    """True if a column of the tables says what was run (method, step, ...), and so identifies rows."""
    if column in (*JUDGED, *PROSE, *PROVENANCE):
        return False
    if all(pd.api.types.is_numeric_dtype(t[column]) for t in tables):
        return bool(SETTINGS.fullmatch(column))
    return not (ERRORS.fullmatch(column) or TIMES.fullmatch(column))


def _ratios(pairs: list[Pair], column: str) -> list[tuple[Pair, float]]:
    out = []
    for pair in pairs:
        if pair.measured is not None and pair.stored is not None:
            b, a = number(pair.measured[column]), number(pair.stored[column])
            if a and b and a > 0 and 0 < b / a < np.inf:
                out.append((pair, b / a))
    return out


def _times(table: str, column: str, pairs: list[Pair]) -> list[Change]:
    found = _ratios(pairs, column)
    if len(found) < ENOUGH:
        return []
    usual = float(np.median([ratio for _, ratio in found]))
    by_method: dict[str, list[float]] = {}
    for pair, ratio in found:
        by_method.setdefault(text(pair.stored.get("method", table)), []).append(ratio / usual)
    out = []
    for name, ratios in sorted(by_method.items()):
        own = median(np.array(ratios))
        if len(ratios) >= ENOUGH and (own.low > SLOWER or own.high < 1 / SLOWER):
            kind = SLOW if own.low > SLOWER else FAST
            out.append(Change(kind, table, name, column, "1", f"{own.value:.3g}", own))
    return out


def overall(before: dict[str, pd.DataFrame], after: dict[str, pd.DataFrame]) -> Median:
    """Median of new time / old time over all rows timed in both runs; it reflects the machine as much as the code."""
    ratios: list[float] = []
    for table in before:
        if table in after and table not in BESIDE and "seconds" in before[table] and "seconds" in after[table]:
            ratios += [ratio for _, ratio in _ratios(_pairs(before[table], after[table])[1], "seconds")]
    return median(ratios)
