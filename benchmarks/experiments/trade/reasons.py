r"""Why a method of this project takes longer than the best peer at an accuracy: functions of the trade's tables.

A time is a number of steps times what a step takes, on either side:

.. math:: \frac{t}{t'} = \frac{n}{n'} \cdot \frac{t/n}{t'/n'} .

A step of ours makes evaluations (of the gradient of V where H is separated, else of the whole), which are counted.  At
the price of the cheapest evaluation that any method of this project makes on the scene they are a share of its time;
the rest is what a step does besides (sums, solving, evaluations that are not in lanes), and at least so much.
Peers do not all count theirs.
"""

from __future__ import annotations

from math import inf, nan

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.integrator import OURS as PROJECT
from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.page.markdown import number

from .choice import choices

#: No more than so many times the best peer's time is wanted; factors of a ratio up to `ALIKE` are called the same.
WANTED, ALIKE = 1.0, 1.1
#: Why a cell is above it.
UNREACHED, WITHIN, REST, MORE, DEARER, BOTH = (
    "not reached",
    "within the interval",
    "beside evaluations",
    "more steps",
    "dearer steps",
    "more and dearer steps",
)
#: Each with what it means.
MEANING = {
    UNREACHED: "a peer alone gets there",
    WITHIN: f"the ratio's interval holds {WANTED:.1f}",
    REST: "with the evaluations alone, at the scene's cheapest price, it would be no slower",
    MORE: "its steps are no dearer, there are more of them",
    DEARER: "its steps are no more, each takes longer",
    BOTH: "it takes more steps, and each takes longer",
}


def cells(front: pd.DataFrame) -> pd.DataFrame:
    """A row for each scene and accuracy that a side reaches; the ratio is 0 of ours alone, infinite of a peer alone."""
    found = choices(front)
    ours, peer = (found[f"{side} integrator"].notna() for side in (OURS, PEERS))
    alone = np.select([ours & ~peer, peer & ~ours], [0.0, inf], nan)
    told = found.assign(**{c: found[c].where(ours & peer, alone) for c in ("ratio", "ratio low", "ratio high")})
    return told[ours | peer].reset_index(drop=True)


def above(front: pd.DataFrame, rungs: pd.DataFrame) -> pd.DataFrame:
    """The cells of more than `WANTED`, the worst first, each with the parts of its ratio and the reason.

    Columns besides those of the cells: ``steps`` and ``step``, the two factors of the ratio; ``per step``, evaluations
    of ours; ``share``, of its time that they take at the scene's cheapest price; ``evaluations alone``, the ratio of
    that share; ``until``, the finest accuracy before this one at which ours took at most `WANTED`, and ``ours grew``,
    ``peer grew``, how many times as many steps either takes since; ``reason``, one of `MEANING`.
    """
    told, rows = cells(front), []
    prices = {scene: price(part) for scene, part in rungs.groupby("scene", sort=False)}
    for scene, part in told.groupby("scene", sort=False):
        for row in part[~(part["ratio"] <= WANTED)].to_dict("records"):
            parts = _parts(row, prices.get(scene, nan)) | _growth(row, part)
            rows.append(row | parts | {"reason": _reason(row, parts)})
    columns = [*told.columns, "steps", "step", "per step", "share", "evaluations alone", "until", "ours grew"]
    out = pd.DataFrame(rows, columns=[*columns, "peer grew", "reason"])
    return out.sort_values("ratio", ascending=False, kind="stable").reset_index(drop=True)


def price(rungs: pd.DataFrame) -> float:
    """The seconds of the cheapest evaluation that a method of this project makes in these runs; NaN for none."""
    own = rungs[(rungs["kind"] == PROJECT) & (rungs["evaluations"] > 0) & (rungs["seconds"] > 0)]
    return float((own["seconds"] / own["evaluations"]).min()) if len(own) else nan


def _parts(row: dict, cheapest: float) -> dict[str, float]:
    """The two factors of the ratio, and what its evaluations are of it."""
    n, m = (row[f"{side} steps"] for side in (OURS, PEERS))
    steps = n / m if m else nan
    evaluations = row[f"{OURS} evaluations"]
    share = min(1.0, evaluations * cheapest / row[f"{OURS} seconds"])
    out = {"steps": steps, "step": row["ratio"] / steps, "per step": evaluations / n if n else nan}
    return out | {"share": share, "evaluations alone": row["ratio"] * share}


def _growth(row: dict, scene: pd.DataFrame) -> dict[str, float]:
    """How the numbers of steps grew since the finest accuracy before at which ours was fast enough."""
    before = scene[(scene["accuracy"] > row["accuracy"]) & (scene["ratio"] <= WANTED)]
    if before.empty:
        return {"until": nan, "ours grew": nan, "peer grew": nan}
    last = before.loc[before["accuracy"].idxmin()]
    grown = {f"{side} grew": row[f"{side} steps"] / last[f"{side} steps"] for side in (OURS, PEERS)}
    return {"until": last["accuracy"]} | grown


def _reason(row: dict, parts: dict[str, float]) -> str | None:
    """Why the ratio is above `WANTED`; None where the rows do not tell."""
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


def told(row, rungs: pd.DataFrame) -> str:
    """A cell's reason with its numbers."""
    if row["reason"] == UNREACHED:
        return f"{UNREACHED}: {_nearest(row, rungs)}"
    text = f"{row['reason'] or 'not told'}: steps x {number(row['steps'], 2)}, a step's time x {number(row['step'], 2)}"
    text += f"; evaluations {100 * row['share']:.0f} %" if row["share"] == row["share"] else ""
    if row["ours grew"] == row["ours grew"]:
        grew = f"{number(row['ours grew'], 2)} and {number(row['peer grew'], 2)}"
        text += f"; steps since {row['until']:.0e} x {grew}"
    return text


def _nearest(row, rungs: pd.DataFrame) -> str:
    """The least error of a method of this project on a scene."""
    own = rungs[(rungs["scene"] == row["scene"]) & (rungs["kind"] == PROJECT) & (rungs["error"] > 0)]
    if own.empty:
        return "no run of ours is kept"
    best = own.loc[own["error"].idxmin()]
    return f"ours end at {number(float(best['error']), 2)} ({best['integrator']})"
