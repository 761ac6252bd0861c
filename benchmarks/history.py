"""Two stored runs beside each other: what changed its status, became less accurate, or slower beyond the noise.

A row is found by its texts and by the numbers that say what was run; the other numbers are told by the names of their
columns.  An error has grown where it is more than `LESS` times what it was and above round-off.  Times are taken for a
method in a table: the median of its rows' ratios with its 95 % interval (`measure.timing`), against the median of the
whole table, which is how fast the machine was; a method is slower where the whole interval is above `SLOWER`.
"""

from __future__ import annotations

import re
import subprocess
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.timing import Median, median
from phasebench.integrators.errors import InvalidInput

from .rows.tables import PROVENANCE

#: Columns whose change is a finding; and texts that tell no row from another.
JUDGED = ("status", "verdict")
PROSE = ("reason", "version", "versions", "tier", "source", "printed", "shows", "what", "against", "link")
PROSE += ("order_reason", "intervals", "measured", "time", "units")
#: Numbers that say what was run.
SETTINGS = re.compile(
    r"h|tol|e|mu|N|d|orbits|periods|points|lambda|t_end|x|number|pairs?|classical|h omega / pi|steps per orbit|stages"
)
ERRORS = re.compile(r".*(error|defect|uncertainty|refinement_difference|symplecticity|reversibility|energy_max).*")
TIMES = re.compile(r"(seconds|first run|ms|(us|ns) [^,]*|.*'s ns .*)")
#: Tables whose cells are measured beside each other: their seconds are no times.
BESIDE = ("matrix", "audit", "pde")
#: An error has grown by more than this, and is above round-off; a method is slower, or faster, by more than this.
LESS, ROUND_OFF, SLOWER = 1.5, 1e-13, 1.15
#: The rows of a method whose times are compared, at least.
ENOUGH = 3


class Change(NamedTuple):
    """What of a table differs.

    Attributes
    ----------
    kind : one of `KINDS`
    table, row, column : where
    before, after : the two values, as text
    ratio : after / before with its interval, or None
    """

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
#: Those that a maintainer has to know of.
BAD = (STATUS, WORSE, SLOW, GONE)


def stored(name: str) -> dict[str, pd.DataFrame]:
    """The tables of a run: of a folder of reports or of data, a CSV file, or a commit whose reports are stored.

    Raises
    ------
    InvalidInput
        Where there is none of these, or it holds no table that can be read.
    """
    path = Path(name)
    if path.is_file():
        texts = {path.stem: path.read_text(encoding="utf-8")}
    elif path.is_dir():
        folder = path / "data" if (path / "data").is_dir() else path
        texts = {p.stem: p.read_text(encoding="utf-8") for p in sorted(folder.glob("*.csv"))}
    else:
        texts = _of_commit(name)
    if not texts:
        raise InvalidInput(f"{name} has no tables: give a folder of reports, a CSV file of one, or a commit")
    return {table: _read(table, text) for table, text in texts.items()}


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
        return pd.read_csv(StringIO(text), low_memory=False)
    except ValueError as error:
        raise InvalidInput(f"the table {table} cannot be read: {error}") from None


def changes(before: dict[str, pd.DataFrame], after: dict[str, pd.DataFrame]) -> list[Change]:
    """What differs between the tables of two runs that both have, the worst kind first."""
    found = [c for table in before if table in after for c in _of_table(table, before[table], after[table])]
    return sorted(found, key=lambda c: (KINDS.index(c.kind), c.table, c.row))


def _of_table(table: str, old: pd.DataFrame, new: pd.DataFrame) -> list[Change]:
    key = [c for c in old if c in new and _tells(c, old, new)]
    old, new = _found_by(key, old), _found_by(key, new)
    out = [Change(GONE, table, i[0], "", "", "") for i in old.index.difference(new.index)]
    out += [Change(NEW, table, i[0], "", "", "") for i in new.index.difference(old.index)]
    both = old.index.intersection(new.index)
    old, new = old.loc[both], new.loc[both]
    for column in (c for c in old if c in new and c not in key):
        a, b = old[column], new[column]
        if column in JUDGED:
            moved = (a.astype(object).fillna("") != b.astype(object).fillna("")).to_numpy()
            out += [Change(STATUS, table, i[0], column, str(a[i]), str(b[i])) for i in both[moved]]
        elif ERRORS.fullmatch(column):
            out += _errors(table, column, pd.to_numeric(a, errors="coerce"), pd.to_numeric(b, errors="coerce"))
        elif TIMES.fullmatch(column) and table not in BESIDE:
            names = old["method"] if "method" in old else pd.Series(table, index=both)
            out += _times(table, column, pd.to_numeric(b, errors="coerce") / pd.to_numeric(a, errors="coerce"), names)
    return out


def _tells(column: str, *tables: pd.DataFrame) -> bool:
    """Whether a column says what was run."""
    if column in (*JUDGED, *PROSE, *PROVENANCE):
        return False
    if all(pd.api.types.is_numeric_dtype(t[column]) for t in tables):
        return bool(SETTINGS.fullmatch(column))
    return not (ERRORS.fullmatch(column) or TIMES.fullmatch(column))


def _found_by(key: list[str], table: pd.DataFrame) -> pd.DataFrame:
    """The table with its rows' key, as text, and how often it has come before, as the index."""
    said = table[key].astype(object).where(table[key].notna(), "")
    lines = zip(*(said[c] for c in key), strict=True) if key else ([] for _ in table.index)
    text = pd.Series([", ".join(str(x) for x in line if x != "") for line in lines], index=table.index, dtype=object)
    number = text.groupby(text).cumcount() if len(text) else text
    return table.assign(_row=text, _number=number).set_index(["_row", "_number"])


def _errors(table: str, column: str, a: pd.Series, b: pd.Series) -> list[Change]:
    a, b = a.abs(), b.abs()
    grown = (b > LESS * a) & (b > ROUND_OFF)
    fallen = (a > LESS * b) & (a > ROUND_OFF)
    out = []
    for kind, which in ((WORSE, grown), (BETTER, fallen)):
        for i in a.index[which.to_numpy()]:
            x = b[i] / a[i] if a[i] else np.inf
            out.append(Change(kind, table, i[0], column, f"{a[i]:.3g}", f"{b[i]:.3g}", Median(x, x, x)))
    return out


def _times(table: str, column: str, ratios: pd.Series, methods: pd.Series) -> list[Change]:
    good = ratios.notna() & np.isfinite(ratios) & (ratios > 0)
    if good.sum() < ENOUGH:
        return []
    ratios, methods = ratios[good.to_numpy()], methods[good.to_numpy()]
    usual = float(np.median(ratios))
    out = []
    for name, members in ratios.groupby(methods.to_numpy()):
        found = median(members / usual)
        if len(members) >= ENOUGH and (found.low > SLOWER or found.high < 1 / SLOWER):
            kind = SLOW if found.low > SLOWER else FAST
            out.append(Change(kind, table, str(name), column, "1", f"{found.value:.3g}", found))
    return out


def usual(before: dict[str, pd.DataFrame], after: dict[str, pd.DataFrame]) -> Median:
    """How many times as long all that both timed took: the machine, as much as the code."""
    ratios: list[float] = []
    for table in before:
        if table in after and table not in BESIDE and "seconds" in before[table] and "seconds" in after[table]:
            old, new = before[table], after[table]
            key = [c for c in old if c in new and _tells(c, old, new)]
            a, b = _found_by(key, old)["seconds"], _found_by(key, new)["seconds"]
            found = (b / a.reindex(b.index)).dropna()
            ratios += list(found[np.isfinite(found)])
    return median(ratios)
