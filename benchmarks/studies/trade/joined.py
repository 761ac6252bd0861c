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

import numpy as np
import pandas as pd

from phasebench.benchmarks.ladder.choice import TIE, choices
from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.page.page import Data

from .front import CHOICES, FINALS, SHOWN, TIMES

#: The share of further sweeps that an interval should contain.
LEVEL = 0.95
#: Bounds in seconds between the classes of times; differences are pooled in each class.
CLASSES = (25e-6, 100e-6)
#: A class with fewer differences than this uses those of all classes.
FEW = 20
#: The sweeps that are joined for the pages, and the sweep that checks the intervals.
JOINED, CHECK = [1, 2], 3
CASE, KEY = ["scene", "accuracy"], ["scene", "accuracy", "side", "integrator"]


def sweeps(finals: pd.DataFrame, times: pd.DataFrame | None) -> pd.DataFrame:
    """The seconds of every finalist in each of three timings, NaN where one was not made, by `KEY`."""
    parts = [finals[[*KEY, "seconds"]].assign(sweep=1)]
    if times is not None and len(times):
        parts.append(times[[*KEY, "seconds", "sweep"]])
    table = pd.concat(parts).pivot_table(index=KEY, columns="sweep", values="seconds", aggfunc="last")
    return table[table.index.isin(finals.set_index(KEY).index)].reindex(columns=[*JOINED, CHECK])


def joined_seconds(table: pd.DataFrame) -> pd.DataFrame:
    """The columns of `KEY` and ``mean``, the geometric mean of the joined timings."""
    return np.exp(np.log(table[JOINED]).mean(axis=1)).rename("mean").reset_index()


