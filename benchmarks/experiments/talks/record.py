"""The record `Figure` of a talk's figure: id, title, section, and the functions that measure and draw it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pandas as pd

#: Name of the table that holds every curve of the talks' figures.
TABLE = "talk_curves"


@dataclass(frozen=True)
class Figure:
    """A figure of the talks.

    Attributes
    ----------
    id, title, section : kebab-case id, one line, the page it stands on
    measure : quick -> the rows of its curves; all integration happens here; None if the figure shows only
        formulae
    draw : rows -> (matplotlib figure, caption); every number of the caption comes from the rows
    """

    id: str
    title: str
    section: str
    measure: Callable[[bool], list[dict[str, Any]]] | None
    draw: Callable[[pd.DataFrame], tuple]

    def rows(self, quick: bool = False) -> list[dict[str, Any]]:
        """The measured rows, each with the figure's id."""
        return [{"figure": self.id} | row for row in self.measure(quick)]
