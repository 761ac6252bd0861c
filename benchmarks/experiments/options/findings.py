"""Findings from the tables of each option: the best setting, its benefit and its cost."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.ladder.costs import at
from phasebench.benchmarks.measure.timing import NOWHERE, TIED, Median, cheaper
from phasebench.benchmarks.page.page import once
from phasebench.integrators.driver import OK

from . import arithmetic, ladders, nodes, solvers

HALF = 0.5
#: Errors at which settings are compared; the factor up to which two numbers count as equal.
ERRORS, SAME = (1e-1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10), 1.1
#: Relative energy errors up to which the energy counts as kept: in `ladders`, and in `nodes`.
KEPT, FLOOR = 1e-12, 1e-13


def best_lambdas(errors: pd.DataFrame) -> pd.DataFrame:
    """For each scene, method and step: the lambda of least trajectory error, and how many times larger it is at 1/2.

    ``finer`` tells the step, ``gain`` is the factor, ``half is best`` whether it is at most `SAME`.
    """
    rows = []
    for (scene, id, finer), part in errors.groupby(["scene", "method", "finer"], sort=False):
        part = part[np.isfinite(part["trajectory"]) & (part["trajectory"] > part["uncertainty"])]
        half = part[part["lam"] == HALF]
        if half.empty:
            continue
        least, half = part.loc[part["trajectory"].idxmin()], half.iloc[0]
        row = {"scene": scene, "method": id, "finer": finer, "h": least["h"], "best": least["lam"]}
        row |= {"least": least["trajectory"], "gain": half["trajectory"] / least["trajectory"]}
        rows.append(row | {"half is best": row["gain"] <= SAME})
    return pd.DataFrame(rows)


def longest(costs: pd.DataFrame) -> pd.DataFrame:
    """For each scene and method, the lambda that allows the longest step, and whether 1/2 allows it too."""
    rows = []
    for (scene, id), part in costs.groupby(["scene", "method"], sort=False):
        half = part[part["lam"] == HALF]
        if half.empty:
            continue
        top = part.loc[part["largest h"].idxmax()]
        row = {"scene": scene, "method": id, "longest at": top["lam"], "longest": top["largest h"]}
        rows.append(row | {"half is longest": half.iloc[0]["largest h"] >= top["largest h"]})
    return pd.DataFrame(rows)


def usable(rungs: pd.DataFrame, option: str) -> pd.DataFrame:
    """The completed runs of an option; for the option `ENERGY` only those that kept the energy in every step."""
    rungs = rungs[(rungs["knob"] == option) & (rungs["status"] == OK)]
    return rungs[(rungs["energy error"] <= KEPT) & (rungs["fallbacks"] == 0)] if option == ladders.ENERGY else rungs


@once
def cheapest(rungs: pd.DataFrame, option: str) -> pd.DataFrame:
    """For each scene and error: the fastest setting, settings tied with it, and the slowest one's time over its own."""
    rows = []
    for scene, part in usable(rungs, option).groupby("scene", sort=False):
        for error in ERRORS:
            costs: dict[str, Median] = {name: at(own, error) for name, own in part.groupby("setting", sort=False)}
            costs = {name: cost for name, cost in costs.items() if cost is not NOWHERE}
            if not costs:
                continue
            best = min(costs, key=lambda name: costs[name].value)
            ties = [name for name in costs if name != best and cheaper(costs[best], costs[name]) == TIED]
            worst = max(cost.value for cost in costs.values()) / costs[best].value
            row = {"scene": scene, "error": error, "setting": best, "ties": ties, "us": costs[best].value}
            rows.append(row | {"costs": {k: c.value for k, c in costs.items()}, "dearest / cheapest": worst})
    return pd.DataFrame(rows)


def power(error: float) -> str:
    """The nearest power of ten as text, such as 1e-6."""
    return f"1e{round(np.log10(error))}"


