"""Coefficients of compositions and splittings: as published, each with its source, and polished to full precision.

To polish is to solve the order conditions for the numbers nearest to the published ones.  Files ``published/*.toml``
hold the published numbers; `polished_numbers` and `steps` return 60 digits that satisfy the conditions to 1e-50 and
better.  The polished numbers are stored in ``polished.json``, with a digest of the table that they were computed from.
A table that is new or was edited is polished on demand; the command (`__main__`) stores the result.
"""

from __future__ import annotations

import json
import tomllib
import warnings
from functools import cache
from pathlib import Path

from phasebench.integrators.compile.lazy import mpmath
from phasebench.integrators.errors import unknown_name

from .force_gradient import ForceGradientTable
from .fractions import DIGITS
from .processed import ProcessedTable
from .table import Table, value

PUBLISHED = Path(__file__).with_name("published")
POLISHED = Path(__file__).with_name("polished.json")
COMMAND = "python -m phasebench.integrators.coefficients"

__all__ = [
    "BY_NAME",
    "GROUPS",
    "POLISHED",
    "TABLES",
    "Table",
    "describe",
    "polished_numbers",
    "read_polished",
    "steps",
    "table",
]


def _read(group: str, make: type[Table] = Table) -> tuple[Table, ...]:
    """The tables of a file of published numbers."""
    text = (PUBLISHED / f"{group}.toml").read_text(encoding="utf-8")
    found = tomllib.loads(text)["table"]
    return tuple(make(**{k: tuple(v) if isinstance(v, list) else v for k, v in fields.items()}) for fields in found)


#: The tables by the file of their published numbers.
GROUPS: dict[str, tuple[Table, ...]] = {
    "compositions": _read("compositions"),
    "splittings": _read("splittings"),
    "nystrom": _read("nystrom"),
    "collected": _read("collected"),
    "processed": _read("processed", ProcessedTable),
    "force_gradient": _read("force_gradient", ForceGradientTable),
    "sampling": _read("sampling"),
}
#: The tables whose orders and error constants are compared: those of a survey, processed ones and others are left out.
TABLES: tuple[Table, ...] = (*GROUPS["compositions"], *GROUPS["splittings"], *GROUPS["nystrom"])
BY_NAME: dict[str, Table] = {t.name: t for group in GROUPS.values() for t in group}


def table(name: str) -> Table:
    """The published table of coefficients with this name; raises InvalidInput for an unknown name."""
    if name not in BY_NAME:
        raise unknown_name("table of coefficients", name, BY_NAME)
    return BY_NAME[name]


@cache
def read_polished() -> dict[str, dict]:
    """The content of ``polished.json``: name of a table -> the dict that `describe` returns."""
    return json.loads(POLISHED.read_text(encoding="utf-8"))


@cache
def describe(name: str) -> dict:
    """The polished numbers of the table ``name`` and what is known of them, as a dict.

    Its keys are "numbers" (as text, in the order of `Table.published`), "published" (the table's digest),
    "residual_before" and "residual_after" (the largest residual of the order conditions with the published and with the
    polished numbers) and "moved" (the largest change of a number).  It is read from ``polished.json``, or computed,
    with a warning, for a table that is not there.

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
    """The numbers of the table ``name`` to 60 digits, in the order of `Table.published`, or those printed."""
    with mpmath.workdps(DIGITS):
        if table(name).printed:
            return tuple(map(value, table(name).published))
        return tuple(map(value, describe(name)["numbers"]))


def steps(name: str) -> list:
    """All substeps of the table ``name`` to 60 digits: fractions of a composition, or pairs (letter, weight).

    The letters of a splitting are "A" for a drift and "B" for a kick.  The kicks of a splitting with force gradients
    are ("B", weight, weight of the gradient).
    """
    with mpmath.workdps(DIGITS):
        return table(name).steps(polished_numbers(name))
