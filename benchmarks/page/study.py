"""`Study`: a question, the runs that answer it, its claims, figure and table, declared as data.

`Study.cells` are the measurements for the store, `Study.page` is the page of the report.  A table's rows are those that
its measuring function returns, each with the key of its cell.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from string import Formatter
from typing import Any

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.store.cells import POOL, Cell, ProblemKey, Rows, content, states
from phasebench.integrators.registry import BY_ID

from .markdown import join_list, number
from .page import ROWS, Data, Page, Picture, Table
from .verdict import EVERY, FAIL, FINDING, NONE, Condition, Count, Measured, Range, Verdict, measured_text

#: A query of a table, or a function that marks its rows; "" for all.
Query = str | Callable[[pd.DataFrame], pd.Series]
#: The name of a table, or a function of data that makes one of several.
Source = str | Callable[[Data], pd.DataFrame | None]
#: An expression of columns, or a function of the rows: a value for each row or group, or one measured value.
Value = str | Callable[[pd.DataFrame], Any]


# -- runs --------------------------------------------------------------------------------------------------------------


def over(**values: Sequence[object]) -> list[dict[str, object]]:
    """All combinations of the values, as keys of cells; those of the first name vary fastest."""
    return [dict(zip(values, point[::-1], strict=True)) for point in product(*reversed(values.values()))]


@dataclass(frozen=True)
class Runs:
    """A table: ``measure(**key)`` returns the rows, or the row, of a cell, for each of the ``keys``.

    Rows depend on what ``measure`` refers to and on further modules ``code``, on the key with all that its "method" and
    "problem" stand for, and on the methods, peers, problems and data ``needs``; a function of the key that returns all
    of these takes their place.  A user selects a cell by the ids of these, or by the ``names`` of its key.
    ``where`` and ``own`` are those of `Cell`, and so is ``dear``, a function of the key; a quick run measures the keys
    ``quick``.  With ``more`` tables the function ``measure`` returns a dict of the rows of each table.
    """

    table: str
    measure: Callable[..., Any]
    keys: Sequence[Mapping[str, object]]
    needs: Sequence[object] | Callable[..., Sequence[object]] = ()
    where: str = POOL
    own: bool = False
    dear: Callable[..., bool] = lambda **key: False
    quick: Sequence[Mapping[str, object]] = ()
    more: tuple[str, ...] = ()
    code: Sequence[str] = ()
    names: Callable[..., Sequence[str]] | None = None

    def cells(self, study: Study) -> list[Cell]:
        """The cells of the table."""
        return [self._cell(study, key) for key in self.keys]

    def _cell(self, study: Study, key: Mapping[str, object]) -> Cell:
        needs = list(self.needs(**key) if callable(self.needs) else (*self.needs, *_records(key)))
        function = f"{self.measure.__module__}:{self.measure.__qualname__}"
        made_of = content(self.table, tuple(key.items()), *needs, code=[function, *self.code])
        ids = {getattr(need, name, "") for need in needs for name in ("id", "package")}
        ids |= {str(key.get(k, "")) for k in ("package", "problem")}
        names = ({study.within} | (ids if self.names is None else {*self.names(**key)})) - {""}
        tables, quick, dear = (self.table, *self.more), key in self.quick, self.dear(**key)
        about = (tables, self.measure, tuple(key.items())), made_of, frozenset(names), self.where, self.own, quick, dear
        return Cell(study.id, tables, key, measured, *about)


def _records(key: Mapping[str, object]) -> list[object]:
    """What the method and the problem of a key stand for."""
    out: list[object] = [BY_ID[str(key["method"])]] if "method" in key else []
    if "problem" in key:
        name = str(key["problem"])
        out += [ProblemKey(name), states(name.partition(":")[0])]
    return out


def measured(tables: tuple[str, ...], measure: Callable[..., Any], key: tuple[tuple[str, object], ...]) -> Rows:
    """The rows of a cell by table, with what they lack of its key in front; it is called in the worker."""
    found = measure(**dict(key))
    by_table = found if len(tables) > 1 else {tables[0]: [found] if isinstance(found, Mapping) else found}
    return {t: [{k: v for k, v in key if k not in row} | row for row in rows] for t, rows in by_table.items()}


# -- numbers and claims ------------------------------------------------------------------------------------------------


def rows_of(data: Data, table: Source, rows: Query = "") -> pd.DataFrame | None:
    """The rows of a table that a query selects; None if there are none."""
    frame = table(data) if callable(table) else data(table)
    if frame is None or frame.empty:
        return None
    if rows:
        frame = frame.query(rows) if isinstance(rows, str) else frame[rows(frame)]
    return None if frame.empty else frame


def evaluate(frame: pd.DataFrame, value: Value, *beside: pd.DataFrame) -> Any:
    """A value of each row or group, or one value; None if there is none."""
    found = frame.eval(value) if isinstance(value, str) else value(frame, *beside)
    return None if isinstance(found, pd.Series) and found.empty else found


@dataclass(frozen=True)
class Number:
    """A number of an answer: the largest ``value`` of the ``rows`` of a table, or what ``take`` makes of the values."""

    table: Source
    value: Value
    rows: Query = ""
    take: Callable[[pd.Series], float] = pd.Series.max
    digits: int = 3

    def said(self, data: Data) -> str | None:
        """The number as text; None if nothing was measured."""
        frame = rows_of(data, self.table, self.rows)
        found = None if frame is None else evaluate(frame, self.value)
        if found is None:
            return None
        return number(float(self.take(found) if isinstance(found, pd.Series) else found), self.digits)


@dataclass(frozen=True)
class Claim:
    """A claim: every ``value`` of the ``rows`` is as expected; what is measured is the one farthest from that.

    Values that are true or false are counted.  A function may return one number, a `Count` or a `Range` itself.
    What is expected may be a function of the rows.
    ``where`` is a format string of the worst row, or a function of all rows; otherwise the worst row's method and
    problem.  Of wrong values that are counted the first ``names`` are named.
    Functions get the tables ``beside``, too.  ``span``: the smallest and the largest value are shown.
    ``fault``: a claim that does not hold shows a fault of this suite; `pytest benchmarks` checks these, and those that
    are ``checked``; if it is of the ``whole`` table, only in a run that measures all of that.
    """

    text: str
    table: Source
    value: Value
    expected: Condition | Callable[[pd.DataFrame], Condition] = EVERY
    rows: Query = ""
    unit: str | Callable[[pd.DataFrame], str] = ""
    where: str | Callable[..., str] | None = None
    names: int = 1
    beside: Sequence[Source] = ()
    span: bool = False
    fault: bool = False
    checked: bool = False
    whole: bool = False

    def __call__(self, data: Data) -> Verdict | None:
        """The verdict on the claim, or None if its rows were not measured."""
        frames = [rows_of(data, self.table, self.rows), *(rows_of(data, name) for name in self.beside)]
        if any(frame is None for frame in frames) or (found := evaluate(frames[0], self.value, *frames[1:])) is None:
            return None
        expected = self.expected(frames[0]) if callable(self.expected) else self.expected
        value, worst = self._worst(found, expected)
        unit = self.unit(frames[0]) if callable(self.unit) else self.unit
        where = self.where(*frames) if callable(self.where) else self._where(frames[0], worst)
        return Verdict(self.text, value, expected, unit, where, FAIL if self.fault else FINDING)

    def said(self, data: Data) -> Said | None:
        """What is measured as text; None if nothing was."""
        verdict = self(data)
        return None if verdict is None else Said(verdict)

    def _worst(self, found: pd.Series | Measured, expected: Condition) -> tuple[Measured, list]:
        """(What is measured, the labels of the worst value or of all that are wrong)."""
        if not isinstance(found, pd.Series):
            return (found if isinstance(found, (Count, Range)) else float(found)), []
        if found.dtype == bool:
            wrong = found[found] if expected is NONE else found[~found]
            return Count(int(found.sum()), len(found)), list(wrong.index)
        found = found.dropna()
        if found.empty:
            return np.nan, []
        low, high = expected.low, expected.high
        both = Range(float(found.min()), float(found.max()))
        if low == -np.inf or high == np.inf:
            worst = found.argmax() if low == -np.inf else found.argmin()
            return both if self.span else float(found.iloc[worst]), [found.index[worst]]
        return both, [(found - (low + high) / 2).abs().idxmax()]

    def _where(self, frame: pd.DataFrame, worst: list) -> str:
        shown = worst[:1] if self.names == 1 else worst
        named = [self._name(frame, label) if k < self.names else "" for k, label in enumerate(shown)]
        return join_list(named, self.names) if named else ""

    def _name(self, frame: pd.DataFrame, worst: Any) -> str:
        if worst not in frame.index:
            return str(worst)
        row = frame.loc[worst].to_dict()
        return (self.where or " on ".join(f"{{{k}}}" for k in ("method", "problem") if k in row)).format_map(row)


class Said(str):
    """What a verdict measured, as text; its attributes serve an answer, too: {name.of}, {name.high}, {name.where}."""

    def __new__(cls, verdict: Verdict) -> Said:
        """The text of a verdict."""
        out = super().__new__(cls, measured_text(verdict.measured))
        out.where = verdict.where
        for name in ("n", "of", "low", "high"):
            value = getattr(verdict.measured, name, None)
            setattr(out, name, value if name in ("n", "of") else number(value, 2))
        return out


# -- what is shown -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Curves:
    """A panel (one for each value of the column ``panel``) of log-log curves, one for each value of ``curve``.

    ``y`` is a column, or columns with the labels of their curves.  ``level`` is a dashed line: (data -> y, label).
    ``line`` is the style of all lines, by default another one for each curve.
    """

    table: Source
    x: str
    y: str | Mapping[str, str]
    xlabel: str
    ylabel: str
    curve: str = "method"
    panel: str = ""
    rows: Query = ""
    title: str = ""
    ticks: bool = False
    level: tuple[Callable[[Data], float | None], str] | None = None
    line: str = ""

    def panels(self, data: Data) -> list[tuple[str, list[tuple[str, pd.Series, pd.Series]]]]:
        """[(title of a panel, [(label, x, y) of a curve])]"""
        frame = rows_of(data, self.table, self.rows)
        if frame is None:
            return []
        parts = frame.groupby(self.panel, sort=False) if self.panel else [(self.title, frame)]
        return [(str(title), self._curves(part)) for title, part in parts]

    def _curves(self, part: pd.DataFrame) -> list[tuple[str, pd.Series, pd.Series]]:
        if isinstance(self.y, Mapping):
            return [(label, part[self.x], part.eval(column)) for column, label in self.y.items()]
        return [(str(name), rows[self.x], rows[self.y]) for name, rows in part.groupby(self.curve, sort=False)]

    def draw(self, axes: Any, title: str, curves: list[tuple[str, pd.Series, pd.Series]], data: Data) -> None:
        """Draw one of the panels into the ``axes``."""
        for k, (label, x, y) in enumerate(curves):
            axes.loglog(x, y, label=label, **style.curve(k) | ({"linestyle": self.line} if self.line else {}))
        if self.level is not None and (level := self.level[0](data)) is not None:
            axes.axhline(level, color="0.4", linestyle="--", label=self.level[1])
        axes.set(xlabel=self.xlabel, ylabel=self.ylabel, title=title)
        if self.ticks:
            steps = sorted({float(h) for _, x, _ in curves for h in x})
            axes.set_xticks(steps, [f"{h:g}" for h in steps])
            axes.tick_params(which="minor", labelbottom=False)
        axes.grid(color="0.93", linewidth=0.5)


def pictures(
    figure: Sequence[Curves], data: Data, folder: Path, file: str, title: str, caption: str, legend: int, height: float
) -> list[Picture] | None:
    """Draw all panels of curves side by side into a file of the folder; None if the rows of some are missing."""
    panels = [(curves, *panel) for curves in figure for panel in curves.panels(data)]
    if {id(curves) for curves, *_ in panels} != {id(curves) for curves in figure} or not panels:
        return None
    with style.settings():
        drawing, (row,) = style.panels(1, len(panels), height)
        for axes, (curves, name, drawn) in zip(row, panels, strict=True):
            curves.draw(axes, name, drawn, data)
        style.legend_above(drawing, row[0], legend)
    return [Picture(style.save(drawing, folder, file), title, caption)]


@dataclass(frozen=True)
class Shown:
    """The page's table: ``columns`` of the ``rows`` of a table, the first `ROWS`."""

    table: str
    columns: Sequence[str]
    caption: str
    rows: Query = ""

    def __call__(self, data: Data) -> Table | None:
        """The table; None without rows."""
        frame = rows_of(data, self.table, self.rows)
        return None if frame is None else Table(frame[list(self.columns)].head(ROWS), self.caption)


