"""Numbers and statements printed by others, each compared with a measurement, and the table of the comparisons."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import pandas as pd

from .page import Data
from .verdict import FINDING, MISSING, PASS, Verdict


@dataclass(frozen=True)
class Quoted:
    """A printed number or statement that a measurement tests.

    Attributes
    ----------
    verdict : function of ``data`` (table's name -> table) that returns the `Verdict`, or None if the measurement is
        missing; its docstring is the claim in words
    printed : the number or the words that are printed
    why : why the measurement differs, or ""
    source : where it is printed
    """

    verdict: Callable[[Data], Verdict | None]
    printed: str
    why: str
    source: str


def lines(data: Data, quoted: Iterable[Quoted]) -> pd.DataFrame:
    """Return the table of printed statements: a row for each, also for one that was not measured.

    ``data`` maps a table's name to the table.  Columns: claim, printed (as printed), measured, outcome, why they
    differ, where (the case that is worst), source (where it is printed).
    """
    rows = []
    for one in quoted:
        found = one.verdict(data)
        told = found.row() if found is not None else {"claim": _claim(one), "measured": "", "outcome": MISSING}
        row = {"claim": told["claim"], "printed": one.printed, "measured": told["measured"], "outcome": told["outcome"]}
        row |= {"why they differ": one.why, "where": told.get("where it is worst", ""), "source": one.source}
        rows.append(row)
    return pd.DataFrame(rows)


def _claim(one: Quoted) -> str:
    return str(one.verdict.__doc__).strip().partition("\n")[0].rstrip(".")


def count(data: Data, quoted: Iterable[Quoted]) -> tuple[int, int, int] | None:
    """Return (number of statements judged, number that hold, number that do not hold); None if none is judged.

    ``data`` maps a table's name to the table, from which each statement of ``quoted`` is judged.
    """
    judged = [found.outcome for one in quoted if (found := one.verdict(data)) is not None and found.outcome != MISSING]
    return (len(judged), judged.count(PASS), judged.count(FINDING)) if judged else None
