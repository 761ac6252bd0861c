"""Costs at equal error, with intervals, from a data frame with a row for each run.

Its columns are ``error``, ``us`` (the cost in microseconds), and ``us, low`` and ``us, high``, the ends of the cost's
interval.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.timing import NOWHERE, Median

from .bracket import share

#: The cost is not interpolated between rungs whose errors differ by this factor or more.
SPAN = 100.0
COST = ("us", "us, low", "us, high")


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
