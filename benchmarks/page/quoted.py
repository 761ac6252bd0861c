"""What others print, beside what is measured here: a record for each statement, and the table of all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import pandas as pd

from .page import Data
from .verdict import FINDING, MISSING, PASS, Verdict


@dataclass(frozen=True)
class Quoted:
    """A printed number or statement: its verdict, the words, why the measurement differs, and where it is printed."""

    verdict: Callable[[Data], Verdict | None]
    printed: str
    why: str
    source: str


def lines(data: Data, quoted: Iterable[Quoted]) -> pd.DataFrame:
    """A row for each statement, whether it is measured or not."""
    rows = []
    for one in quoted:
        found = one.verdict(data)
        told = found.row() if found is not None else {"claim": _claim(one), "measured": "", "outcome": MISSING}
        row = {"claim": told["claim"], "printed": one.printed, "measured": told["measured"], "outcome": told["outcome"]}
        row |= {"why they differ": one.why, "where": told.get("where it is worst", ""), "source": one.source}
        rows.append(row)
    return pd.DataFrame(rows)


def _claim(one: Quoted) -> str:
    return str(one.verdict.__doc__).strip().rstrip(".")


def count(data: Data, quoted: Iterable[Quoted]) -> tuple[int, int, int] | None:
    """(how many statements are judged, hold, do not hold); None if none is judged."""
    judged = [found.outcome for one in quoted if (found := one.verdict(data)) is not None and found.outcome != MISSING]
    return (len(judged), judged.count(PASS), judged.count(FINDING)) if judged else None
