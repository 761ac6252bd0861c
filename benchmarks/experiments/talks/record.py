"""The record `Figure` of a talk's figure: id, title, section, and functions that measure its curves and draw it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pandas as pd

#: Name of the table that holds every curve of the talks' figures.
TABLE = "talk_curves"


@dataclass(frozen=True)
class Figure:
    """A figure of the talks, measured and drawn again.

    Attributes
    ----------
    id, title : its kebab-case name, and its title in one line
    section : the section of the talks, and the page of the report, to which it belongs
    measure : function quick -> rows, one for each curve (if ``quick``, of shorter runs); all integration happens
        here; None if the figure shows only formulae
    draw : function rows -> (matplotlib figure, caption); every number of the caption comes from the rows
    """

    id: str
    title: str
    section: str
    measure: Callable[[bool], list[dict[str, Any]]] | None
    draw: Callable[[pd.DataFrame], tuple]

    def rows(self, quick: bool = False) -> list[dict[str, Any]]:
        """Measure the figure's curves, if ``quick`` with shorter runs: a row for each, with the figure's id."""
        return [{"figure": self.id} | row for row in self.measure(quick)]
