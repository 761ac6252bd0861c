"""Coefficients of compositions and splittings: as published, each with its source, and polished to full precision.

To polish is to solve the order conditions for the numbers nearest to the published ones.  `TABLES` holds the published
numbers; `polished_numbers` and `steps` return 60 digits that satisfy the conditions to 1e-50 and better.  The polished
numbers are stored in ``polished.json``, with a digest of the table that they were computed from.  A table that is new
or was edited is polished on demand; the command (`__main__`) stores the result.
"""

from __future__ import annotations

import json
import warnings
from functools import cache
from pathlib import Path

import mpmath

from phasebench.integrators.errors import unknown_name

from . import compositions, gauss, nystrom, splittings
from .fractions import DIGITS
from .table import Table, value

TABLES: tuple[Table, ...] = (*compositions.TABLES, *splittings.TABLES, *gauss.TABLES, *nystrom.TABLES)
BY_NAME = {t.name: t for t in TABLES}
#: Numbers as they stand in damaged copies of a table, {name: {index: text}}.  Of the first table a copy has two digits
#: exchanged in one number and three too many in another; of the second a digit is lost in several programs' tables.
DAMAGED: dict[str, dict[int, str]] = {
    "sofroniou-spaletta-10": {
        8: "0.36613344954622675319114812353150",
        13: "-0.39203335373010863990644808193642610",
    },
    "aba-864": {7: "0.0653961422823734184559721793911134363710"},
}
POLISHED = Path(__file__).with_name("polished.json")
COMMAND = "python -m phasebench.integrators.coefficients"

__all__ = [
    "BY_NAME",
    "DAMAGED",
    "POLISHED",
    "TABLES",
    "Table",
    "describe",
    "polished_numbers",
    "read_polished",
    "steps",
    "table",
]


def table(name: str) -> Table:
    """The published table of coefficients with this name; raises InvalidInput for an unknown name."""
    if name not in BY_NAME:
        raise unknown_name("table of coefficients", name, BY_NAME)
    return BY_NAME[name]


@cache
def read_polished() -> dict[str, dict]:
    """The content of ``polished.json``: name of a table -> the dict that `describe` returns."""
    return json.loads(POLISHED.read_text())


@cache
def describe(name: str) -> dict:
    """The polished numbers of the table ``name`` and what is known of them, as a dict.

    Its keys are "gamma", "a" and "b" (lists of numbers as text, those that the table has), "published" (the table's
    digest), "residual_before" and "residual_after" (the largest residual of the order conditions with the published and
    with the polished numbers), "moved" (the largest change of a number), "sum" and "sum_of_sizes" (of the substeps).
    It is read from ``polished.json``, or computed, with a warning, for a table that is not there.

    Raises
    ------
    InvalidInput
        For an unknown name.
    ArithmeticError
        If the numbers of a table that is not in ``polished.json`` do not have the order that it declares.
    """
    wanted = table(name)
    kept = read_polished().get(name, {})
    if kept.get("published") == wanted.digest:
        return kept
    from .polish import entry

    warnings.warn(f"{name} is new or was edited and is polished now; to keep the numbers: {COMMAND}", stacklevel=2)
    return entry(wanted)


def polished_numbers(name: str) -> tuple[mpmath.mpf, ...]:
    """The numbers of the table ``name`` to 60 digits, which solve its order conditions.

    Their order is that of `Table.published`.
    """
    texts = describe(name)
    with mpmath.workdps(DIGITS):
        return tuple(value(x) for part in ("gamma", "a", "b") for x in texts.get(part, ()))


def steps(name: str) -> list:
    """All substeps of the table ``name`` to 60 digits: fractions of a composition, or pairs (letter, weight).

    The letters of a splitting are "A" for a drift and "B" for a kick.
    """
    return table(name).steps(polished_numbers(name))