def quadratures(table: pd.DataFrame) -> pd.DataFrame:
    """For each scene and step of the averaged vector field method: the fewest nodes that keep H, and what they cost.

    The cost is against one node, and that of the method's own rule against the fewest nodes.
    """
    rows = []
    for (scene, h), part in table[table["status"] == OK].groupby(["scene", "h"], sort=False):
        fixed = part[part["nodes"] != nodes.CONFIRMED].sort_values("nodes")
        kept, own = fixed[fixed["energy error"] <= FLOOR], part[part["nodes"] == nodes.CONFIRMED]
        one = fixed[fixed["nodes"] == 1]
        if kept.empty or own.empty or one.empty:
            continue
        few, own, one = kept.iloc[0], own.iloc[0], one.iloc[0]
        row = {"scene": scene, "h": h, "nodes": int(few["nodes"]), "energy error": few["energy error"]}
        row |= {"with one": one["energy error"], "cost": few["ns per step"] / one["ns per step"]}
        row |= {"confirmed": own["energy error"], "confirmed / fewest": own["ns per step"] / few["ns per step"]}
        rows.append(row)
    return pd.DataFrame(rows)


def sums(table: pd.DataFrame) -> pd.DataFrame:
    """A row for each scene at its largest number of steps: the gain of compensated sums, the error of single precision.

    The gain is the round-off with plain sums over that with compensated ones; of single precision, the least error.
    """
    rows = []
    for scene, part in table.groupby("scene", sort=False):
        last = part[part["steps"] == part["steps"].max()].set_index("arithmetic")
        single = part[part["arithmetic"] == arithmetic.SINGLE]
        if single.empty or not {arithmetic.PLAIN, arithmetic.COMPENSATED} <= set(last.index):
            continue
        rms, floor = last["round-off rms"], single.loc[single["error"].idxmin()]
        row = {"scene": scene, "steps": int(part["steps"].max()), "compensated": rms[arithmetic.COMPENSATED]}
        row |= {"gain": rms[arithmetic.PLAIN] / rms[arithmetic.COMPENSATED]}
        row |= {"floor of single": floor["error"], "at h": floor["h"]}
        rows.append(row | {"error of doubles": last["error"][arithmetic.COMPENSATED]})
    return pd.DataFrame(rows)


def solving(table: pd.DataFrame) -> pd.DataFrame:
    """For each scene and step, the solver of the stage equations that needs the fewest evaluations.

    ``solver``, ``start``, ``fewest``: the best setting of the plain loop (`solvers.Loop`) and its evaluations;
    ``engine``: the evaluations of the integrators' own solver over ``fewest``; ``fixed``, ``simplified``: those of
    fixed point and simplified Newton from the best start, NaN without convergence; ``loosest``: the largest tolerance
    of these two that changes the end error by less than a factor `SAME`; ``saved``: the share of evaluations saved.
    """
    rows = []
    for (scene, h), part in table[table["status"] == OK].groupby(["scene", "h"], sort=False):
        own, loop = part[part["solver"] == solvers.ENGINE], part[part["solver"] != solvers.ENGINE]
        exact = loop[loop["tol"] == solvers.ROUND_OFF]
        if exact.empty or own.empty:
            continue
        best = exact.loc[exact["evaluations"].idxmin()]
        row = {"scene": scene, "h": h, "solver": best["solver"], "start": best["start"], "fewest": best["evaluations"]}
        row["engine"] = own.iloc[0]["evaluations"] / best["evaluations"]
        for name, solver in (("fixed", solvers.FIXED), ("simplified", solvers.SIMPLE)):
            row[name] = exact[exact["solver"] == solver]["evaluations"].min()
        rows.append(row | _loosest(loop))
    return pd.DataFrame(rows)


def _loosest(loop: pd.DataFrame) -> dict[str, float]:
    """The columns ``loosest`` and ``saved`` of `solving`; NaN and 0 if no tolerance leaves the error unchanged."""
    found = {"loosest": np.nan, "saved": 0.0}
    for _, part in loop[loop["start"] == solvers.FIVE].groupby("solver", sort=False):
        exact = part[part["tol"] == solvers.ROUND_OFF]
        if exact.empty:
            continue
        error, most = exact.iloc[0]["error"], exact.iloc[0]["evaluations"]
        same = part[(part["tol"] > 0) & (part["error"] <= SAME * error) & (part["error"] >= error / SAME)]
        if len(same) and not same["tol"].max() <= found["loosest"]:
            last = same.loc[same["tol"].idxmax()]
            found = {"loosest": last["tol"], "saved": 1 - last["evaluations"] / most}
    return found
