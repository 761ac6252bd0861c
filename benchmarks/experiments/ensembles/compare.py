"""Costs at equal error: between two rungs of a ladder that are at most `SPAN` apart in error, the cost by a power law.

Between rungs farther apart nothing is known: the cost is that of the rung that has the error.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.timing import NOWHERE, Median, cheaper

from .against import ERRORS, SPAN

OURS, HEYOKA = "ours", "heyoka"


def at(rungs: pd.DataFrame, error: float) -> Median:
    """What an orbit costs with this error, by one integrator's rows; `NOWHERE` where it does not get there."""
    ladder = rungs[rungs["error"].notna() & np.isfinite(rungs["error"])].sort_values("error")
    there, beyond = ladder[ladder["error"] <= error], ladder[ladder["error"] > error]
    if there.empty:
        return NOWHERE
    best = there.loc[there["us"].idxmin()]
    below = Median(best["us"], best["us, low"], best["us, high"])
    coarser = beyond[beyond["us"] < best["us"]]
    if coarser.empty or best["error"] == 0:
        return below
    above = coarser.iloc[0]
    if above["error"] / best["error"] >= SPAN:
        return below
    share = np.log(above["error"] / error) / np.log(above["error"] / best["error"])
    names = ("us", "us, low", "us, high")
    return Median(*(float(above[k] ** (1 - share) * best[k] ** share) for k in names))


def least(rows: pd.DataFrame, error: float) -> tuple[str, Median]:
    """The cheapest integrator of one side and its cost."""
    costs = {name: at(rungs, error) for name, rungs in rows.groupby("integrator", sort=False)}
    name = min(costs, key=lambda k: costs[k].value, default=None)
    return ("", NOWHERE) if name is None or costs[name] is NOWHERE else (name, costs[name])


def compared(frame: pd.DataFrame) -> pd.DataFrame:
    """A row for each problem and error: the cheapest of each side, the ratio of the costs, and whose is less."""
    rows = []
    for problem, part in frame.groupby("problem", sort=False):
        for error in ERRORS:
            (own, ours), (peer, heyoka) = (least(part[part["side"] == side], error) for side in (OURS, HEYOKA))
            ratio = ours.value / heyoka.value if heyoka is not NOWHERE and ours is not NOWHERE else np.nan
            row = {"problem": problem, "error": error, "ours": own, "us, ours": ours.value, "heyoka": peer}
            rows.append(row | {"us, heyoka": heyoka.value, "ours / heyoka": ratio, "cheaper": cheaper(ours, heyoka)})
    return pd.DataFrame(rows)
