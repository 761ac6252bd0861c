"""Which integrator for which accuracy: the cheapest of the rows, this project's and the peers'."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.page.page import once

from . import sweep

#: Errors of the state at the end for which the cheapest is named.
ACCURACIES = (1e-3, 1e-6, 1e-9)
#: Times that differ by less than this factor are a tie.
TIE = 1.15
#: Peers whose seconds are those of many orbits at once, shared among them: one orbit cannot be had for that.
BATCHES = ("heyoka-batch",)
OURS, PEERS, TIED, OPEN, NONE = "ours", "peer", "tie", "not decided", "none"
#: An adaptive peer that was run at this tolerance was run as tightly as it goes.
TIGHTEST = 1e-14


def long_rows(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows of long scenes that ended well, with an error of the end state and a time."""
    part = rows[(rows["purpose"] == sweep.DRIFT) & (rows["status"] == "ok")]
    for column in ("global_error", "global_error_time", "seconds"):
        if column not in part:
            return part.iloc[:0]
    at_end = part["global_error_time"] >= 0.999 * part["t_end"]
    at_end &= ~part["method"].isin(BATCHES)
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


def judge(ours: float, peers: float) -> str:
    """Who is cheaper, by seconds (infinite for nobody)."""
    if np.isinf(ours) and np.isinf(peers):
        return NONE
    if max(ours, peers) <= TIE * min(ours, peers):
        return TIED
    return OURS if ours < peers else PEERS


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
            cheaper = judge(seconds[OURS], seconds[PEERS])
            undecided = might_win(members, accuracy, seconds[OURS]) if cheaper in (OURS, TIED) else []
            lines.append(line | {"cheaper": OPEN if undecided else cheaper})
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
