"""The fastest integrator at each accuracy, ours or a peer (another package's), from the measured tables."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.timing import NONE, OURS, PEERS, TIED
from phasebench.benchmarks.page.page import once

#: Two sides are tied if the interval of their ratio, widened by this factor, contains 1.
TIE = 1.05
#: The accuracies that are shown side by side.
SHOWN = (1e-3, 1e-6, 1e-9, 1e-12)
#: Smallest share of the decided cases that this project should win.
HALF = 0.5
#: Relative difference up to which two accuracies are equal.
SAME = 1e-6


def cheaper(row) -> str:
    """The faster side in a row on an accuracy: `OURS`, `PEERS`, `TIED`, or `NONE` if neither reaches the accuracy."""
    there = {side: isinstance(row.get(f"{side} integrator"), str) for side in (OURS, PEERS)}
    if not all(there.values()):
        return next((side for side, is_ in there.items() if is_), NONE)
    if row["ratio high"] * TIE < 1:
        return OURS
    return PEERS if row["ratio low"] > TIE else TIED


@once
def choices(front: pd.DataFrame) -> pd.DataFrame:
    """Add the column ``cheaper``, the faster side, to the table of both sides' fastest integrators at each accuracy."""
    columns = [f"{side} {x}" for side in (OURS, PEERS) for x in ("integrator", "seconds")]
    columns += ["ratio", "ratio low", "ratio high"]
    whole = front.reindex(columns=[*front.columns, *(c for c in columns if c not in front)])
    return whole.assign(cheaper=[cheaper(r) for r in whole.to_dict("records")])


def at(found: pd.DataFrame, accuracy: float) -> pd.DataFrame:
    """Select the rows at one accuracy from the table of fastest integrators."""
    return found[np.isclose(found["accuracy"], accuracy, rtol=SAME, atol=0)]


def counts(found: pd.DataFrame) -> tuple[int, int, int, int]:
    """Count cases (scene and accuracy): (ours faster, a peer faster, tied, accuracy not reached by either)."""
    number = found["cheaper"].value_counts()
    return tuple(int(number.get(who, 0)) for who in (OURS, PEERS, TIED, NONE))


def winner(row) -> str:
    """The fastest integrator of a case, by the median time even in a tie; empty if none reaches the accuracy."""
    sides = [s for s in (OURS, PEERS) if isinstance(row[f"{s} integrator"], str)]
    return row[f"{min(sides, key=lambda s: row[f'{s} seconds'])} integrator"] if sides else ""


class Agreement(NamedTuple):
    """Agreement of two independent measurements on the fastest integrator.

    ``pairs``: number of (scene, accuracy) in both; ``same``: with the same winner; ``tied``: with tied winners;
    ``apart``: a text for each of the others.
    """

    pairs: int
    same: int
    tied: int
    apart: tuple[str, ...]


def agreement(finals: pd.DataFrame, again: pd.DataFrame) -> Agreement:
    """Compare the fastest integrators of two independent measurements.

    Two winners are tied if both are finalists in one sweep, and their intervals there, widened by `TIE`, overlap.
    """
    pairs = same = tied = 0
    apart = []
    first = dict(list(finals.groupby(["scene", "accuracy"])))
    for key, second in again.groupby(["scene", "accuracy"]):
        if key not in first:
            continue
        pairs += 1
        winners = [part.loc[part["seconds"].idxmin(), "integrator"] for part in (first[key], second)]
        if winners[0] == winners[1]:
            same += 1
        elif any(_meet(part, winners) for part in (first[key], second)):
            tied += 1
        else:
            apart.append(f"{key[0]} to {key[1]:g} ({winners[0]}, then {winners[1]})")
    return Agreement(pairs, same, tied, tuple(apart))


def _meet(part: pd.DataFrame, names: Iterable[str]) -> bool:
    """Whether the time intervals of two integrators overlap in one case; False if one was not timed in it."""
    members = [part[part["integrator"] == name] for name in names]
    if any(m.empty for m in members):
        return False
    return max(m["low"].iloc[0] for m in members) <= TIE * min(m["high"].iloc[0] for m in members)


def integrators_to_draw(finals: pd.DataFrame, side: str, most: int) -> list[str]:
    """The ``most`` integrators of a side that are its fastest at the largest number of accuracies."""
    part = finals[finals["side"] == side]
    if part.empty:
        return []
    best = part.loc[part.groupby("accuracy")["seconds"].idxmin(), "integrator"]
    return list(best.value_counts().index[:most])
