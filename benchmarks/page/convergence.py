"""The verdict on whether methods converge with their declared orders, and the text that names the case of a row."""

from __future__ import annotations

import pandas as pd

from .verdict import FAIL, Verdict, at_most


def case(row: pd.Series) -> str:
    """Return a text that names a row's method and problem, "METHOD on PROBLEM", to be used as a verdict's ``where``."""
    return f"{row['method']} on {row['problem']}"


def declared_orders(rows: pd.DataFrame, claim: str, near: float) -> Verdict | None:
    """Judge whether measured orders are within ``near`` of the declared ones; ``claim`` is the verdict's sentence.

    The columns ``method``, ``problem``, ``h``, ``order`` and ``declared`` are used.  The measured order of a method on
    a problem is that at the smallest step whose error is above round-off: at smaller ones ``order`` is NaN.  None if no
    row has an order.
    """
    told = rows[rows["order"].notna()]
    if told.empty:
        return None
    last = told.sort_values("h").groupby(["method", "problem"]).head(1)
    off = (last["order"] - last["declared"]).abs()
    worst = case(last.loc[off.idxmax()])
    return Verdict(claim, float(off.max()), at_most(near), "from the declared order", where=worst, otherwise=FAIL)
