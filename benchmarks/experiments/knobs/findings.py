"""What the tables say of each knob: the best setting, what it gives and what it costs."""

from __future__ import annotations

from itertools import groupby

import numpy as np
import pandas as pd

from phasebench.benchmarks.experiments.ensembles.compare import at
from phasebench.benchmarks.measure.timing import NOWHERE, TIED, Median, cheaper
from phasebench.integrators.driver import OK

from . import arithmetic, ladders, nodes, solvers

HALF = 0.5
#: Errors at which settings are compared, and what two errors may differ by to be called the same.
ERRORS, SAME = (1e-1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10), 1.1
#: More ties than this are counted, not named.
TIES = 2
#: Energy errors, relative, up to which an energy is kept: of a ladder's run, and of a quadrature's.
KEPT, FLOOR = 1e-12, 1e-13


def best_lambdas(errors: pd.DataFrame) -> pd.DataFrame:
    """A row for each scene, method and fineness: the lambda of the least trajectory error, and what 1/2 has over it."""
    rows = []
    for (scene, id, finer), part in errors.groupby(["scene", "method", "finer"], sort=False):
        part = part[np.isfinite(part["trajectory"]) & (part["trajectory"] > part["uncertainty"])]
        half = part[part["lam"] == HALF]
        if half.empty:
            continue
        least, half = part.loc[part["trajectory"].idxmin()], half.iloc[0]
        row = {"scene": scene, "method": id, "finer": finer, "h": least["h"], "best": least["lam"]}
        row |= {"least": least["trajectory"], "gain": half["trajectory"] / least["trajectory"]}
        row |= {"best at the end": part.loc[part["end"].idxmin(), "lam"], "half is best": row["gain"] <= SAME}
        rows.append(row)
    return pd.DataFrame(rows)


def longest(costs: pd.DataFrame) -> pd.DataFrame:
    """A row for each scene and method: the lambda whose largest step is longest, and whether that of 1/2 is as long."""
    rows = []
    for (scene, id), part in costs.groupby(["scene", "method"], sort=False):
        half = part[part["lam"] == HALF]
        if half.empty:
            continue
        top = part.loc[part["largest h"].idxmax()]
        row = {"scene": scene, "method": id, "longest at": top["lam"], "longest": top["largest h"]}
        rows.append(row | {"half is longest": half.iloc[0]["largest h"] >= top["largest h"]})
    return pd.DataFrame(rows)


def usable(rungs: pd.DataFrame, knob: str) -> pd.DataFrame:
    """The rungs that arrived; of methods that keep the energy those that did keep it."""
    rungs = rungs[(rungs["knob"] == knob) & (rungs["status"] == OK)]
    return rungs[(rungs["energy error"] <= KEPT) & (rungs["fallbacks"] == 0)] if knob == ladders.ENERGY else rungs


def cheapest(rungs: pd.DataFrame, knob: str) -> pd.DataFrame:
    """A row for each scene and error: the cheapest setting, those in a tie with it, how much dearer the dearest is."""
    rows = []
    for scene, part in usable(rungs, knob).groupby("scene", sort=False):
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


def ranges(found: pd.DataFrame) -> str:
    """``2 to 1e-2, 6 to 1e-6``: the cheapest settings of one scene, each to the smallest error where it is."""
    runs = [(name, list(rows)) for name, rows in groupby(found.itertuples(), key=lambda row: row.setting)]
    return ", ".join(f"{name} to {power(rows[-1].error)}" + _tied(rows) for name, rows in runs)


def power(error: float) -> str:
    """A power of ten as it is said: 1e-6."""
    return f"1e{round(np.log10(error))}"


def _tied(rows) -> str:
    ties = list(dict.fromkeys(name for row in rows for name in row.ties))
    if len(ties) > TIES:
        return f" (in a tie with {len(ties)} others)"
    return f" (or {', '.join(ties)}, in a tie)" if ties else ""


def quadratures(table: pd.DataFrame) -> pd.DataFrame:
    """A row for each scene and step: the fewest nodes that keep the energy; what they and the confirmed rule cost."""
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
    """A row for each scene, at its most steps: what plain sums leave of round-off over compensated ones; the floors."""
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
    """A row for each scene and step: who solves the stage equations to round-off in the fewest evaluations.

    ``solver``, ``start``, ``fewest`` of the plain loop; ``engine``, its evaluations over those; ``fixed`` and
    ``simplified``, the evaluations of either from its best start, NaN where it does not converge; ``five``, of the
    fixed point from five steps over those from zero; ``loosest``, the largest tolerance of either that changes the
    error of the end by less than a factor `SAME`, and ``saved``, the share of the evaluations that it saves.
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
        fixed = exact[exact["solver"] == solvers.FIXED].set_index("start")["evaluations"]
        row["five"] = fixed.get(solvers.FIVE, np.nan) / fixed.get(solvers.ZERO, np.nan)
        rows.append(row | _loosest(loop))
    return pd.DataFrame(rows)


def _loosest(loop: pd.DataFrame) -> dict[str, float]:
    """The loosest tolerance that leaves the error as it is, and what it saves; NaN and 0 where there is none."""
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
