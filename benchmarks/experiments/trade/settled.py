r"""Times of integrators, and their ratios, from several timings (sweeps), with prediction intervals for a further one.

Finalists are the few fastest integrators of a scene at an accuracy, which every sweep times in turns.  Times scatter
less between the rounds of one sweep than between processes.  Two sweeps show how much: if :math:`d` are the differences
of the logarithms of their medians, over all finalists that take about as long, then

.. math:: \ln \frac{t_3}{\sqrt{t_1 t_2}} \quad\text{is distributed as}\quad \sqrt{3/4}\; d ,

since the left has the variance :math:`\tfrac32\sigma^2` and :math:`d` has :math:`2\sigma^2`.  The interval of a time is
the geometric mean of two sweeps, times and divided by the exponential of the `LEVEL` quantile of
:math:`\sqrt{3/4}\,|d|` in its class, and always contains both sweeps.  Ratios likewise, from their own differences.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.page.page import Data, of

from .choice import TIE
from .front import CHOICES, FINALS, SHOWN
from .retime import TABLE as TIMES

#: The share of further sweeps that an interval should contain.
LEVEL = 0.95
#: Bounds in seconds between the classes of times; differences are pooled in each class.
CLASSES = (25e-6, 100e-6)
#: A class with fewer differences than this uses those of all classes.
FEW = 20
#: The sweeps that are joined for the pages, and the sweep that checks the intervals.
JOINED, CHECK = (1, 2), 3
KEY = ["scene", "accuracy", "side", "integrator"]


def sweeps(finals: pd.DataFrame, times: pd.DataFrame | None) -> pd.DataFrame:
    """Collect the seconds of every finalist at each accuracy: a row for each, a column for each of three timings.

    NaN where a timing was not made.  ``finals`` has the first timing, ``times`` the later ones (or is None).
    """
    parts = [finals[[*KEY, "seconds"]].assign(sweep=1)]
    if times is not None and len(times):
        parts.append(times[[*KEY, "seconds", "sweep"]])
    table = pd.concat(parts).pivot_table(index=KEY, columns="sweep", values="seconds", aggfunc="last")
    known = finals.set_index(KEY).index
    return table[table.index.isin(known)].reindex(columns=[*JOINED, CHECK])


def _joined_seconds(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table of `sweeps` with the columns of `KEY` and ``mean``, the geometric mean of the joined timings."""
    return np.exp(np.log(table[list(JOINED)]).mean(axis=1)).rename("mean").reset_index()


def pairs(table: pd.DataFrame) -> pd.DataFrame:
    """Compute ratios of our best time to the best peer's: a row for each scene and accuracy, a column for each timing.

    ``table`` is that of `sweeps`: seconds of each finalist in each timing.  Each side has its best integrator by the
    joined timings; the column ``shorter`` is the shorter of the two times, in seconds.
    """
    mean = _joined_seconds(table)
    best = mean.loc[mean.groupby(["scene", "accuracy", "side"])["mean"].idxmin(), KEY]
    by = {side: best[best["side"] == side].set_index(["scene", "accuracy"])["integrator"] for side in (OURS, PEERS)}
    rows = []
    for key in by[OURS].index.intersection(by[PEERS].index):
        sides = {side: table.loc[(*key, side, by[side].loc[key])] for side in (OURS, PEERS)}
        ratio = sides[OURS] / sides[PEERS]
        shorter = min(np.nanmean(s[list(JOINED)]) for s in sides.values())
        names = {f"{side} integrator": by[side].loc[key] for side in (OURS, PEERS)}
        rows.append({"scene": key[0], "accuracy": key[1], "shorter": shorter} | names | ratio.to_dict())
    columns = ["scene", "accuracy", "shorter", f"{OURS} integrator", f"{PEERS} integrator", *JOINED, CHECK]
    return pd.DataFrame(rows, columns=columns)


def join_sweeps(values: pd.DataFrame, size: pd.Series) -> pd.DataFrame:
    """Join two timings of each row to a value and its prediction interval: columns ``value``, ``low``, ``high``.

    ``values`` has a column for each timing, of times or of ratios.  ``size``, in seconds, decides the class of a row:
    the interval's width comes from the scatter between timings of runs that take about as long.
    """
    logs = np.log(values[list(JOINED)])
    middle, apart = logs.mean(axis=1), (logs[JOINED[0]] - logs[JOINED[1]]).abs()
    classes = np.searchsorted(CLASSES, size.to_numpy())
    width = np.full(len(values), np.nan)
    for k in np.unique(classes):
        members = apart[classes == k].dropna()
        members = members if len(members) >= FEW else apart.dropna()
        if len(members):
            width[classes == k] = np.sqrt(3 / 4) * np.quantile(members, LEVEL)
    half = np.fmax(width, (apart / 2).to_numpy())
    middle = middle.to_numpy()
    return pd.DataFrame(
        {"value": np.exp(middle), "low": np.exp(middle - half), "high": np.exp(middle + half)}, index=values.index
    )


