"""The sample against the stored rows: what is measured again must be what is stored, within its band.

The bands are of numbers that another processor moves in the last digits alone; times and errors that are round-off are
left out, and so are trajectories that part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .cells import Cell, text
from .run import Outcome

#: Table -> column -> (relative, absolute): |measured - stored| is at most relative |stored| + absolute.  The rows of
#: the sweep are held to the stored error tables, with the bands of their scenes.
BANDS: dict[str, dict[str, tuple[float, float]]] = {
    "matrix": {"order": (0, 0.01), "symplecticity": (1e-3, 1e-20), "reversibility": (1e-3, 1e-20)},
    "multiprecision": {"order": (0, 1e-3)},
    "structure": {"defect": (1e-3, 1e-24)},
    "printed": {"refinement_difference": (1e-3, 1e-11)},
    "energy_preservation": {"implicit midpoint's energy error": (1e-3, 1e-12)},
    "oscillatory": {"energy error": (0.05, 1e-9)},
    "kepler": {"closed form": (1e-12, 0), "energy, every step": (0.05, 1e-10)},
    "kepler_cost": {"error": (1e-2, 1e-7), "energy error": (1e-2, 1e-10)},
    "riddle_columns": {"0.01": (1e-3, 0)},
    # A stated uncertainty is read from the stored certificate: it does not move at all.
    "references": {"uncertainty": (0, 0)},
}
#: Rows of these settings are of the machine: the number of steps is what a second allows.
OF_THE_MACHINE = "time of"
#: Table -> the column that tells the rows of a ladder which goes as far as the machine's speed allows: those that both
#: have are compared.
LADDERS = {"kepler": "setting"}


@dataclass(frozen=True)
class Difference:
    """A number that left its band, or a text that changed."""

    table: str
    cell: str
    column: str
    measured: object
    stored: object

    def __str__(self) -> str:
        try:
            ratio = f", ratio {float(self.measured) / float(self.stored):.6g}"
        except (TypeError, ValueError, ZeroDivisionError):
            ratio = ""
        where = f"{self.table}: {self.cell}: {self.column}"
        return f"{where}: measured {self.measured}, stored {self.stored}{ratio}"


def differences(
    cell: Cell, table: str, measured: Sequence[Mapping[str, object]], stored: Sequence[Mapping[str, str]]
) -> list[Difference]:
    """Where the rows of a cell measured again are not the stored ones (texts, in the same order)."""
    bands = BANDS.get(table, {})
    if table in LADDERS:
        measured, stored = _common(measured, stored, LADDERS[table])
    if bands and (len(measured) != len(stored) or not measured):
        return [Difference(table, cell.label, "rows", len(measured), len(stored))]
    out = []
    for new, old in zip(measured, stored, strict=False):
        if str(old.get("setting", "")).startswith(OF_THE_MACHINE):
            continue
        for column, (relative, absolute) in bands.items():
            x, y = text(new.get(column)), old.get(column, "")
            if x != y and not (x and y and abs(float(x) - float(y)) <= relative * abs(float(y)) + absolute):
                out.append(Difference(table, cell.label, column, x or "nothing", y or "nothing"))
        if bands and "status" in new and text(new["status"]) != old.get("status", ""):
            out.append(Difference(table, cell.label, "status", new["status"], old.get("status", "")))
    return out


def _common(measured: Sequence[Mapping], stored: Sequence[Mapping], column: str) -> tuple[list, list]:
    """The rows of either whose value in a column the other has too, in the order of the first."""
    known = {row.get(column, ""): row for row in stored}
    pairs = [(row, known[text(row.get(column))]) for row in measured if text(row.get(column)) in known]
    return [new for new, _ in pairs], [old for _, old in pairs]


def sampled(outcome: Outcome) -> list[Difference]:
    """What of the sample is not as it was stored."""
    cells = {c.id: c for c in outcome.cells}
    return [
        d
        for id, rows in outcome.sampled.items()
        for table, members in rows.items()
        for d in differences(cells[id], table, members, outcome.stored[table].of(cells[id]))
    ]
