"""Compares two tables: matches their rows and checks that numbers differ by no more than given bands.

It compares measurements with the recorded error tables, measurements that a run repeats as a random sample with the
stored rows (`of_sample`), and two stored runs (`history`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from .cells import Cell, text
from .digits import TIMES
from .tables import fresh_rows

if TYPE_CHECKING:
    from .journal import Entry
    from .run import Outcome
    from .tables import Table

Row = Mapping[str, Any]
#: The column of a `Difference` where a whole row is missing, and the texts of its two sides.
ROW, PRESENT, MISSING = "row", "present", "missing"


class Limit(Protocol):
    """A tolerance for the difference of two numbers."""

    def allows(self, measured: float, stored: float) -> bool:
        """True if the two numbers count as equal."""


class Band(NamedTuple):
    """Tolerance |measured - stored| <= relative |stored| + absolute."""

    relative: float
    absolute: float

    def allows(self, measured: float, stored: float) -> bool:
        """True if the difference is within the band; an infinite number is never within it."""
        return abs(measured - stored) <= self.relative * abs(stored) + self.absolute < float("inf")


EXACT = Band(0.0, 0.0)


class Pair(NamedTuple):
    """The same row, identified by texts (``key``), in a measured and a stored table; None where a table lacks it."""

    key: tuple[str, ...]
    measured: Row | None
    stored: Row | None


class Difference(NamedTuple):
    """A number outside its band, a text that changed, or a row that one table lacks (``column`` is then `ROW`)."""

    key: tuple[str, ...]
    column: str
    measured: object
    stored: object

    @property
    def ratio(self) -> float | None:
        """Measured / stored; None if one is not a number, or the stored one is 0."""
        x, y = number(self.measured), number(self.stored)
        return x / y if x is not None and y else None

    def __str__(self) -> str:
        ratio = "" if self.ratio is None else f", ratio {self.ratio:.6g}"
        where = ": ".join([", ".join(filter(None, self.key)), self.column])
        return f"{where}: measured {text(self.measured) or MISSING}, stored {text(self.stored) or MISSING}{ratio}"


def number(x: object) -> float | None:
    """A table cell as a double; None if it is missing or a text."""
    try:
        value = float(x)
    except (TypeError, ValueError):
        return None
    return None if value != value else value


def match(measured: Iterable[Row], stored: Iterable[Row], key: Sequence[str]) -> list[Pair]:
    """Pair the rows of two tables: the stored rows in their order, then rows that were only measured.

    Rows match if the columns of ``key`` are equal, as numbers where they are numbers; rows of equal key match in order.
    """
    new, old = _by_key(measured, key), _by_key(stored, key)
    return [
        Pair(tuple(text((old.get(at) or new[at]).get(c)) for c in key), new.get(at), old.get(at))
        for at in dict.fromkeys([*old, *new])
    ]


def _by_key(rows: Iterable[Row], key: Sequence[str]) -> dict[tuple, Row]:
    """(Values of the columns ``key``, number of earlier rows with the same values) -> row."""
    seen: Counter = Counter()
    out = {}
    for row in rows:
        at = tuple(text(row.get(c)) if (x := number(row.get(c))) is None else x for c in key)
        out[*at, seen[at]] = row
        seen[at] += 1
    return out


def differences(pairs: Iterable[Pair], limits: Mapping[str, Limit]) -> list[Difference]:
    """Rows that one side lacks, and values that differ: other texts, not allowed by the limit of their column."""
    out = []
    for key, new, old in pairs:
        if new is None or old is None:
            out.append(Difference(key, ROW, *(MISSING if side is None else PRESENT for side in (new, old))))
            continue
        for column, limit in limits.items():
            x, y = new.get(column), old.get(column)
            if text(x) != text(y):
                a, b = number(x), number(y)
                if a is None or b is None or not limit.allows(a, b):
                    out.append(Difference(key, column, x, y))
    return out


# -- the sample --------------------------------------------------------------------------------------------------------

#: Table -> column -> band, for numbers of which another processor changes the last digits only; times, round-off errors
#: and diverging trajectories are left out.  The rows of the sweep are compared with the recorded error tables instead,
#: with the bands of their scenes.
BANDS: dict[str, dict[str, Band]] = {
    "matrix": {"order": Band(0, 0.01), "symplecticity": Band(1e-3, 1e-20), "reversibility": Band(1e-3, 1e-20)},
    "multiprecision": {"order": Band(0, 1e-3)},
    "structure": {"defect": Band(1e-3, 1e-24)},
    "printed": {"refinement_difference": Band(1e-3, 1e-11)},
    "energy_preservation": {"implicit midpoint's energy error": Band(1e-3, 1e-12)},
    "oscillatory": {"energy error": Band(0.05, 1e-9)},
    "kepler": {"closed form": Band(1e-12, 0), "energy, every step": Band(0.05, 1e-10)},
    "kepler_cost": {"error": Band(1e-2, 1e-7), "energy error": Band(1e-2, 1e-10)},
    "riddle_columns": {"0.01": Band(1e-3, 0)},
    # A stated uncertainty is read from the stored certificate, so it must not change.
    "references": {"uncertainty": EXACT},
}
#: Prefix of settings whose rows depend on the machine: they take as many steps as a second allows.
OF_THE_MACHINE = "time of"
#: Table -> the column that identifies the rungs of a ladder whose length depends on the machine's speed; only rungs in
#: both tables are compared.
LADDERS = {"kepler": "setting"}


def of_cell(cell: Cell, table: str, measured: Sequence[Row], stored: Sequence[Row]) -> list[Difference]:
    """Compare rows of a repeated measurement with the stored ones in the columns of `BANDS`, and their status."""
    if table not in BANDS:
        return []
    pairs = _common(table, measured, stored)
    if not pairs:
        pairs = [Pair((), None, None)]  # no row was compared: report that as a difference
    pairs = [p for p in pairs if p.stored is None or not text(p.stored.get("setting")).startswith(OF_THE_MACHINE)]
    found = differences(pairs, BANDS[table] | {"status": EXACT})
    return [d._replace(key=(table, cell.label, *d.key)) for d in found]


def _common(table: str, measured: Sequence[Row], stored: Sequence[Row]) -> list[Pair]:
    """Pair the rows of a cell, measured again and stored; of a ladder only the rungs that both have."""
    if table not in LADDERS:
        return match(measured, stored, [])
    pairs = match(measured, stored, [LADDERS[table]])
    return [p for p in pairs if p.measured is not None and p.stored is not None]


#: Columns that say in words what others say in numbers, or name versions: in these rows may differ and agree.
WORDS = ("reason", "order_reason", "version", "versions", "shared")


class Again(NamedTuple):
    """Tolerance for a number that is measured again: its first digits, or the round-off of doubles, are the same."""

    relative: float = 1e-3
    units: tuple[float, float] = (1e-18, 1e-15)

    def allows(self, measured: float, stored: float) -> bool:
        """True if both numbers are about the same, or both are of the size of round-off."""
        low, high = self.units
        return abs(measured - stored) <= self.relative * abs(stored) or low < max(abs(measured), abs(stored)) <= high


def agree(cell: Cell, entry: Entry, stored: Mapping[str, Table]) -> bool:
    """True if new rows of a cell agree with its stored ones, which were not edited, in all but times and words."""
    for name in cell.tables:
        if stored[name].intact(cell) is None:
            return False
        new, old = fresh_rows(entry, name, cell), stored[name].of(cell)
        pairs = _common(name, new, old)
        if old and not pairs:
            return False
        columns = {c for row in (*new, *old) for c in row} - {*WORDS}
        limits = {c: Again() for c in columns if not TIMES.fullmatch(c)} | BANDS.get(name, {})
        if differences(pairs, limits):
            return False
    return True


def of_sample(outcome: Outcome) -> list[Difference]:
    """The differences between the measurements that a run repeated as a random sample and their stored rows."""
    cells = {c.id: c for c in outcome.cells}
    return [
        d
        for id, rows in outcome.sampled.items()
        for table, members in rows.items()
        for d in of_cell(cells[id], table, members, outcome.stored[table].of(cells[id]))
    ]