def coverage(finals: pd.DataFrame, times: pd.DataFrame) -> dict[str, tuple[int, int]]:
    """Count how often a third timing lies in the intervals from the first two.

    Returns {"times": ..., "ratios": ...}, each (how many lie in their interval, number of all).
    """
    table = sweeps(finals, times)
    ratios = pairs(table)
    out = {}
    for name, values, size in (("times", table, table[JOINED[0]]), ("ratios", ratios, ratios["shorter"])):
        told = values[[*JOINED, CHECK]].notna().all(axis=1)
        interval, third = join_sweeps(values, size)[told], values.loc[told, CHECK]
        out[name] = int(third.between(interval["low"], interval["high"]).sum()), int(told.sum())
    return out


class Agreement(NamedTuple):
    """Agreement of a sweep that was made again, from the first step on, with the fastest integrators of joined sweeps.

    Attributes
    ----------
    pairs : number of cases (scene and accuracy) in both
    same : number of cases with the same fastest integrator in both
    tied : number of cases whose two fastest integrators differ but are tied: the interval of their times' ratio, from
        the joined sweeps, comes within the factor `TIE` of 1
    apart : for each case that is neither, a text with the scene, the accuracy and the two integrators
    """

    pairs: int
    same: int
    tied: int
    apart: tuple[str, ...]


def agreement(finals: pd.DataFrame, times: pd.DataFrame, again: pd.DataFrame) -> Agreement:
    """Compare the fastest integrators of the joined sweeps with those of a sweep made again.

    ``finals`` has the first timing of every finalist, ``times`` the later ones, and ``again`` a row for each finalist
    of the sweep made again.  Two integrators of which one was no finalist in the joined sweeps are not tied.
    """
    case = ["scene", "accuracy"]
    table = sweeps(finals, times)
    mean = _joined_seconds(table)
    first = mean.loc[mean.groupby(case)["mean"].idxmin()].set_index(case)["integrator"]
    second = again.loc[again.groupby(case)["seconds"].idxmin()].set_index(case)["integrator"]
    both = first.index.intersection(second.index)
    seconds = table.droplevel("side")
    differ = [key for key in both if first[key] != second[key]]
    known = [key for key in differ if (*key, second[key]) in seconds.index]
    one, other = (seconds.loc[[(*key, names[key]) for key in known], list(JOINED)] for names in (first, second))
    ratios = pd.DataFrame(other.to_numpy() / one.to_numpy(), columns=list(JOINED))
    ratios = pd.concat([pairs(table), ratios.assign(shorter=one.mean(axis=1).to_numpy())], ignore_index=True)
    interval = join_sweeps(ratios, ratios["shorter"]).tail(len(known))
    tied = [key for key, low in zip(known, interval["low"], strict=True) if low <= TIE]
    apart = (f"{s} to {a:g} ({first[s, a]}, then {second[s, a]})" for s, a in differ if (s, a) not in tied)
    return Agreement(len(both), len(both) - len(differ), len(tied), tuple(apart))


def join_choices(front: pd.DataFrame, finals: pd.DataFrame, times: pd.DataFrame | None) -> pd.DataFrame:
    """Select the fastest integrator of each side, with times and ratio from the joined timings.

    The result has the rows and columns of ``front``, the fastest by the first timing; it is ``front`` itself if there
    is only one timing.
    """
    if times is None or "sweep" not in times or not (times["sweep"] == JOINED[1]).any():
        return front
    table = sweeps(finals, times)
    interval = join_sweeps(table, table[JOINED[0]])
    ratios = pairs(table)
    paid = join_sweeps(ratios, ratios["shorter"]).set_axis(["ratio", "ratio low", "ratio high"], axis=1)
    paid = paid.set_index(pd.MultiIndex.from_frame(ratios[["scene", "accuracy"]]))
    rows = finals.set_index(KEY)
    out = front.copy()
    for side in (OURS, PEERS):
        mine = interval[interval.index.get_level_values("side") == side]
        best = mine.groupby(["scene", "accuracy"])["value"].idxmin()
        for k, row in out.iterrows():
            key = best.get((row["scene"], row["accuracy"]))
            if key is None or any(np.isnan(mine.loc[key])):
                continue
            told = dict(zip(("seconds", "low", "high"), mine.loc[key], strict=True))
            for name in SHOWN:
                value = told.get(name, key[-1] if name == "integrator" else rows.loc[key].get(name))
                out.loc[k, f"{side} {name}"] = value
    for k, row in out.iterrows():
        key = (row["scene"], row["accuracy"])
        if key in paid.index and not paid.loc[key].isna().any():
            out.loc[k, list(paid.columns)] = paid.loc[key].to_numpy()
    return out


_last: list = [(), None]


def of_choices(*names: str) -> Callable:
    """Decorator: turn a function of the table of fastest integrators and the tables ``names`` into one of ``data``.

    ``data`` maps a table's name to the table.  Times and ratios of the fastest integrators are joined from several
    timings (`join_choices`); the result is None if a table is missing.
    """

    def decorate(function: Callable) -> Callable:
        of_tables = of(CHOICES, *names)(function)

        @wraps(function)
        def from_data(data: Data, *more: Any) -> Any:
            given = [data(name) for name in (CHOICES, FINALS, TIMES)]

            def with_settled(name: str) -> pd.DataFrame | None:
                if name != CHOICES or given[0] is None or given[1] is None:
                    return data(name)
                if len(_last[0]) != 3 or any(a is not b for a, b in zip(_last[0], given, strict=True)):
                    _last[:] = given, join_choices(*given)
                return _last[1]

            return of_tables(with_settled, *more)

        return from_data

    return decorate
