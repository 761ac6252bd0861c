"""Select the fastest integrator at each accuracy, ours or a peer (another package's), from the measured tables.

A case is a scene (problem, end time, quantity) at an accuracy; the two sides are this project's methods and peers.
"""

from __future__ import annotations

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


def cheaper(row: dict) -> str:
    """Return the faster side in a case: `OURS`, `PEERS`, `TIED`, or `NONE` if neither reaches the accuracy.

    ``row`` (a mapping) has the fastest integrator of each side in a scene at an accuracy, and the interval of the ratio
    of their times.  A side that alone reaches the accuracy is the faster one.
    """
    there = {side: isinstance(row.get(f"{side} integrator"), str) for side in (OURS, PEERS)}
    if not all(there.values()):
        return next((side for side, is_ in there.items() if is_), NONE)
    if row["ratio high"] * TIE < 1:
        return OURS
    return PEERS if row["ratio low"] > TIE else TIED


@once
def choices(front: pd.DataFrame) -> pd.DataFrame:
    """Add the column ``cheaper``, the faster side (ours or the peers), to the table of fastest integrators.

    ``front`` has a row for each scene and accuracy, with the fastest integrator of either side.
    """
    columns = [f"{side} {x}" for side in (OURS, PEERS) for x in ("integrator", "seconds")]
    columns += ["ratio", "ratio low", "ratio high"]
    whole = front.reindex(columns=[*front.columns, *(c for c in columns if c not in front)])
    return whole.assign(cheaper=[cheaper(r) for r in whole.to_dict("records")])


def at(found: pd.DataFrame, accuracy: float) -> pd.DataFrame:
    """Select the rows at one accuracy from the table of fastest integrators (a row for each scene and accuracy)."""
    return found[np.isclose(found["accuracy"], accuracy, rtol=SAME, atol=0)]


def counts(found: pd.DataFrame) -> tuple[int, int, int, int]:
    """Count the rows, each a scene at an accuracy: (ours faster, a peer faster, tied, reached by neither)."""
    number = found["cheaper"].value_counts()
    return tuple(int(number.get(who, 0)) for who in (OURS, PEERS, TIED, NONE))


def winner(row: dict) -> str:
    """Return the name of the fastest integrator in a row (a scene at an accuracy); "" if none reaches the accuracy.

    In a tie it is the one with the smaller median time.
    """
    sides = [s for s in (OURS, PEERS) if isinstance(row[f"{s} integrator"], str)]
    return row[f"{min(sides, key=lambda s: row[f'{s} seconds'])} integrator"] if sides else ""


def integrators_to_draw(finals: pd.DataFrame, side: str, most: int) -> list[str]:
    """Return the names of the ``most`` integrators that are most often the fastest of their side, over accuracies.

    ``side`` is ours or the peers'; ``finals`` has the timed integrators of one scene.
    """
    part = finals[finals["side"] == side]
    if part.empty:
        return []
    best = part.loc[part.groupby("accuracy")["seconds"].idxmin(), "integrator"]
    return list(best.value_counts().index[:most])
