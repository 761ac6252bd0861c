"""Pieces of verdicts that several pages share: a case's name, declared orders, the growth of an energy's spread."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.integrators.driver import OK

from .verdict import FAIL, Verdict, at_most


def case(row: pd.Series) -> str:
    """Return the text "method on problem" from a row with these two columns, to be used as a verdict's ``where``."""
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
    """Return, for each run, the ratio of the energy's spread over all steps to its spread over their first tenth.

    ``rows`` has a row for each run, with the two spreads as columns ``all`` and ``first``, and ``status``.  The ratio
    is infinite for a run that did not reach its end.
    """
    return (rows["all"] / rows["first"]).where(rows["status"] == OK, np.inf)
