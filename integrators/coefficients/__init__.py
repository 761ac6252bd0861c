"""Coefficients of compositions and splittings: as published, each with its source, and polished to full precision.

`TABLES` holds them as published; `polished_numbers` and `steps` give them with 60 digits that satisfy the order
conditions to 1e-50 and better.  They stand in ``polished.json``, each with a digest of the table it was made from: one
that is new or was edited is polished when it is asked for, and the command (`__main__`) keeps the result.
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

__all__ = ["BY_NAME", "DAMAGED", "POLISHED", "TABLES", "Table", "about", "polished", "steps", "stored", "table"]


def table(name: str) -> Table:
    """The table of that name; raises InvalidInput for an unknown one."""
    if name not in BY_NAME:
        raise unknown_name("table of coefficients", name, BY_NAME)
    return BY_NAME[name]


@cache
def read_polished() -> dict[str, dict]:
    """The content of ``polished.json``: name of a table -> its polished numbers and what is known of them."""
    return json.loads(POLISHED.read_text())


@cache
def describe(name: str) -> dict:
    """The polished numbers of a table, the residuals of its order conditions before and after, and the largest change.

    Raises
    ------
    InvalidInput
        For an unknown name.
    ArithmeticError
        Where the numbers of a table that is not in ``polished.json`` have not the order that it declares.
    """
    wanted = table(name)
    kept = read_polished().get(name, {})
    if kept.get("published") == wanted.digest:
        return kept
    from .polish import entry

    warnings.warn(f"{name} is new or was edited and is polished now; to keep the numbers: {COMMAND}", stacklevel=2)
    return entry(wanted)


def polished_numbers(name: str) -> tuple[mpmath.mpf, ...]:
    """The numbers of a table, polished to 60 digits, in the order of `Table.published`."""
    texts = describe(name)
    with mpmath.workdps(DIGITS):
        return tuple(value(x) for part in ("gamma", "a", "b") for x in texts.get(part, ()))


def steps(name: str) -> list:
    """All substeps of a table, polished: fractions of a composition, or pairs (letter, weight) of a splitting."""
    return table(name).steps(polished_numbers(name))
