"""What several pages share: values of verdicts and the places where they are worst, and what makes pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.integrators.driver import OK

from .page import Data, Picture, of
from .verdict import Count

#: What makes the pictures of a page: (data, folder) -> pictures; what draws one of rows; a table, by name or made.
Pictures = Callable[[Data, Path], list[Picture] | None]
Draw = Callable[..., "style.Figure | tuple[style.Figure, str] | None"]
Source = str | Callable[[Data], pd.DataFrame | None]


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


def picture(
    tables: Source | tuple[Source, ...], file: str, title: str, caption: str = ""
) -> Callable[[Draw], Pictures]:
    """Decorator: turn a function that draws a figure of the rows of tables into one of (data, folder), for a `Study`.

    It returns the figure, or (figure, caption) where the caption depends on the rows, or None for no picture.
    """

    def decorate(draw: Draw) -> Pictures:
        @of(*(tables if isinstance(tables, tuple) else (tables,)))
        @style.styled
        def pictures(*given: Any) -> list[Picture] | None:
            *rows, folder = given
            if (drawn := draw(*rows)) is None:
                return None
            figure, words = drawn if isinstance(drawn, tuple) else (drawn, caption)
            return [Picture(style.save(figure, folder, f"{file}.png"), title, words)]

        return pictures

    return decorate


def together(*figures: Pictures) -> Pictures:
    """All pictures of several such functions."""
    return lambda data, folder: [picture for draw in figures for picture in draw(data, folder) or ()]
