"""The committed reports, fabricated tables, as pages receive them, and the verdicts of pages on them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

#: The folder of the committed reports.
REPORTS = Path(__file__).resolve().parents[2] / "reports"


def frame(*rows: dict, **same: object) -> pd.DataFrame:
    """A table of rows that share the columns ``same``."""
    return pd.DataFrame([same | row for row in rows])


def data(**tables: object) -> Callable[[str], Any]:
    """The function from a table's name to the table that a page's verdicts take."""
    return tables.get


def judge(verdict: Callable, table: str, *rows: dict) -> Any:
    """A page's verdict on a fabricated table with these rows."""
    return verdict({table: pd.DataFrame(rows)}.get)


def outcomes(verdicts: Iterable[Callable], tables: Mapping[str, list[dict]]) -> list[str]:
    """The outcomes of verdicts on fabricated tables, which are given by their rows."""
    return [verdict(lambda name: pd.DataFrame(tables[name])).outcome for verdict in verdicts]
