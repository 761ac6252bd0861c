"""Which integrator for which accuracy: what the tables of the front say, as functions of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.timing import NONE, OURS, PEERS, TIED
from phasebench.benchmarks.page.page import once

#: Two sides are tied where the ratio's interval, widened by this factor, holds 1.
TIE = 1.05
#: The accuracies that are shown side by side.
SHOWN = (1e-3, 1e-6, 1e-9, 1e-12)
#: Accuracies are the same within this share.
SAME = 1e-6


def cheaper(row) -> str:
    """Who is cheaper in a row of the choices; a side that does not reach the accuracy has no integrator."""
    there = {side: isinstance(row.get(f"{side} integrator"), str) for side in (OURS, PEERS)}
    if not all(there.values()):
        return next((side for side, is_ in there.items() if is_), NONE)
    if row["ratio high"] * TIE < 1:
        return OURS
    return PEERS if row["ratio low"] > TIE else TIED


@once
def choices(front: pd.DataFrame) -> pd.DataFrame:
    """The choices with who is cheaper."""
    columns = [f"{side} {x}" for side in (OURS, PEERS) for x in ("integrator", "seconds")]
    columns += ["ratio", "ratio low", "ratio high"]
    whole = front.reindex(columns=[*front.columns, *(c for c in columns if c not in front)])
    return whole.assign(cheaper=[cheaper(r) for r in whole.to_dict("records")])


def at(found: pd.DataFrame, accuracy: float) -> pd.DataFrame:
    """The rows of an accuracy."""
    return found[np.isclose(found["accuracy"], accuracy, rtol=SAME, atol=0)]


def counts(found: pd.DataFrame) -> tuple[int, int, int, int]:
    """How often ours, a peer, neither is the cheaper, and none gets there."""
    number = found["cheaper"].value_counts()
    return tuple(int(number.get(who, 0)) for who in (OURS, PEERS, TIED, NONE))


def winner(row) -> str:
    """The integrator that is cheapest; of a tie the one of the smaller median."""
    sides = [s for s in (OURS, PEERS) if isinstance(row[f"{s} integrator"], str)]
    return row[f"{min(sides, key=lambda s: row[f'{s} seconds'])} integrator"] if sides else ""


def changes(found: pd.DataFrame) -> list[tuple[float, str, str]]:
    """Where the advice of a scene changes: (accuracy from which on, who until then, who from there), by accuracy.

    A tie changes nothing.
    """
    out, before = [], None
    for row in found.sort_values("accuracy", ascending=False).to_dict("records"):
        who = row["cheaper"]
        if who in (TIED, NONE):
            continue
        if before is not None and who != before:
            out.append((row["accuracy"], before, who))
        before = who
    return out


class Agreement(NamedTuple):
    """Accuracies measured twice: how many, where one integrator won both times, where two won that are tied; the rest.

    ``apart`` has a line for each accuracy at which two won that are neither the same nor tied.
    """

    pairs: int
    same: int
    tied: int
    apart: tuple[str, ...]


def agreement(finals: pd.DataFrame, again: pd.DataFrame) -> Agreement:
    """How two sweeps agree on who is the cheapest.

    Two are tied where both were finals of one of the sweeps and their medians' intervals, widened by `TIE`, meet there.
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
    """Whether the intervals of two integrators of one final meet."""
    members = [part[part["integrator"] == name] for name in names]
    if any(m.empty for m in members):
        return False
    return max(m["low"].iloc[0] for m in members) <= TIE * min(m["high"].iloc[0] for m in members)


def drawn(finals: pd.DataFrame, side: str, most: int) -> list[str]:
    """At most so many integrators of a side for a figure: those that are its cheapest at most accuracies."""
    part = finals[finals["side"] == side]
    if part.empty:
        return []
    best = part.loc[part.groupby("accuracy")["seconds"].idxmin(), "integrator"]
    return list(best.value_counts().index[:most])


def frontier(rows: pd.DataFrame, most: int, error: str = "global_error") -> list[str]:
    """At most ``most`` methods of the rows that are the cheapest for some error, by for how many errors."""
    wins: dict[str, int] = {}
    for wanted in np.logspace(-13, -1, 25):
        enough = rows[rows[error] <= wanted]
        if len(enough):
            best = enough.loc[enough["seconds"].idxmin(), "method"]
            wins[best] = wins.get(best, 0) + 1
    return sorted(wins, key=lambda name: -wins[name])[:most]
