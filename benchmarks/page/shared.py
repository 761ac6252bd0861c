"""Pieces of verdicts that several pages share: a case's name, declared orders, the growth of an energy's spread."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.integrators.driver import OK

from .verdict import FAIL, Verdict, at_most


def case(row: pd.Series) -> str:
    """Return the case that a row of a method on a problem is of, as a verdict's ``where`` names it."""
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


def growth(rows: pd.DataFrame) -> pd.Series:
    """Return how many times the spread of the energy over all steps is that over the first tenth of them, for each row.

    The columns ``all``, ``first`` and ``status`` are used; of a run that did not reach its end it is infinite.
    """
    return (rows["all"] / rows["first"]).where(rows["status"] == OK, np.inf)
