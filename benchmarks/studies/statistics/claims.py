"""What steps give statistics of chaotic orbits to 1 %, and whether order and structure matter.

The functions take two tables: ``rows``, a row for each scene (a statistic of an ensemble), method and step; and
``exact``, a row for each scene with the exact or reference value.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf

import pandas as pd

from phasebench.benchmarks.page.markdown import number
from phasebench.integrators.registry import BY_ID

from .measure import METHODS, SIGMAS, WANTED

#: Standard errors within which a statistic is that of the exact flow.
SAME = 3.0
RK4 = "rk4"
#: Symplectic methods of RK4's order.
FOURTH = ("forest-ruth", "calvo-sanz-serna-4", "gauss-4")


def bounds(rows: pd.DataFrame, exact: pd.DataFrame) -> pd.DataFrame:
    """The rows with their ``error`` and its ``bound``, `SIGMAS` standard errors above it, both relative."""
    known = exact.set_index("scene")
    value = rows["scene"].map(known["exact"])
    out = rows.assign(error=(rows["mean"] - value).abs() / value.abs())
    return out.assign(bound=out["error"] + SIGMAS * rows["standard error"] / value.abs())


def fewest(rows: pd.DataFrame, exact: pd.DataFrame) -> pd.DataFrame:
    """The row of the largest step from which on the statistic is within 1 %, for each scene and method.

    If there is no such step, the row is that of the smallest step, with infinite ``evaluations``.
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
    """The fewest evaluations per unit of time within 1 %: a line for each scene that a method reaches, by method."""
    found = fewest(rows, exact).pivot(index="scene", columns="method", values="evaluations")
    found = found.reindex(columns=list(METHODS)).fillna(inf)
    return found[found.min(axis=1) < inf]


def off(exact: pd.DataFrame) -> pd.Series:
    """How many standard errors the average of a fine run is off."""
    return ((exact["mean"] - exact["exact"]) / exact["standard error"]).abs()


def farthest(exact: pd.DataFrame) -> str:
    """The scene whose average is farthest off."""
    return f"{exact.loc[off(exact).idxmax(), 'scene']}: {number(off(exact).max())} standard errors"


def ratio(
    above: Callable[[pd.DataFrame], pd.Series], below: Callable[[pd.DataFrame], pd.Series]
) -> Callable[[pd.DataFrame, pd.DataFrame], pd.Series]:
    """One number of evaluations over another, by scene; both are of the table of `by_scene`."""

    def of(rows: pd.DataFrame, exact: pd.DataFrame) -> pd.Series:
        found = by_scene(rows, exact)
        return above(found) / below(found)

    return of


def of_order(low: int, high: int) -> Callable[[pd.DataFrame], pd.Series]:
    """The fewest evaluations of methods whose order is in a range."""
    return lambda found: found[[m for m in found if low <= BY_ID[m].order <= high]].min(axis=1)


def leapfrog(rows: pd.DataFrame, exact: pd.DataFrame) -> pd.Series:
    """Leapfrog's evaluations over the fewest of all, by "scene: the method of these"."""
    found = by_scene(rows, exact)
    over = found["stormer-verlet"] / found.min(axis=1)
    return over.set_axis([f"{scene}: {found.loc[scene].idxmin()}" for scene in found.index])


def drifts(rows: pd.DataFrame, exact: pd.DataFrame) -> pd.DataFrame:
    """The runs whose statistic is within 1 % of an exactly known one, with its ``drift``.

    The drift is the relative error of the statistic over the last tenth of the time, less `SAME` standard errors.
    """
    known = rows["scene"].map(exact.set_index("scene")["exact"])
    late = ((rows["late"] - known).abs() - SAME * rows["late error"]) / known.abs()
    at = bounds(rows, exact).assign(drift=late)
    return at[(at["bound"] <= WANTED) & exact.set_index("scene")["known"].reindex(at["scene"]).to_numpy(bool)]


def lasting(rows: pd.DataFrame, exact: pd.DataFrame) -> pd.Series:
    """True where a statistic within 1 % is so at late times, too."""
    return drifts(rows, exact)["drift"] <= WANTED


def drifting(rows: pd.DataFrame, exact: pd.DataFrame) -> str:
    """The run that drifts most."""
    found = drifts(rows, exact)
    row = found.loc[found["drift"].idxmax()]
    return f"{row['scene']}: {row['method']}"
