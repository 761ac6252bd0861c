r"""Reasons why this project's best method takes longer than the best peer, computed from measured steps and times.

A peer is another package's integrator; a case is a scene (problem, end time, quantity) at an accuracy.

On either side, the time t is the number of steps n times the time of a step (primes mark the peer):

.. math:: \frac{t}{t'} = \frac{n}{n'} \cdot \frac{t/n}{t'/n'} .

The evaluations in a step of this project's method are counted (of grad V if H is separable, else of grad H).  Their
number times the least time per evaluation of any method of this project on the scene is a share of the step's time.
The rest is a lower bound for everything else in a step (sums, equation solving, evaluations that are not vectorized).
Not all peers count their evaluations.
"""

from __future__ import annotations

from math import inf, nan

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.integrator import OURS as PROJECT
from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import of

from .front import RUNGS
from .joined import joined

#: Largest ratio wanted of our time to the best peer's; factors up to `ALIKE` count as 1.
WANTED, ALIKE = 1.0, 1.1
#: Reasons why the ratio of a cell is above `WANTED`.
UNREACHED, WITHIN, REST, MORE, DEARER, BOTH = (
    "not reached",
    "within the interval",
    "beside evaluations",
    "more steps",
    "dearer steps",
    "more and dearer steps",
)
#: Reason -> its meaning.
MEANING = {
    UNREACHED: "a peer alone gets there",
    WITHIN: f"the ratio's interval holds {WANTED:.1f}",
    REST: "for its evaluations alone ours would not take longer",
    MORE: "not dearer ones",
    DEARER: "not more of them",
    BOTH: "ours takes more, and each longer",
}


@of(joined)
def cases(found: pd.DataFrame) -> pd.DataFrame:
    """The cases in which a method of ours or a peer reaches the accuracy.

    The column ``ratio`` is our time over the best peer's; it is 0 if only a method of ours reaches the accuracy, inf if
    only a peer does.
    """
    ours, peer = (found[f"{side} integrator"].notna() for side in (OURS, PEERS))
    alone = np.select([ours & ~peer, peer & ~ours], [0.0, inf], nan)
    told = found.assign(**{c: found[c].where(ours & peer, alone) for c in ("ratio", "ratio low", "ratio high")})
    return told[ours | peer].reset_index(drop=True)


@of(cases, RUNGS)
def above(told: pd.DataFrame, rungs: pd.DataFrame) -> pd.DataFrame:
    """The cases whose ratio of times is above `WANTED`, the largest first, with its factors and the reason.

    Added columns: ``steps`` and ``step``, the two factors of the ratio; ``per step``, evaluations in a step of our
    method; ``share``, the share of its time that they take at the scene's `price`; ``evaluations alone``, the ratio
    times that share; ``until``, the last coarser accuracy at which the ratio is at most `WANTED`; ``ours grew``,
    ``peer grew``, each side's number of steps over that at the accuracy ``until``; ``reason``, a key of `MEANING` or
    None.
    """
    rows = []
    prices = {scene: price(part) for scene, part in rungs.groupby("scene", sort=False)}
    for scene, part in told.groupby("scene", sort=False):
        for row in part[~(part["ratio"] <= WANTED)].to_dict("records"):
            parts = _parts(row, prices.get(scene, nan)) | _growth(row, part)
            rows.append(row | parts | {"reason": _reason(row, parts)})
    columns = [*told.columns, "steps", "step", "per step", "share", "evaluations alone", "until", "ours grew"]
    out = pd.DataFrame(rows, columns=[*columns, "peer grew", "reason"])
    return out.sort_values("ratio", ascending=False, kind="stable").reset_index(drop=True)


def price(rungs: pd.DataFrame) -> float:
    """The least seconds per gradient evaluation of this project's methods in the runs; NaN without runs."""
    own = rungs[(rungs["kind"] == PROJECT) & (rungs["evaluations"] > 0) & (rungs["seconds"] > 0)]
    return float((own["seconds"] / own["evaluations"]).min()) if len(own) else nan


def _parts(row: dict, cheapest: float) -> dict[str, float]:
    """The factors of a case's ratio, and the share of evaluations at the ``cheapest`` price: columns of `above`."""
    n, m = (row[f"{side} steps"] for side in (OURS, PEERS))
    steps = n / m if m else nan
    evaluations = row[f"{OURS} evaluations"]
    share = min(1.0, evaluations * cheapest / row[f"{OURS} seconds"])
    out = {"steps": steps, "step": row["ratio"] / steps, "per step": evaluations / n if n else nan}
    return out | {"share": share, "evaluations alone": row["ratio"] * share}


def _growth(row: dict, scene: pd.DataFrame) -> dict[str, float]:
    """How both sides' steps grew from the last coarser accuracy at which ours was fast enough: columns of `above`."""
    before = scene[(scene["accuracy"] > row["accuracy"]) & (scene["ratio"] <= WANTED)]
    if before.empty:
        return {"until": nan, "ours grew": nan, "peer grew": nan}
    last = before.loc[before["accuracy"].idxmin()]
    grown = {f"{side} grew": row[f"{side} steps"] / last[f"{side} steps"] for side in (OURS, PEERS)}
    return {"until": last["accuracy"]} | grown


def _reason(row: dict, parts: dict[str, float]) -> str | None:
    """Why the ratio of a case is above `WANTED`, a key of `MEANING`; None if numbers of steps are not known."""
    if row["ratio"] == inf:
        return UNREACHED
    if row["ratio low"] <= WANTED:
        return WITHIN
    if parts["evaluations alone"] <= WANTED:
        return REST
    if not parts["steps"] > 0:
        return None
    more, dearer = parts["steps"] > ALIKE, parts["step"] > ALIKE
    return BOTH if more == dearer else MORE if more else DEARER


def sentence(row: dict, rungs: pd.DataFrame) -> str:
    """Why this project is slower in a case, a row of `above`, in words with the measured numbers."""
    if row["reason"] == UNREACHED:
        return f"{UNREACHED}: {_nearest(row, rungs)}"
    text = f"{row['reason'] or 'not told'}: steps x {number(row['steps'], 2)}, a step's time x {number(row['step'], 2)}"
    text += f"; evaluations {100 * row['share']:.0f} %" if row["share"] == row["share"] else ""
    if row["ours grew"] == row["ours grew"]:
        grew = f"{number(row['ours grew'], 2)} and {number(row['peer grew'], 2)}"
        text += f"; steps since {row['until']:.0e} x {grew}"
    return text


def _nearest(row: dict, rungs: pd.DataFrame) -> str:
    """The least error of this project's methods on the scene of a case, in words."""
    own = rungs[(rungs["scene"] == row["scene"]) & (rungs["kind"] == PROJECT) & (rungs["error"] > 0)]
    if own.empty:
        return "no run of ours is kept"
    best = own.loc[own["error"].idxmin()]
    return f"ours end at {number(float(best['error']), 2)} ({best['integrator']})"
