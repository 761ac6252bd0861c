"""What a page is: one question, answered from tables.

Everything that a page says is a function of ``data``, name -> DataFrame (or None where that table was not measured).
A sentence of verdict is a function of its own, so that it can be tested with tables for which it must change.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

#: name -> table, None where it was not measured.
Data = Callable[[str], pd.DataFrame | None]

PASS, FINDING, MISSING = "PASS", "FINDING", "not measured"
#: A page has at most so many lines of setting, sentences of verdict and rows in a table.
SETTING, VERDICTS, ROWS = 5, 5, 25


@dataclass(frozen=True)
class Verdict:
    """A sentence computed from rows.

    Attributes
    ----------
    text : the sentence
    holds : whether what was expected is so; else it is a finding
    short : what the entry page says of it, one short sentence
    """

    text: str
    holds: bool
    short: str


@dataclass(frozen=True)
class Picture:
    """A figure: its file in the folder of figures, a title, a caption."""

    file: str
    title: str
    caption: str


@dataclass(frozen=True)
class Table:
    """A table of at most `ROWS` rows.

    Attributes
    ----------
    frame : what is shown
    caption : what its rows are, how they were chosen
    digits : significant digits of its numbers
    """

    frame: pd.DataFrame
    caption: str
    digits: int = 3


def of(*names: str):
    """Make a function of these tables one of ``data``, which gives None where one of them is missing or empty.

    What else it is called with (a folder of figures) follows the tables.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def from_data(data: Data, *more):
            tables = [data(name) for name in names]
            return None if any(t is None or t.empty for t in tables) else function(*tables, *more)

        return from_data

    return decorate


def once(function: Callable[[pd.DataFrame], Any]) -> Callable[[pd.DataFrame], Any]:
    """Make a function of a table remember its last one: what several sentences of a page need is computed once."""
    last: list = [None, None]

    @functools.wraps(function)
    def remembering(frame: pd.DataFrame):
        if last[0] is not frame:
            last[:] = frame, function(frame)
        return last[1]

    return remembering


def _nothing(data: Data, *more) -> None:
    return None


@dataclass(frozen=True)
class Page:
    """A page of the report.

    Attributes
    ----------
    id, question : its file name and its title
    tables : the tables that it is written from; the page says so where one is missing
    setting : H, initial data and method, in at most `SETTING` lines
    verdicts : data -> `Verdict`, or None where the rows say nothing; at most `VERDICTS`
    limits : what could invalidate it, with the thresholds that it uses
    command : what makes its tables
    figures : (data, folder of figures) -> pictures
    table : data -> `Table`
    whole : data -> a table of more rows, folded on the HTML page
    listed : whether the entry has a line for it; else another page links to it
    """

    id: str
    question: str
    tables: tuple[str, ...]
    setting: tuple[str, ...]
    verdicts: tuple[Callable[[Data], Verdict | None], ...]
    limits: tuple[str, ...]
    command: str
    figures: Callable[[Data, Path], list[Picture] | None] = _nothing
    table: Callable[[Data], Table | None] = _nothing
    whole: Callable[[Data], pd.DataFrame | None] = _nothing
    listed: bool = True

    def judged(self, data: Data) -> list[Verdict]:
        """The verdicts on the tables that were measured."""
        return [v for v in (verdict(data) for verdict in self.verdicts) if v is not None]


def outcome(verdicts: list[Verdict]) -> tuple[str, str]:
    """(PASS, FINDING or not measured; the short sentence) of a page's verdicts: the first finding comes first."""
    if not verdicts:
        return MISSING, "Not measured in this folder, or no row tells."
    first = next((v for v in verdicts if not v.holds), verdicts[0])
    return (PASS if all(v.holds for v in verdicts) else FINDING), first.short
