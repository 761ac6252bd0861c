"""The fastest integrator of a scene (problem, end time, quantity) at an accuracy, ours or a peer, from the tables."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.measure.timing import NONE, OURS, PEERS, TIED

#: Two sides are tied if the interval of their ratio, widened by this factor, contains 1.
TIE = 1.05


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
