"""Verdicts on statistics of chaotic orbits: which steps give them to 1 %, and whether order and structure matter.

The functions take two tables: ``rows``, a row for each scene (a statistic of an ensemble), method and step; and
``exact``, a row for each scene with the exact or reference value.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf

import pandas as pd

from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import of
from phasebench.benchmarks.page.verdict import EVERY, Count, Range, Verdict, at_least, at_most
from phasebench.integrators.registry import BY_ID

from .measure import EXACT, METHODS, SIGMAS, TABLE, WANTED

#: Standard errors within which a statistic is that of the exact flow.
SAME = 3.0
RK4 = "rk4"
#: Symplectic methods of RK4's order.
FOURTH = ("forest-ruth", "calvo-sanz-serna-4", "gauss-4")


def bounds(rows: pd.DataFrame, exact: pd.DataFrame) -> pd.DataFrame:
    """Add the columns ``error`` and ``bound`` to the measured rows, both relative to the exact statistic.

    ``bound`` is the error plus `SIGMAS` standard errors.  ``rows`` has a row for each scene (a statistic of an ensemble
    of orbits), method and step, ``exact`` the exact value of each scene.
    """
    known = exact.set_index("scene")
    value = rows["scene"].map(known["exact"])
    out = rows.assign(error=(rows["mean"] - value).abs() / value.abs())
    return out.assign(bound=out["error"] + SIGMAS * rows["standard error"] / value.abs())


def fewest(rows: pd.DataFrame, exact: pd.DataFrame) -> pd.DataFrame:
    """Select, for each scene and method, the row of the largest step with which the statistic is within 1 %.

    All smaller steps must be within 1 %, too.  If there is no such step, the row is that of the smallest step, with
    infinite ``evaluations``.  ``rows`` has a row for each scene (a statistic of an ensemble of orbits), method and
    step, ``exact`` the exact value of each scene.
    """
    found = []
    for (scene, method), part in bounds(rows, exact).groupby(["scene", "method"], sort=False):
        part = part.sort_values("k")
        met = (part["bound"] <= WANTED).to_numpy()
        first = next((i for i in range(len(met)) if met[i:].all()), None)
        row = part.iloc[-1 if first is None else first].to_dict()
        found.append(row | ({"evaluations": inf} if first is None else {}) | {"scene": scene, "method": method})
    return pd.DataFrame(found)


def by_scene(rows: pd.DataFrame, exact: pd.DataFrame) -> pd.DataFrame:
    """Return the fewest gradient evaluations per unit of time with which a statistic is within 1 %.

    The result has a line for each scene and a column for each method; a value is infinite if the method does not reach
    1 %.  Scenes on which no method does are left out.  ``rows`` has a row for each scene (a statistic of an ensemble of
    orbits), method and step, ``exact`` the exact value of each scene.
    """
    found = fewest(rows, exact).pivot(index="scene", columns="method", values="evaluations")
    found = found.reindex(columns=list(METHODS)).fillna(inf)
    return found[found.min(axis=1) < inf]


@of(EXACT)
def sound(exact: pd.DataFrame) -> Verdict | None:
    """Judge whether runs of the ensembles with small steps have the averages that are known exactly.

    ``exact`` has a row for each scene (a statistic of an ensemble of orbits): the exact value and that of the run with
    small steps.  None if no average is known.
    """
    known = exact[exact["known"].astype(bool)]
    if known.empty:
        return None
    off = ((known["mean"] - known["exact"]) / known["standard error"]).abs()
    worst = known.loc[off.idxmax(), "scene"]
    return Verdict(
        "Fine runs have the averages over the surface of constant energy",
        Count(int((off <= SAME).sum()), len(known)),
        EVERY,
        "scenes",
        where=f"{worst}: {number(off.max())} standard errors",
    )


def _best(found: pd.DataFrame, chosen: Callable[[str], bool]) -> pd.Series:
    columns = [m for m in found if chosen(m)]
    return found[columns].min(axis=1)


@of(TABLE, EXACT)
def orders(rows: pd.DataFrame, exact: pd.DataFrame) -> Verdict | None:
    """Judge whether methods of order 4 and more need no fewer evaluations than those of order 2 for a statistic to 1 %.

    ``rows`` has a row for each scene (a statistic of an ensemble of orbits), method and step, ``exact`` the exact value
    of each scene; None if no method reaches 1 % on any scene.
    """
    found = by_scene(rows, exact)
    if found.empty:
        return None
    ratio = _best(found, lambda m: BY_ID[m].order <= 2) / _best(found, lambda m: BY_ID[m].order >= 4)
    return Verdict(
        "For statistics of chaotic orbits higher order is no practical advantage",
        Range(ratio.min(), ratio.max()),
        at_most(1.0),
        "times the evaluations of order 4 or more, by order 2",
        where=str(ratio.idxmax()),
    )


@of(TABLE, EXACT)
def structure(rows: pd.DataFrame, exact: pd.DataFrame) -> Verdict | None:
    """Judge whether some symplectic method of order 4 needs at most RK4's evaluations for a statistic to 1 %.

    ``rows`` has a row for each scene (a statistic of an ensemble of orbits), method and step, ``exact`` the exact value
    of each scene; None if no method reaches 1 % on any scene.
    """
    found = by_scene(rows, exact)
    if found.empty:
        return None
    ratio = found[RK4] / found[list(FOURTH)].min(axis=1)
    return Verdict(
        "For statistics a symplectic method of order 4 is cheaper than RK4",
        Range(ratio.min(), ratio.max()),
        at_least(1.0),
        "times the evaluations, by RK4",
        where=str(ratio.idxmin()),
    )


@of(TABLE, EXACT)
def leapfrog(rows: pd.DataFrame, exact: pd.DataFrame) -> Verdict | None:
    """Judge whether leapfrog is the cheapest method for statistics to 1 %.

    The measured value is leapfrog's number of evaluations divided by the fewest of any method, over all scenes.
    ``rows`` has a row for each scene (a statistic of an ensemble of orbits), method and step, ``exact`` the exact value
    of each scene.
    """
    found = by_scene(rows, exact)
    if found.empty:
        return None
    ratio = found["stormer-verlet"] / found.min(axis=1)
    best = found.idxmin(axis=1)[ratio.idxmax()]
    return Verdict(
        "Leapfrog gives statistics to 1 % at the least cost",
        Range(ratio.min(), ratio.max()),
        at_most(1.0),
        "times the fewest evaluations",
        where=f"{ratio.idxmax()}: {best}",
    )


def drifts(rows: pd.DataFrame, exact: pd.DataFrame) -> pd.DataFrame:
    """Select the runs whose statistic is within 1 % of an exactly known value; add the column ``drift``.

    ``drift`` is the relative error of the same statistic over the last tenth of the time, less `SAME` standard errors.
    ``rows`` has a row for each scene (a statistic of an ensemble of orbits), method and step, ``exact`` the exact value
    of each scene.
    """
    known = rows["scene"].map(exact.set_index("scene")["exact"])
    late = ((rows["late"] - known).abs() - SAME * rows["late error"]) / known.abs()
    at = bounds(rows, exact).assign(drift=late)
    return at[(at["bound"] <= WANTED) & exact.set_index("scene")["known"].reindex(at["scene"]).to_numpy(bool)]


@of(TABLE, EXACT)
def lasting(rows: pd.DataFrame, exact: pd.DataFrame) -> Verdict | None:
    """Judge whether symplectic methods whose statistic is within 1 % over all times have it at late times, too.

    Late is the last tenth of the time.  ``rows`` has a row for each scene (a statistic of an ensemble of orbits),
    method and step, ``exact`` the exact value of each scene; None if there is no such run.
    """
    found = drifts(rows, exact)
    found = found[found["symplectic"].astype(bool)]
    if found.empty:
        return None
    worst = found.loc[found["drift"].idxmax()]
    return Verdict(
        "Where symplectic methods give a statistic they give it at late times too",
        Count(int((found["drift"] <= WANTED).sum()), len(found)),
        EVERY,
        "rows",
        where=f"{worst['scene']}: {worst['method']}",
    )
