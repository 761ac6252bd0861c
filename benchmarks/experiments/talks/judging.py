"""Judges: functions that decide from measured rows whether a statement holds, and give the number that shows it.

A judge takes ``data``, a function from a table's name to the table or None, and returns a `Judgement`.  If the rows
that it needs are missing, the verdict is `MISSING`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import pandas as pd

from phasebench.benchmarks.judge.evidence import GATE, NO_DEFECT
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, MISSING, UNTESTABLE, WHERE, Judgement, worst
from phasebench.benchmarks.page.markdown import number

from .checks_base import TABLE as CHECKS
from .record import TABLE as CURVES

if TYPE_CHECKING:
    from phasebench.benchmarks.page.page import Data

VERDICTS = (HOLDS, WHERE, CONTRADICTED, UNTESTABLE, MISSING)
#: An error in doubles of at most this counts as round-off.
ROUND_OFF = 1e-11
#: A printed entry is reproduced if the measured one is within this many units of its last digit.
REPRODUCED = 0.6
KEPT_TEXT = (
    f"A step map has a property up to a defect of {NO_DEFECT:g} (40 digits); an order is two-sided within {GATE}; "
    f"energy and invariants are kept up to {ROUND_OFF:g}; a printed entry is reproduced within {REPRODUCED} of its "
    "last digit."
)


Judge = Callable[[Callable], Judgement]
NOTHING = Judgement(MISSING, "")


def judgement(holds: bool, text: str) -> Judgement:
    """Return the `Judgement` that a statement holds or is contradicted, with the measured numbers as ``text``."""
    return Judgement(HOLDS if holds else CONTRADICTED, text)


def rows_of(data: Data, table: str, **values: Any) -> pd.DataFrame:
    """Select the rows of a table whose columns have the given ``values``; empty if the table was not measured.

    ``data`` maps a table's name to the table or None.  A list as value means that the column has one of its elements.
    """
    frame = data(table)
    if frame is None or any(column not in frame for column in values):
        return pd.DataFrame()
    for column, value in values.items():
        frame = frame[frame[column].isin(_listed(value))]
    return frame


def _listed(value: Any) -> Sequence[Any]:
    return value if isinstance(value, (list, tuple)) else [value]


def on_rows(table: str, **values: Any) -> Callable[[Callable[[pd.DataFrame], Judgement]], Judge]:
    """Decorator: turn a function rows -> `Judgement` into a judge, a function of all measured tables.

    The judge selects the rows of ``table`` whose columns have the given ``values``.  Its verdict is `MISSING` if there
    are none, or if one of the methods in ``values`` has none.
    """

    def decorate(function: Callable[[pd.DataFrame], Judgement]) -> Judge:
        @functools.wraps(function)
        def judge(data: Data) -> Judgement:
            rows = rows_of(data, table, **values)
            missing = set(_listed(values.get("method", []))) - set(rows.get("method", []))
            return NOTHING if rows.empty or missing else function(rows)

        return judge

    return decorate


def _plural(n: int, word: str) -> str:
    return f"{n} {word}{'s' if n != 1 else ''}"


def untestable(why: str) -> Judge:
    """Make a judge (a function of measured tables) that finds a statement not testable, for the reason ``why``."""
    return lambda data: Judgement(UNTESTABLE, why)


def check(id: str, bound: float, least: float | None = None) -> Judge:
    """Make a judge (a function of measured tables) of whether the number of a check is at most ``bound``.

    The check's control, the same number for a case that must fail, must be above ``least`` (default: the bound).
    """

    @on_rows(CHECKS, check=id)
    def judge(rows: pd.DataFrame) -> Judgement:
        r = rows.iloc[0]
        if r["value"] != r["value"]:
            return NOTHING
        text = f"{r['what']}: {number(r['value'], 2)}; {r['against']}: {number(r['control'], 2)}"
        return judgement(abs(r["value"]) <= bound and abs(r["control"]) > (bound if least is None else least), text)

    return judge


def order(labels: Sequence[str], wanted: int, problem: str = "") -> Judge:
    """Make a judge (a function of measured tables) of whether methods have the order ``wanted``, not more or less.

    ``labels`` are those of the methods.  Their orders are measured in multiprecision, on all systems, or on ``problem``
    alone if it is given.
    """

    @on_rows("multiprecision", method=list(labels), **({"problem": problem} if problem else {}))
    def judge(rows: pd.DataFrame) -> Judgement:
        orders = rows["order"]
        span = list(dict.fromkeys(f"{x:.3f}" for x in (orders.min(), orders.max())))
        text = f"order {' to '.join(span)} ({_plural(len(rows), 'measurement')})"
        return judgement(bool(((orders - wanted).abs() < GATE).all()), text)

    return judge


def has(labels: Sequence[str], what: str, wanted: bool = True) -> Judge:
    """Make a judge (a function of measured tables) of whether methods have a property (or lack it, if not ``wanted``).

    ``labels`` are those of the methods; ``what`` is "symplecticity" or "symmetry".
    """

    @on_rows("structure", method=list(labels), property=what)
    def judge(rows: pd.DataFrame) -> Judgement:
        largest = rows["defect"].max() if wanted else rows["defect"].min()
        word = "up to" if wanted else f"of {', '.join(labels)} at least"
        text = f"defect of {what} {word} {number(largest, 2)} ({_plural(len(rows), 'map')})"
        return judgement((largest <= NO_DEFECT) == wanted, text)

    return judge


def keeps_energy(ids: Sequence[str], problem: str = "henon-heiles") -> Judge:
    """Make a judge (a function of measured tables) of whether methods (``ids``) keep the energy of ``problem``."""

    @on_rows("matrix", method=list(ids), problem=problem)
    def judge(rows: pd.DataFrame) -> Judgement:
        if rows["energy"].isna().any():
            return NOTHING
        largest = rows["energy"].max()
        text = f"energy error on {problem} up to {number(largest, 2)} ({_plural(len(rows), 'method')})"
        return judgement(largest <= ROUND_OFF, text)

    return judge


def system(problem: str) -> Judge:
    """Make a judge (a function of measured tables) of whether a problem behaves as a Hamiltonian system.

    On it the implicit midpoint rule must be symplectic or, if that is not measured, have a small energy error.
    """

    def judge(data: Data) -> Judgement:
        rows = rows_of(data, "matrix", problem=problem)
        middle = rows[rows["method"] == "implicit-midpoint"] if len(rows) else rows
        if middle.empty:
            return NOTHING
        r = middle.iloc[0]
        ran = int(rows["energy"].notna().sum())
        text = f"{ran} methods run; midpoint: energy error {number(r['energy'], 2)}"
        if r["symplecticity"] == r["symplecticity"]:
            return judgement(r["symplecticity"] <= NO_DEFECT, f"{text}, defect {number(r['symplecticity'], 2)}")
        return judgement(r["energy"] < 1e-3, text)

    return judge


def printed_entries(scheme: str, wanted: int) -> Judge:
    """Make a judge (a function of measured tables) of whether the talk's printed errors of a scheme are reproduced.

    There must be ``wanted`` entries, each within `REPRODUCED` units of its last digit.
    """

    @on_rows("printed", scheme=scheme)
    def judge(rows: pd.DataFrame) -> Judgement:
        good = int((rows["units"] <= REPRODUCED).sum())
        orders = rows["order"].dropna()
        text = f"{good} of {len(rows)} entries within {REPRODUCED:g} of the last digit"
        text += f"; measured order {orders.iloc[-1]:.2f}" if len(orders) else ""
        return judgement(good == len(rows) == wanted, text)

    return judge


def curves(
    figure: str, column: str, bound: float, curve: Sequence[str] = (), panel: str = "", above: bool = False
) -> Judge:
    """Make a judge (a function of measured tables) of whether a column of a figure's curves stays below a bound.

    The largest value must be at most ``bound``; if ``above``, the smallest one must exceed it.  ``curve`` and ``panel``
    select some of the figure's curves.
    """

    def judge(data: Data) -> Judgement:
        rows = rows_of(data, CURVES, figure=figure)
        if column in rows:
            rows = rows.dropna(subset=[column])
        if panel and len(rows):
            rows = rows[rows["panel"].astype(str).str.endswith(panel)]
        if curve and len(rows):
            rows = rows[rows["curve"].isin(curve)]
        if rows.empty:
            return NOTHING
        value = rows[column].min() if above else rows[column].max()
        names = {
            "energy_error": "change of I" if figure.startswith("lotka") else "energy error",
            "largest": f"error of {panel or 'invariants'}",
        }
        whose = f"{panel or ', '.join(curve)}: " if column == "energy_error" and (panel or curve) else ""
        text = f"{whose}{names.get(column, column)} {'at least' if above else 'up to'} {number(value, 2)}"
        return judgement((value > bound) if above else (value <= bound), text)

    return judge


def completed_runs(figure: str, wanted: int) -> Judge:
    """Make a judge (a function of measured tables) of whether a figure has ``wanted`` or more runs, all completed."""

    @on_rows(CURVES, figure=figure)
    def judge(rows: pd.DataFrame) -> Judgement:
        good = int((rows["status"] == "ok").sum())
        return judgement(
            good == len(rows) >= wanted, f"{good} of {len(rows)} orbits to t = {number(rows['t_end'].max())}"
        )

    return judge


def every(*judges: Judge) -> Judge:
    """Make a judge (a function of measured tables) that returns the worst verdict of several, and all their numbers."""

    def judge(data: Data) -> Judgement:
        found = [j(data) for j in judges]
        verdict = worst(f.verdict for f in found)
        return NOTHING if verdict == MISSING else Judgement(verdict, "; ".join(f.measured for f in found))

    return judge


def where(inside: Judge, outside: Judge, condition: str) -> Judge:
    """Make a judge of whether a statement holds only under a condition, given as a text.

    That is so if the judge ``inside`` (with the condition) finds that it holds, and ``outside`` (without) that it is
    contradicted; otherwise the verdict is that of ``inside``.
    """

    def judge(data: Data) -> Judgement:
        a, b = inside(data), outside(data)
        if MISSING in (a.verdict, b.verdict):
            return NOTHING
        text = f"{a.measured}; else: {b.measured}"
        if a.verdict == HOLDS and b.verdict == CONTRADICTED:
            return Judgement(WHERE, f"{condition}: {text}")
        return Judgement(a.verdict, text)

    return judge
