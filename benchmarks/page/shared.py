"""The name of a case, which verdicts of several pages share."""

from __future__ import annotations

import pandas as pd


def case(row: pd.Series) -> str:
    """Return the text "method on problem" from a row with these two columns, to be used as a verdict's ``where``."""
    return f"{row['method']} on {row['problem']}"
