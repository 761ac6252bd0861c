"""`Page`: one question, answered from tables of measurements.

A page is a pure function of ``data``, name -> DataFrame (None if the table was not measured).  Each verdict is a
function of its own, so that tests can call it with tables for which it must change.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from .verdict import MISSING, Verdict, overall

#: The answer of a page without measurements.
NOTHING = "Not measured in this folder."
#: Table name -> table, None if it was not measured.
Data = Callable[[str], pd.DataFrame | None]

#: Largest numbers of lines of setting, of verdicts, and of rows in a table.
SETTING, VERDICTS, ROWS = 5, 5, 25
#: Largest numbers of words in an answer and in a claim.
ANSWER, CLAIM = 30, 15


@dataclass(frozen=True)
class Picture:
    """A figure of a page: its file in the folder of figures, a title, a caption."""

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


def of(*names: str | Callable[[Data], pd.DataFrame | None]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator: turn a function of the tables called ``names`` into a function of ``data``, a callable name -> table.

    A function of ``data`` that makes a table may stand in the place of a name.

    The new function returns None if one of these tables is missing or empty; its further arguments, such as a folder
    of figures, are passed on after the tables.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def from_data(data: Data, *more: Any) -> Any:
            tables = [name(data) if callable(name) else data(name) for name in names]
            return None if any(t is None or t.empty for t in tables) else function(*tables, *more)

        return from_data

    return decorate


def once(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator: cache the results of a function of a table (DataFrame), for the last table only.

    Several verdicts of a page share such results.  Further arguments of the function must be hashable.
    """
    last: list = [None]
    results: dict[tuple, Any] = {}

    @functools.wraps(function)
    def remembering(frame: pd.DataFrame, *more: Any) -> Any:
        if last[0] is not frame:
            last[0] = frame
            results.clear()
        if more not in results:
            results[more] = function(frame, *more)
        return results[more]

    return remembering


def _nothing(data: Data, *more: Any) -> None:
    return None


@dataclass(frozen=True)
class Page:
    """A page of the report; its functions are called with ``data``, a function: name of a table -> DataFrame or None.

    Attributes
    ----------
    id, question : its file name and its title
    tables : names of the tables that it reads; the page names those that are missing
    setting : H, initial data and method, in at most `SETTING` lines
    verdicts : functions data -> `Verdict`, or None if the rows do not decide; at most `VERDICTS`; none for a catalogue
    answer : data -> the page's answer in at most `ANSWER` words, understandable alone; shown on the entry page
    limits : sentences on what could invalidate the page's answer, and on the thresholds that its verdicts use
    command : the command that measures its tables
    figures : (data, folder of figures) -> pictures
    table : data -> `Table`
    whole : data -> a longer table, shown only on the HTML page, where a click unfolds it
    listed : True if the entry page lists it; otherwise another page links to it
    """

    id: str
    question: str
    tables: tuple[str, ...]
    setting: tuple[str, ...]
    answer: Callable[[Data], str | None]
    verdicts: tuple[Callable[[Data], Verdict | None], ...]
    limits: tuple[str, ...]
    command: str
    figures: Callable[[Data, Path], list[Picture] | None] = _nothing
    table: Callable[[Data], Table | None] = _nothing
    whole: Callable[[Data], pd.DataFrame | None] = _nothing
    listed: bool = True

    def judge(self, data: Data) -> list[Verdict]:
        """Return the page's verdicts, without those that the tables of ``data`` (name -> table) do not decide."""
        return [v for v in (verdict(data) for verdict in self.verdicts) if v is not None]


def conclusion(page: Page, data: Data, verdicts: list[Verdict] | None = None) -> tuple[str, str]:
    """Return (outcome, answer in words) of a page; the outcome is `MISSING` if its tables were not measured.

    ``data`` maps a table's name to the table; ``verdicts`` are those of the page if they are already computed.
    """
    answer = page.answer(data)
    if answer is None:
        return MISSING, NOTHING
    return overall(page.judge(data) if verdicts is None else verdicts), answer