# -- the study ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Study:
    """A question with all that answers it.

    Attributes
    ----------
    id, question, setting, limits : those of `Page`; the module of a single study is named as its id
    place : pages of the report are in the order of these numbers
    runs : its tables
    claims : name -> claim, in the order of the page
    answer : a sentence with the {names} of claims and numbers, or a function of data
    numbers : name -> further number, claim or function of data, for the answer
    checks : name -> further claim that `pytest benchmarks` checks, which the page does not show
    figure, title, caption, legend, height : panels of curves, and the figure's title, caption, columns of its legend,
        height in inches; or a function that draws pictures
    shown, whole : the table that the page shows; the table that its HTML has in full, by default the first
    reads : names of tables of other studies that the page reads
    tables : names of all tables of the page, if they are others than those
    within : the study of which this one is a part, so that a selection of that one measures this one, too
    command : the command that measures its tables, by default `pytest benchmarks -k ID`
    listed : that of `Page`
    module : where it is found, so that its figure is drawn again when that changes
    """

    id: str
    place: float
    question: str
    answer: str | Callable[[Data], str | None]
    setting: Sequence[str]
    runs: Sequence[Runs]
    claims: Mapping[str, Claim]
    limits: Sequence[str]
    numbers: Mapping[str, Number | Claim | Callable[[Data], str | None]] = field(default_factory=dict)
    checks: Mapping[str, Claim] = field(default_factory=dict)
    figure: Sequence[Curves] | Callable[[Data, Path], list[Picture] | None] = ()
    title: str = ""
    caption: str = ""
    legend: int = 4
    height: float = 3.4
    shown: Callable[[Data], Table | None] | None = None
    whole: str | Callable[[Data], pd.DataFrame | None] = ""
    reads: Sequence[str] = ()
    tables: Sequence[str] = ()
    within: str = ""
    command: str = ""
    listed: bool = True
    module: str = ""

    def cells(self, quick: bool = False) -> list[Cell]:
        """All measurements; those of a quick run."""
        return [cell for runs in self.runs for cell in runs.cells(self) if cell.quick or not quick]

    @property
    def page(self) -> Page:
        """The study's page of the report."""
        own = (*(r.table for r in self.runs), *(table for r in self.runs for table in r.more))
        tables = self.tables or (*own, *self.reads)
        whole = self.whole or tables[0]
        return Page(
            id=self.id,
            question=self.question,
            tables=tuple(tables),
            setting=tuple(self.setting),
            answer=self._answer,
            verdicts=tuple(self.claims.values()),
            limits=tuple(self.limits),
            command=self.command or f"pytest benchmarks -k {self.id}",
            figures=self._draw,
            table=self.shown or (lambda data: None),
            whole=whole if callable(whole) else (lambda data: rows_of(data, whole)),
            listed=self.listed,
        )

    def _answer(self, data: Data) -> str | None:
        if callable(self.answer):
            return self.answer(data)
        names = {name.partition(".")[0] for _, name, _, _ in Formatter().parse(self.answer) if name}
        known = {**self.claims, **self.numbers}
        said = {}
        for name in sorted(names, key=lambda n: not isinstance(known[n], (Number, Claim))):  # functions need all rows
            of = known[name]
            said[name] = of.said(data) if isinstance(of, (Number, Claim)) else of(data)
            if said[name] is None:
                return None
        return self.answer.format_map(said)

    def _draw(self, data: Data, folder: Path) -> list[Picture] | None:
        if callable(self.figure):
            return self.figure(data, folder)
        more = (self.title, self.caption, self.legend, self.height)
        return pictures(self.figure, data, folder, f"{self.id}.png", *more)
