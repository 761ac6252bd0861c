"""Judges: functions of rows that say whether a statement holds, with the number that says so.

A judge takes ``data``, name -> table or None, and returns a `Judgement`.  Where its rows are missing the statement is
not measured.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import pandas as pd

from phasebench.benchmarks.experiments.orders.page import GATE
from phasebench.benchmarks.page.markdown import number

from .checks_base import TABLE as CHECKS
from .record import TABLE as CURVES

HOLDS, WHERE, CONTRADICTED, UNTESTABLE, MISSING = (
    "holds",
    "holds where",
    "contradicted",
    "not testable",
    "not measured",
)
VERDICTS = (HOLDS, WHERE, CONTRADICTED, UNTESTABLE, MISSING)
#: A defect up to this, measured with 40 digits, is round-off; an error up to this in doubles.
TINY, ROUND_OFF = 1e-25, 1e-11
#: A printed entry within so many units of its last digit is reproduced.
REPRODUCED = 0.6
KEPT_TEXT = (
    f"A step map has a property up to a defect of {TINY:g} (40 digits); an order is two-sided within {GATE}; energy "
    f"and invariants are kept up to {ROUND_OFF:g}; a printed entry is reproduced within {REPRODUCED} of its last digit."
)


class Judgement(NamedTuple):
    """What the rows say of a statement: a verdict, and the number that was measured with what it is of."""

    verdict: str
    measured: str


Judge = Callable[[Callable], Judgement]
NOTHING = Judgement(MISSING, "")


def said(holds: bool, text: str) -> Judgement:
    """Holds or contradicted, with the number."""
    return Judgement(HOLDS if holds else CONTRADICTED, text)


def rows_of(data, table: str, **values) -> pd.DataFrame:
    """The rows of a table with these values in its columns (a list: one of them); empty where it was not measured."""
    frame = data(table)
    if frame is None or any(column not in frame for column in values):
        return pd.DataFrame()
    for column, value in values.items():
        frame = frame[frame[column].isin(value if isinstance(value, (list, tuple)) else [value])]
    return frame


def _plural(n: int, word: str) -> str:
    return f"{n} {word}{'s' if n != 1 else ''}"


def untestable(why: str) -> Judge:
    """No number can tell."""
    return lambda data: Judgement(UNTESTABLE, why)


def check(id: str, bound: float, least: float | None = None) -> Judge:
    """The check's number is at most ``bound``, and its control is above ``least`` (at first the bound)."""

    def judge(data):
        rows = rows_of(data, CHECKS, check=id)
        if rows.empty:
            return NOTHING
        r = rows.iloc[0]
        if r["value"] != r["value"]:
            return NOTHING
        text = f"{r['what']}: {number(r['value'], 2)}; {r['against']}: {number(r['control'], 2)}"
        return said(abs(r["value"]) <= bound and abs(r["control"]) > (bound if least is None else least), text)

    return judge


def order(labels: Sequence[str], wanted: int, problem: str = "") -> Judge:
    """The order of these methods without round-off is the wanted one, two-sided, on every system or on one."""

    def judge(data):
        rows = rows_of(data, "multiprecision", method=list(labels), **({"problem": problem} if problem else {}))
        if rows.empty:
            return NOTHING
        orders = rows["order"]
        span = list(dict.fromkeys(f"{x:.3f}" for x in (orders.min(), orders.max())))
        text = f"order {' to '.join(span)} ({_plural(len(rows), 'measurement')})"
        return said(bool(((orders - wanted).abs() < GATE).all()), text)

    return judge


def has(labels: Sequence[str], what: str, wanted: bool = True) -> Judge:
    """The step maps of these methods are symplectic ("symplecticity") or symmetric ("symmetry"), or are not."""

    def judge(data):
        rows = rows_of(data, "structure", method=list(labels), property=what)
        if rows.empty:
            return NOTHING
        worst = rows["defect"].max() if wanted else rows["defect"].min()
        word = "up to" if wanted else f"of {', '.join(labels)} at least"
        text = f"defect of {what} {word} {number(worst, 2)} ({_plural(len(rows), 'map')})"
        return said((worst <= TINY) == wanted, text)

    return judge


def keeps_energy(ids: Sequence[str], problem: str = "henon-heiles") -> Judge:
    """These methods keep the energy of a problem to round-off."""

    def judge(data):
        rows = rows_of(data, "matrix", method=list(ids), problem=problem)
        if len(rows) < len(ids) or rows["energy"].isna().any():
            return NOTHING
        worst = rows["energy"].max()
        return said(
            worst <= ROUND_OFF, f"energy error on {problem} up to {number(worst, 2)} ({_plural(len(rows), 'method')})"
        )

    return judge


def system(problem: str) -> Judge:
    """A problem is integrated: the implicit midpoint rule keeps its structure, or its energy error is bounded."""

    def judge(data):
        rows = rows_of(data, "matrix", problem=problem)
        middle = rows[rows["method"] == "implicit-midpoint"] if len(rows) else rows
        if middle.empty:
            return NOTHING
        r = middle.iloc[0]
        ran = int(rows["energy"].notna().sum())
        text = f"{ran} methods run; midpoint: energy error {number(r['energy'], 2)}"
        if r["symplecticity"] == r["symplecticity"]:
            return said(r["symplecticity"] <= TINY, f"{text}, defect {number(r['symplecticity'], 2)}")
        return said(r["energy"] < 1e-3, text)

    return judge


def printed(scheme: str, wanted: int) -> Judge:
    """The printed entries of a scheme are reproduced."""

    def judge(data):
        rows = rows_of(data, "printed", scheme=scheme)
        if rows.empty:
            return NOTHING
        good = int((rows["units"] <= REPRODUCED).sum())
        orders = rows["order"].dropna()
        text = f"{good} of {len(rows)} entries within {REPRODUCED:g} of the last digit"
        text += f"; measured order {orders.iloc[-1]:.2f}" if len(orders) else ""
        return said(good == len(rows) == wanted, text)

    return judge


def curves(figure: str, column: str, bound: float, curve: Sequence[str] = (), panel: str = "", above=False) -> Judge:
    """The largest number in a column of a figure's curves is up to a bound (``above``: the least is beyond it)."""

    def judge(data):
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
        return said((value > bound) if above else (value <= bound), text)

    return judge


def ended(figure: str, wanted: int) -> Judge:
    """Every run of a figure came to its end."""

    def judge(data):
        rows = rows_of(data, CURVES, figure=figure)
        if rows.empty:
            return NOTHING
        good = int((rows["status"] == "ok").sum())
        return said(good == len(rows) >= wanted, f"{good} of {len(rows)} orbits to t = {number(rows['t_end'].max())}")

    return judge


_WORST = (MISSING, CONTRADICTED, UNTESTABLE, WHERE, HOLDS)


def every(*judges: Judge) -> Judge:
    """All of them: the worst verdict, with what each says."""

    def judge(data):
        found = [j(data) for j in judges]
        worst = min((f.verdict for f in found), key=_WORST.index)
        return NOTHING if worst == MISSING else Judgement(worst, "; ".join(f.measured for f in found))

    return judge


def where(inside: Judge, outside: Judge, condition: str) -> Judge:
    """Holds where a condition is met: ``inside`` holds, ``outside`` does not."""

    def judge(data):
        a, b = inside(data), outside(data)
        if MISSING in (a.verdict, b.verdict):
            return NOTHING
        text = f"{a.measured}; else: {b.measured}"
        if a.verdict == HOLDS and b.verdict == CONTRADICTED:
            return Judgement(WHERE, f"{condition}: {text}")
        return Judgement(a.verdict, text)

    return judge
