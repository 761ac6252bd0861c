"""From tables of runs: the fastest integrator of a scene at an accuracy, ours or a peer, and costs at equal error."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.timing import NONE, NOWHERE, OURS, PEERS, TIED, Median

from .bracket import share

#: Two sides are tied if the interval of their ratio, widened by this factor, contains 1.
TIE = 1.05
#: The cost is not interpolated between rungs whose errors differ by this factor or more.
SPAN = 100.0
COST = ("us", "us, low", "us, high")


def cheaper(row: dict) -> str:
    """The faster side at an accuracy: `OURS`, `PEERS`, `TIED`, or `NONE`; a side that alone reaches it is faster."""
    there = {side: isinstance(row.get(f"{side} integrator"), str) for side in (OURS, PEERS)}
    if not all(there.values()):
        return next((side for side, is_ in there.items() if is_), NONE)
    if row["ratio high"] * TIE < 1:
        return OURS
    return PEERS if row["ratio low"] > TIE else TIED


def choices(front: pd.DataFrame) -> pd.DataFrame:
    """The table of fastest integrators, a row for each scene and accuracy, with the faster side in ``cheaper``."""
    columns = [f"{side} {x}" for side in (OURS, PEERS) for x in ("integrator", "seconds")]
    columns += ["ratio", "ratio low", "ratio high"]
    whole = front.reindex(columns=[*front.columns, *(c for c in columns if c not in front)])
    return whole.assign(cheaper=[cheaper(r) for r in whole.to_dict("records")])


def winner(row: dict) -> str:
    """The fastest integrator in a row, in a tie that of the smaller median; "" if none reaches the accuracy."""
    sides = [s for s in (OURS, PEERS) if isinstance(row[f"{s} integrator"], str)]
    return row[f"{min(sides, key=lambda s: row[f'{s} seconds'])} integrator"] if sides else ""


def at(rungs: pd.DataFrame, error: float) -> Median:
    """The cost (microseconds, with interval) at which one integrator meets an error; `NOWHERE` if it never does.

    It is interpolated as a power of the error between two runs whose errors differ by less than the factor `SPAN`;
    otherwise it is the cost of the finer run.
    """
    ladder = rungs[np.isfinite(rungs["error"])].sort_values("error")
    there, beyond = ladder[ladder["error"] <= error], ladder[ladder["error"] > error]
    if there.empty:
        return NOWHERE
    best = there.loc[there["us"].idxmin()]
    coarser = beyond[beyond["us"] < best["us"]]
    if coarser.empty or best["error"] == 0 or coarser.iloc[0]["error"] / best["error"] >= SPAN:
        return Median(*(best[k] for k in COST))
    above = coarser.iloc[0]
    part = share(above["error"], best["error"], error)
    return Median(*(float(above[k] ** (1 - part) * best[k] ** part) for k in COST))
