"""What a figure is: an id, a title, the section of the report it stands in, and the function that draws it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Figure:
    """A figure of the report.

    Attributes
    ----------
    id, title, section : kebab-case id, one line, the report's section
    draw : quick -> (matplotlib figure, caption); every number of the caption is computed in drawing
    """

    id: str
    title: str
    section: str
    draw: Callable[[bool], tuple]
