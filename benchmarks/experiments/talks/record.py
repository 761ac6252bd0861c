"""What a figure is: an id, a title, the section it stands in, what measures its curves and what draws them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pandas as pd

#: The table of every curve of the talks' figures.
TABLE = "talk_curves"


@dataclass(frozen=True)
class Figure:
    """A figure of the talks.

    Attributes
    ----------
    id, title, section : kebab-case id, one line, the page it stands on
    measure : quick -> the rows of its curves; the only place where anything is integrated; None where the
        figure shows formulae alone
    draw : rows -> (matplotlib figure, caption); every number of the caption is of the rows
    """

    id: str
    title: str
    section: str
    measure: Callable[[bool], list[dict[str, Any]]] | None
    draw: Callable[[pd.DataFrame], tuple]

    def rows(self, quick: bool = False) -> list[dict[str, Any]]:
        """The measured rows, each with the figure's id."""
        return [{"figure": self.id} | row for row in self.measure(quick)]
