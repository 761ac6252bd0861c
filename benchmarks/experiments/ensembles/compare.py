"""Compare costs at equal error: this project's ensembles and heyoka's batches."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.ladder.costs import at
from phasebench.benchmarks.measure.timing import NOWHERE, Median, cheaper

from .against import ERRORS

OURS, HEYOKA = "ours", "heyoka"


def least(rows: pd.DataFrame, error: float) -> tuple[str, Median]:
    """Find the cheapest integrator with an error of at most ``error``: (name, cost); ("", NOWHERE) if there is none.

    ``rows`` are runs of several integrators on one problem; the cost is in microseconds an orbit, with its interval;
    NOWHERE is an infinite cost.
    """
    costs = {name: at(rungs, error) for name, rungs in rows.groupby("integrator", sort=False)}
    name = min(costs, key=lambda k: costs[k].value, default=None)
    return ("", NOWHERE) if name is None or costs[name] is NOWHERE else (name, costs[name])


def cost_table(frame: pd.DataFrame) -> pd.DataFrame:
    """Make a row for each problem and error: our cheapest run, heyoka's, the ratio of costs, the cheaper one.

    ``frame`` is the table "ensembles_against"; "ours" stands for this project.
    """
    rows = []
    for problem, part in frame.groupby("problem", sort=False):
        for error in ERRORS:
            (own, ours), (peer, heyoka) = (least(part[part["side"] == side], error) for side in (OURS, HEYOKA))
            ratio = ours.value / heyoka.value if heyoka is not NOWHERE and ours is not NOWHERE else np.nan
            row = {"problem": problem, "error": error, "ours": own, "us, ours": ours.value, "heyoka": peer}
            rows.append(row | {"us, heyoka": heyoka.value, "ours / heyoka": ratio, "cheaper": cheaper(ours, heyoka)})
    return pd.DataFrame(rows)
