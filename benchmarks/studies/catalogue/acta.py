"""The methods in the Acta Numerica survey of splitting methods: which of them are here, and how exact they are.

The survey is S. Blanes, F. Casas, A. Murua, Acta Numerica 33 (2024) 1-161.  Its text was not at hand.  `LISTED` holds
the processed methods that public programs transcribe from its tables 8.1 and 8.5, and the methods of the publications
that the survey collects.
"""

from __future__ import annotations

import csv
from pathlib import Path

import mpmath
import pandas as pd

from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study
from phasebench.integrators.coefficients.fractions import DIGITS
from phasebench.integrators.coefficients.order_conditions import TOLERANCE, modified_residuals, next_degrees, residuals
from phasebench.integrators.coefficients.polish import starting_values
from phasebench.integrators.coefficients.table import Table as Coefficients
from phasebench.integrators.coefficients.table import is_exact

from .exactness import (
    HOLD,
    KNOWN,
    PRINTED,
    as_text,
    digits,
    files,
    lost,
    most_lost,
    observed_order,
    reaches,
    right_decimals,
)
from .exactness import table_of as coefficients_of

ACTA, LISTED = "acta", Path(__file__).with_name("acta.csv")
#: Numbers of more decimals are of a closed form.
CLOSED = 50
#: Why a method is not here, in the file.
NO_SOURCE = "no public source with its numbers was found"
HERE, FOUND = "id == id", f"`why not` != '{NO_SOURCE}'"


def worst_digits(table: Coefficients, numbers: list[mpmath.mpf]) -> tuple[int | None, int | None]:
    """(Printed, right decimals) of the number with the most wrong ones; None if all are exact or closed forms."""
    triples = zip(table.published, starting_values(table), numbers, strict=True)
    rounded = [(x, abs(y - z)) for x, y, z in triples if not is_exact(x) and len(x.partition(".")[2]) <= CLOSED]
    return min(right_decimals(*pair) for pair in rounded)[1:] if rounded else (None, None)


def orders(table: Coefficients, numbers: list[mpmath.mpf], processed: bool) -> dict[str, str]:
    """The orders that the order conditions give a method and, if it is processed, its kernel alone."""
    if table.kind == "force-gradient":
        found = modified_residuals(table.steps(numbers), table.order[0] + 1)
        wrong = [n for n, r in enumerate(found) if max(map(abs, r)) > TOLERANCE]
        return {"order": as_text((min(wrong, default=len(found)) - 1,))}
    steps = {"order": table.steps(numbers)} | ({"kernel order": table.kernel(numbers)} if processed else {})
    found = {name: residuals(table.kind, of, next_degrees(table.order)) for name, of in steps.items()}
    return {name: as_text(observed_order(r, len(table.order))) for name, r in found.items()}


def measure() -> list[dict]:
    """The listed methods with their orders, and how many of their printed digits hold."""
    with LISTED.open(newline="", encoding="utf-8") as stream:
        listed = list(csv.DictReader(stream))
    rows = []
    with mpmath.workdps(DIGITS):
        for row in listed:
            why = {"why not": row.pop("why not")}
            row |= {"processed": row["processed"] == "True", "order": "", "kernel order": "", PRINTED: None, HOLD: None}
            if row["id"]:
                table, numbers = coefficients_of(row["id"])
                row |= orders(table, numbers, row["processed"])
                row[PRINTED], row[HOLD] = worst_digits(table, numbers)
            rows.append(row | why)
    return rows


def agrees(rows: pd.DataFrame) -> pd.Series:
    """True where the printed order is the first entries of the computed one; of a single number, the whole of it."""

    def same(printed: str, order: str) -> bool:
        short, long = printed.split(","), order.split(",")
        return long[: len(short)] == short and (len(short) > 1 or len(long) == 1)

    pairs = zip(rows["printed order"].astype(str), rows["order"].astype(str), strict=True)
    return pd.Series([same(*pair) for pair in pairs], rows.index)


def lower(rows: pd.DataFrame) -> pd.Series:
    """True where the kernel alone has a lower order."""
    return reaches(rows, "order", "kernel order") & (rows["order"] != rows["kernel order"])


@of(ACTA)
def _shown(rows: pd.DataFrame) -> Table:
    rank = lost(rows).fillna(-1.0) + 100.0 * rows["processed"] + 1000.0 * rows["id"].isna()
    part = rows.loc[rank.sort_values(ascending=False, kind="stable").index].head(ROWS)
    columns = ["table", "kind", "stages", "printed order", "work", "id", "order", "kernel order", "why not"]
    texts = part[columns].astype(object).where(part[columns].notna(), "")
    texts.insert(len(columns) - 1, HOLD, digits(part))
    caption = (
        "The rows that are not here, the processed methods, and those of which the fewest printed digits hold; `order` "
        "is by the order conditions, with the processor. data/acta.csv has every row."
    )
    return Table(texts, caption)


STUDY = Study(
    id="acta",
    place=443,
    question="Which of the splitting methods in Acta Numerica's survey of 2024 are here?",
    answer="{orders.of} splitting and composition methods of Acta Numerica's survey are here, {processors.of} of them "
    "processed; of {lacking} groups no numbers were found.",
    setting=(
        "The survey is Blanes, Casas and Murua, Splitting methods for differential equations, Acta Numerica 33 (2024).",
        "Orders are computed from the coefficients, as on the page [coefficients](coefficients.md). A printed decimal "
        "holds if the number is within one unit of it of the nearest solution of the order conditions.",
        "A processed method is P Kⁿ P⁻¹ for n steps: a step costs the kernel K, and the processor P gives its order. P "
        "and its inverse act where a state is stored.",
    ),
    runs=(Runs(ACTA, measure, [{}], lambda: [*files(), LISTED.read_text(encoding="utf-8")]),),
    claims={
        "here": Claim(
            "Every listed method whose coefficients were found is here",
            ACTA, HERE, rows=FOUND, unit="methods", where="{work}", names=3,
        ),
        "found": Claim(
            "The coefficients of every listed method were found",
            ACTA, FOUND, unit="rows", where="{work}", names=3,
        ),
        "orders": Claim(
            "The order conditions give every method its printed order, and no more",
            ACTA, agrees, rows=HERE, unit="methods", where="{id}", names=4, fault=True,
        ),
        "digits": Claim(
            "Every printed digit of the coefficients holds",
            ACTA, lambda rows: lost(rows) <= 0, rows=KNOWN, unit="methods",
            where=most_lost(f"{{id}}: {{{HOLD}:.0f}} of {{{PRINTED}:.0f}}"),
        ),
        "processors": Claim(
            "Every processed kernel has a lower order without its processor",
            ACTA, lower, rows=f"processed == True and {HERE}", unit="methods", where="{id}", names=4, fault=True,
        ),
    },
    numbers={"lacking": Number(ACTA, lambda rows: (rows["why not"] == NO_SOURCE).sum())},
    shown=_shown,
    limits=(
        "The survey's text was not at hand. `table` names its table where a public program transcribes the row; the "
        "other rows are methods of the works that it collects, and methods of its own may be missing.",
        "Digits are those of the copy that was read, at times more than were printed. Decimals are counted from the "
        "point: a small number of as many significant digits as the others has its last ones beyond what holds.",
        "An order (p, q, …) is that of the terms in ε, ε², …; the printed one may leave out the last.",
    ),
)  # fmt: skip
