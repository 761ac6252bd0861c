"""What verdicts of several pages share: names of cases, orders beside declared ones, the growth of a spread."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd

from phasebench.integrators.driver import OK

from .verdict import Count


def case(row: pd.Series) -> str:
    """Return the text "method on problem" from a row with these two columns, to be used as a verdict's ``where``."""
    return f"{row['method']} on {row['problem']}"


def order_off(rows: pd.DataFrame) -> pd.Series:
    """|observed - declared order| of each method and problem, at the smallest step above round-off."""
    last = rows[rows["order"].notna()].sort_values("h").groupby(["method", "problem"]).head(1)
    return (last["order"] - last["declared"]).abs()


def growth(rows: pd.DataFrame) -> pd.Series:
    """The spread of a long run over that of its first tenth; infinite for a run that did not reach its end."""
    return (rows["all"] / rows["first"]).where(rows["status"] == OK, np.inf)


def worst(by: str, text: str) -> Callable[[pd.DataFrame], str]:
    """A verdict's ``where``: the format string ``text`` of the row in which the expression ``by`` is largest."""
    return lambda rows: text.format_map(rows.loc[rows.eval(by).idxmax()])


def most(by: str, text: str) -> Callable[[pd.DataFrame], str]:
    """As `worst`; "" if the expression is nowhere above 0."""
    return lambda rows: worst(by, text)(rows) if (rows.eval(by) > 0).any() else ""


def total(part: str, whole: str) -> Callable[[pd.DataFrame], Count]:
    """A count summed over the rows: the expression ``part`` of the column ``whole``."""
    return lambda rows: Count(int(rows.eval(part).sum()), int(rows[whole].sum()))
