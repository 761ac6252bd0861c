"""Findings from the measured tables of each option of the methods: the best setting, its benefit and its cost."""

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
    """Find, for each orbit, method and step, the parameter lambda of least trajectory error, and compare lambda = 1/2.

    ``errors`` is the table of errors of the module `lambdas`.  In the result, with the orbit as ``scene``, ``finer``
    tells the step (the factor of the number of steps), ``best`` and ``least`` are the best lambda and its error,
    ``gain`` is the error at 1/2 over the least one, ``half is best`` is whether that is at most `SAME`.
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
    """Find, for each orbit and method, the longest stable step, the lambda that allows it, and whether 1/2 does.

    Lambda is the method's parameter; ``costs`` is the table of costs of the module `lambdas`.  Columns of the result
    are ``scene`` (the orbit), ``method``, ``longest at`` (lambda), ``longest`` (the step) and ``half is longest``.
    """
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
    """Select the completed runs of an option from the table of the module `ladders`.

    For the option `ENERGY` these are only the runs that kept the energy, with a solution in every step.
    """
    rungs = rungs[(rungs["knob"] == option) & (rungs["status"] == OK)]
    return rungs[(rungs["energy error"] <= KEPT) & (rungs["fallbacks"] == 0)] if option == ladders.ENERGY else rungs


@once
def cheapest(rungs: pd.DataFrame, option: str) -> pd.DataFrame:
    """Find, for each scene (orbit) and error of `ERRORS`, the fastest setting of an option.

    ``rungs`` is the table of the module `ladders`.  In the result ``ties`` are the settings whose cost is not certainly
    higher, ``us`` is the time in microseconds, ``costs`` maps each setting to its time, and ``dearest / cheapest`` is
    the slowest one's time over the fastest one's.
    """
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
    """Format the nearest power of ten as text, such as 1e-6."""
    return f"1e{round(np.log10(error))}"


def quadratures(table: pd.DataFrame) -> pd.DataFrame:
    """Find, for each scene (orbit) and step, the fewest quadrature nodes with which the AVF method keeps H.

    AVF is the averaged vector field method; ``table`` is that of the module `nodes`.  In the result ``cost`` is the
    time with these nodes over that with one, ``confirmed / fewest`` the time with the method's own choice of nodes over
    that with the fewest, and ``with one`` and ``confirmed`` are energy errors.
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
    """Compare plain and compensated sums at the largest number of steps of each scene (orbit): a row for each.

    ``table`` is the table of errors of the module `arithmetic`.  In the result ``gain`` is the round-off with plain
    sums over that with compensated ones, and ``floor of single`` the least error in single precision, reached at ``at
    h``.
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
    """Find, for each scene (orbit) and step, the solver of the stage equations that needs the fewest evaluations.

    ``table`` is that of the module `solvers`.  Columns of the result:

    - solver, start, fewest : the best setting of the plain loop (`solvers.Loop`) and its evaluations
    - engine : the evaluations of the integrators' own solver over ``fewest``
    - fixed, simplified : evaluations of fixed point and simplified Newton from the best start, NaN without convergence
    - loosest : the largest tolerance of these two that changes the end error by less than a factor `SAME`
    - saved : the share of the evaluations that this tolerance saves
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
    """Find the loosest tolerance that leaves the error unchanged: the columns ``loosest`` and ``saved`` of `solving`.

    ``loop`` are the rows of one scene and step; NaN and 0 if there is no such tolerance.
    """
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
