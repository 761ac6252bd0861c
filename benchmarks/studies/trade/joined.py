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

from math import inf

import numpy as np
import pandas as pd

from phasebench.benchmarks.ladder.choice import TIE, choices
from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.page.page import Data, of

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


def sweeps(finals: pd.DataFrame, times: pd.DataFrame) -> pd.DataFrame:
    """The seconds of every finalist in each of three timings, NaN where one was not made, by `KEY`."""
    both = pd.concat([finals[[*KEY, "seconds"]].assign(sweep=1), times[[*KEY, "seconds", "sweep"]]])
    table = both.pivot_table(index=KEY, columns="sweep", values="seconds", aggfunc="last")
    return table[table.index.isin(finals.set_index(KEY).index)].reindex(columns=[*JOINED, CHECK])


def _fastest(table: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """The finalist of the least geometric mean of the joined timings in each group: the columns of `KEY`."""
    mean = np.exp(np.log(table[JOINED]).mean(axis=1)).rename("mean").reset_index()
    return mean.loc[mean.groupby(by)["mean"].idxmin(), KEY]


def pairs(table: pd.DataFrame) -> pd.DataFrame:
    """Our best time over the best peer's in each timing, and the ``shorter`` of the two: a row for each case."""
    best = table.loc[pd.MultiIndex.from_frame(_fastest(table, [*CASE, "side"]))].reset_index(["side", "integrator"])
    ours, peers = (best[best["side"] == side] for side in (OURS, PEERS))
    both = ours.index.intersection(peers.index)
    ours, peers = ours.loc[both], peers.loc[both]
    names = pd.DataFrame({f"{OURS} integrator": ours["integrator"], f"{PEERS} integrator": peers["integrator"]})
    shorter = np.fmin(ours[JOINED].mean(axis=1), peers[JOINED].mean(axis=1)).rename("shorter")
    columns = [*JOINED, CHECK]
    return pd.concat([shorter, names, ours[columns] / peers[columns]], axis=1).reset_index()


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
    first = _fastest(table, CASE).set_index(CASE)["integrator"].rename("first")
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


def _join_choices(front: pd.DataFrame, finals: pd.DataFrame, times: pd.DataFrame) -> pd.DataFrame:
    """The table of fastest integrators with those of the joined timings, their times and ratios."""
    table = sweeps(finals, times)
    interval = join_sweeps(table, table[JOINED[0]]).rename(columns={"value": "seconds"}).dropna()
    rows = interval.join(finals.set_index(KEY).drop(columns=["seconds", "low", "high"])).reset_index()
    best = rows.loc[rows.groupby([*CASE, "side"])["seconds"].idxmin()].set_index(CASE)
    ratios = pairs(table)
    paid = join_sweeps(ratios, ratios["shorter"]).set_axis(["ratio", "ratio low", "ratio high"], axis=1)
    parts = [best[best["side"] == side].reindex(columns=SHOWN).add_prefix(f"{side} ") for side in (OURS, PEERS)]
    out = front.set_index(CASE)
    for part in (*parts, paid.set_index(pd.MultiIndex.from_frame(ratios[CASE])).dropna()):
        out.loc[out.index.intersection(part.index), part.columns] = part
    return out.reset_index()[front.columns]


_last: list = []


def joined(data: Data) -> pd.DataFrame | None:
    """The fastest integrator of each side in each case by the joined timings, with the faster side in ``cheaper``.

    They are those of the first timing if there is only one.
    """
    front, finals, times = tables = [data(name) for name in (CHOICES, FINALS, TIMES)]
    if front is None or front.empty:
        return None
    if not _last or any(a is not b for a, b in zip(_last[0], tables, strict=True)):
        several = finals is not None and times is not None and JOINED[1] in set(times.get("sweep", ()))
        _last[:] = tables, choices(_join_choices(front, finals, times) if several else front)
    return _last[1]


@of(joined)
def cases(found: pd.DataFrame) -> pd.DataFrame:
    """The cases in which a method of ours or a peer reaches the accuracy.

    The column ``ratio`` is our time over the best peer's; it is 0 if only a method of ours reaches the accuracy, inf if
    only a peer does.
    """
    ours, peer = (found[f"{side} integrator"].notna() for side in (OURS, PEERS))
    alone = np.select([ours & ~peer, peer & ~ours], [0.0, inf], np.nan)
    told = found.assign(**{c: found[c].where(ours & peer, alone) for c in ("ratio", "ratio low", "ratio high")})
    return told[ours | peer].reset_index(drop=True)