def fastest(table: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """The finalist of the least joined time in each group."""
    mean = joined_seconds(table)
    return mean.loc[mean.groupby(by)["mean"].idxmin(), KEY]


def pairs(table: pd.DataFrame) -> pd.DataFrame:
    """Our best time over the best peer's in each timing, and the ``shorter`` of the two: a row for each case."""
    best = table.loc[pd.MultiIndex.from_frame(fastest(table, [*CASE, "side"]))].reset_index(["side", "integrator"])
    ours, peers = (best[best["side"] == side] for side in (OURS, PEERS))
    both = ours.index.intersection(peers.index)
    ours, peers = ours.loc[both], peers.loc[both]
    shorter = np.fmin(ours[JOINED].mean(axis=1), peers[JOINED].mean(axis=1)).rename("shorter")
    names = {f"{side} integrator": of["integrator"] for side, of in ((OURS, ours), (PEERS, peers))}
    columns = [*JOINED, CHECK]
    return pd.concat([shorter, pd.DataFrame(names), ours[columns] / peers[columns]], axis=1).reset_index()


def join_sweeps(values: pd.DataFrame, size: pd.Series) -> pd.DataFrame:
    """Two timings of each row as a value and its prediction interval: columns ``value``, ``low``, ``high``.

    The width of an interval comes from the scatter between timings of runs that take about as long: their ``size``, in
    seconds, decides the class of a row.
    """
    logs = np.log(values[JOINED])
    middle, apart = logs.mean(axis=1).to_numpy(), (logs[JOINED[0]] - logs[JOINED[1]]).abs()
    classes = np.searchsorted(CLASSES, size.to_numpy())
    width = np.full(len(values), np.nan)
    for k in np.unique(classes):
        members = apart[classes == k].dropna()
        members = members if len(members) >= FEW else apart.dropna()
        if len(members):
            width[classes == k] = np.sqrt(3 / 4) * np.quantile(members, LEVEL)
    half = np.fmax(width, (apart / 2).to_numpy())
    ends = {"value": np.exp(middle), "low": np.exp(middle - half), "high": np.exp(middle + half)}
    return pd.DataFrame(ends, index=values.index)


def coverage(finals: pd.DataFrame, times: pd.DataFrame) -> pd.Series:
    """The share of a third timing's times, and of its ratios, in the intervals from the first two."""
    table = sweeps(finals, times)
    ratios = pairs(table)
    out = {}
    for name, values, size in (("times", table, table[JOINED[0]]), ("ratios", ratios, ratios["shorter"])):
        told = values[[*JOINED, CHECK]].notna().all(axis=1)
        interval, third = join_sweeps(values, size)[told], values.loc[told, CHECK]
        out[name] = third.between(interval["low"], interval["high"]).mean()
    return pd.Series(out)


def agreement(finals: pd.DataFrame, times: pd.DataFrame, again: pd.DataFrame) -> pd.DataFrame:
    """The fastest integrators of the joined sweeps, and those of a sweep made again: a row for each case in both.

    ``agree`` is true if they are the same or tied: the interval of their times' ratio, from the joined sweeps, comes
    within the factor `TIE` of 1.  Two integrators of which one was no finalist in the joined sweeps are not tied.
    """
    table = sweeps(finals, times)
    first = fastest(table, CASE).set_index(CASE)["integrator"].rename("first")
    second = again.loc[again.groupby(CASE)["seconds"].idxmin()].set_index(CASE)["integrator"].rename("second")
    out = pd.concat([first, second], axis=1, join="inner").reset_index()
    seconds = table[JOINED].droplevel("side")
    one, other = (seconds.reindex(pd.MultiIndex.from_frame(out[[*CASE, x]])) for x in ("first", "second"))
    ratios = pd.DataFrame(other.to_numpy() / one.to_numpy(), columns=JOINED)
    ratios["shorter"] = one.mean(axis=1).to_numpy()
    differ = ratios[(out["first"] != out["second"]) & other.notna().all(axis=1).to_numpy()]
    pooled = pd.concat([pairs(table), differ], ignore_index=True)
    low = join_sweeps(pooled, pooled["shorter"])["low"].tail(len(differ)).set_axis(differ.index)
    return out.assign(agree=(out["first"] == out["second"]) | (low.reindex(out.index) <= TIE))


def join_choices(front: pd.DataFrame, finals: pd.DataFrame, times: pd.DataFrame | None) -> pd.DataFrame:
    """The table of fastest integrators with those of the joined timings, their times and ratios.

    It is ``front`` itself, of the first timing, if there is only one.
    """
    if times is None or "sweep" not in times or not (times["sweep"] == JOINED[1]).any():
        return front
    table = sweeps(finals, times)
    interval = join_sweeps(table, table[JOINED[0]]).rename(columns={"value": "seconds"}).dropna()
    rows = interval.join(finals.set_index(KEY).drop(columns=["seconds", "low", "high"])).reset_index()
    out = front.set_index(CASE)
    for side in (OURS, PEERS):
        mine = rows[rows["side"] == side]
        best = mine.loc[mine.groupby(CASE)["seconds"].idxmin()].set_index(CASE).reindex(columns=SHOWN)
        best.columns = [f"{side} {name}" for name in SHOWN]
        out.loc[out.index.intersection(best.index), best.columns] = best
    ratios = pairs(table)
    paid = join_sweeps(ratios, ratios["shorter"]).set_axis(["ratio", "ratio low", "ratio high"], axis=1)
    paid = paid.set_index(pd.MultiIndex.from_frame(ratios[CASE])).dropna()
    out.loc[out.index.intersection(paid.index), paid.columns] = paid
    return out.reset_index()[front.columns]


_last: list = [(), None]


def joined(data: Data) -> pd.DataFrame | None:
    """The fastest integrator of each side in each case by the joined timings, with the faster side in ``cheaper``."""
    tables = front, finals, times = [data(name) for name in (CHOICES, FINALS, TIMES)]
    if front is None or front.empty:
        return None
    if len(_last[0]) != 3 or any(a is not b for a, b in zip(_last[0], tables, strict=True)):
        _last[:] = tables, choices(front if finals is None else join_choices(front, finals, times))
    return _last[1]
