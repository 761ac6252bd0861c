"""Which integrator for which accuracy: the cheapest of the rows, this project's and the peers'."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.timing import OPEN, OURS, PEERS, TIED, Median, cheaper
from phasebench.benchmarks.page.page import Data, once

from . import sweep
from .ladders import ACCURACIES, TABLE

#: Times that differ by less than this factor are a tie: they are of cells that were measured one after another.
TIE = 1.15
#: An adaptive peer that was run at this tolerance was run as tightly as it goes.
TIGHTEST = 1e-14


def of_all(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make a function of the rows of the sweep and the ladders one of ``data``; None where neither was measured."""

    @functools.wraps(function)
    def from_data(data: Data, *more):
        tables = tuple(t for t in (data("rows"), data(TABLE)) if t is not None and not t.empty)
        return function(_joined(tables), *more) if tables else None

    return from_data


_last: list = [(), None]


def _joined(tables: tuple[pd.DataFrame, ...]) -> pd.DataFrame:
    """The tables as one, the same object while they are the same: `once` asks for that."""
    if len(tables) != len(_last[0]) or any(a is not b for a, b in zip(tables, _last[0], strict=True)):
        _last[:] = tables, pd.concat(tables, ignore_index=True)
    return _last[1]


def long_rows(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows of long scenes that ended well, with an error of the end state and a time."""
    part = rows[(rows["purpose"] == sweep.DRIFT) & (rows["status"] == "ok")]
    for column in ("global_error", "global_error_time", "seconds"):
        if column not in part:
            return part.iloc[:0]
    at_end = part["global_error_time"] >= 0.999 * part["t_end"]
    return part[at_end & part["global_error"].notna() & part["seconds"].notna()]


def _cheapest(rows: pd.DataFrame) -> pd.Series | None:
    return None if rows.empty else rows.loc[rows["seconds"].idxmin()]


def might_win(members: pd.DataFrame, accuracy: float, ours: float) -> list[str]:
    """Adaptive peers of a scene that do not reach the accuracy at the tolerances that were measured, but might.

    They are those whose tightest run took less time than ``ours``: a tighter one was not measured.
    """
    if "tol" not in members:
        return []
    open_ = []
    for name, part in members[members["tol"].notna()].groupby("method", sort=False):
        tightest = part.loc[part["tol"].idxmin()]
        reached = (part["global_error"] <= accuracy).any()
        if not reached and tightest["tol"] > TIGHTEST and tightest["seconds"] < ours:
            open_.append(name)
    return open_


@once
def choices(rows: pd.DataFrame) -> pd.DataFrame:
    """A row for each long scene and accuracy: the cheapest of each side, their seconds, who is cheaper."""
    lines = []
    for scene, members in long_rows(rows).groupby("scene", sort=False):
        own = members["kind"] == sweep.KIND if "kind" in members else pd.Series(True, members.index)
        for accuracy in ACCURACIES:
            enough = members["global_error"] <= accuracy
            best = {OURS: _cheapest(members[own & enough]), PEERS: _cheapest(members[~own & enough])}
            seconds = {who: np.inf if row is None else float(row["seconds"]) for who, row in best.items()}
            line = {"scene": scene, "error up to": accuracy}
            for who, row in best.items():
                line |= {who: "none" if row is None else row["method"], f"{who} seconds": seconds[who]}
            who = cheaper(*(Median(x, x, x) for x in seconds.values()), TIE)
            undecided = might_win(members, accuracy, seconds[OURS]) if who in (OURS, TIED) else []
            lines.append(line | {"cheaper": OPEN if undecided else who})
    return pd.DataFrame(lines)


def frontier(rows: pd.DataFrame, most: int, error: str = "global_error") -> list[str]:
    """At most ``most`` methods of the rows that are the cheapest for some error, by for how many errors."""
    wins: dict[str, int] = {}
    for wanted in np.logspace(-13, -1, 25):
        enough = rows[rows[error] <= wanted]
        if len(enough):
            best = enough.loc[enough["seconds"].idxmin(), "method"]
            wins[best] = wins.get(best, 0) + 1
    return sorted(wins, key=lambda name: -wins[name])[:most]
