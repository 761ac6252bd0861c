"""The report page on ensembles: the gain of SIMD lanes and of cores, costs compared with heyoka's batches, maps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure import timing
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, of, once
from phasebench.benchmarks.page.verdict import EVERY, NONE, Count, Range, Verdict, at_least
from phasebench.benchmarks.store.arrays import unpack

from . import against, ceiling, lanes, maps
from .compare import cost_table

if TYPE_CHECKING:
    from pathlib import Path

    from phasebench.benchmarks.page.page import Data

#: The wanted speed-up: the smaller of this share of the number of cores and this share of a bare loop's speed-up.
WANTED, OF_CEILING = 0.9, 0.95
_compared = once(cost_table)


def _wide(frame: pd.DataFrame) -> pd.DataFrame:
    """Select the ensembles that ran in SIMD lanes (orbits side by side) and of which every orbit reached its end."""
    return frame[frame["in lanes"].astype(bool) & (frame["status"] == "ok")]


@of(lanes.TABLE)
def gain(frame: pd.DataFrame) -> Verdict | None:
    """Judge whether SIMD lanes are faster than the scalar kernel on one core: the ratio's interval exceeds 1.

    ``frame`` is the table of `lanes`, a row for each ensemble; None if none ran in lanes.
    """
    wide = _wide(frame)
    if wide.empty:
        return None
    least = wide.loc[wide["gain, low"].idxmin()]
    return Verdict(
        "On one core lanes are faster than the scalar kernel",
        Count(int((wide["gain, low"] > 1).sum()), len(wide)),
        EVERY,
        "ensembles",
        where=f"{_name(least)}: {number(least['gain'])} times as fast",
    )


def _name(row: pd.Series) -> str:
    return f"{row['method']}, {row['problem']}"


@of(against.TABLE)
def beside_heyoka(frame: pd.DataFrame) -> Verdict | None:
    """Judge whether an orbit of an ensemble costs no more than in heyoka's batches at equal error.

    ``frame`` is the table of `against`, a row for each run; None if no run reaches one of the errors.
    """
    judged = _reached_rows(frame)
    if judged.empty:
        return None
    behind = judged[judged["cheaper"] == timing.PEERS]
    parts = [
        f"{problem} from {number(part['error'].max())} ({_range(part['ours / heyoka'])})"
        for problem, part in behind.groupby("problem", sort=False)
    ]
    return Verdict(
        "At equal error no orbit is dearer than in heyoka's batches",
        Count(len(behind), len(judged)),
        NONE,
        "pairs of a problem and an error",
        where=join_list(parts, 4) if parts else "",
    )


def _reached_rows(frame: pd.DataFrame) -> pd.DataFrame:
    """Compare this project's and heyoka's costs of an orbit: a row for each problem and error that one of them reaches.

    ``frame`` is the table of `against`, a row for each run.
    """
    table = _compared(frame)
    return table[table["cheaper"] != timing.NONE]


def _range(ratios: pd.Series) -> str:
    known = ratios.dropna()
    if known.empty:
        return "not reached"
    return f"{known.min():.2g} to {known.max():.2g} times" + (", or not reached" if len(known) < len(ratios) else "")


@of(lanes.TABLE)
def parallel(frame: pd.DataFrame) -> Verdict | None:
    """Judge whether all cores speed up every ensemble by nearly the number of cores, or as much as a bare loop.

    ``frame`` is the table of `lanes`; the bare loop, without memory access, shows the most that these cores can give.
    """
    bare = frame["method"] == lanes.CEILING
    ran = frame[(frame["status"] == "ok") & ~bare]
    if ran.empty:
        return None
    wanted = min([WANTED * int(ran["cores"].max()), *(OF_CEILING * frame.loc[bare, "speed-up"])])
    gains = ran["speed-up"].fillna(0.0)  # what was not measured gains nothing
    return Verdict(
        "All cores carry every ensemble nearly as fast as they could",
        Range(gains.min(), gains.max()),
        at_least(wanted),
        "times one core",
        where=_name(ran.loc[gains.idxmin()]),
    )


@of(lanes.TABLE, against.TABLE)
def answer(frame: pd.DataFrame, costs: pd.DataFrame) -> str | None:
    """Write the page's answer: how much SIMD lanes gain, and how often an orbit costs less than in heyoka's batches.

    ``frame`` is the table of `lanes`, ``costs`` that of `against`; None if no ensemble ran in lanes.
    """
    wide, judged = _wide(frame), _reached_rows(costs)
    if wide.empty:
        return None
    ours, behind = ((judged["cheaper"] == side).sum() for side in (timing.OURS, timing.PEERS))
    return (
        f"SIMD lanes run {lanes.ORBITS} orbits {number(wide['gain'].min(), 2)} to {number(wide['gain'].max(), 2)} times as "
        f"fast as singly; at equal error an orbit costs less than heyoka's in {ours} of "
        f"{len(judged)} cases, more in {behind}."
    )


@of(maps.TABLE)
def draw_maps(frame: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the two maps of Henon-Heiles: the Poincare section, and how chaotic each start of the grid is.

    ``frame`` is the table of `maps`; the figure is saved in ``folder``.
    """
    section, grid = (frame[frame["map"] == name].sort_values("line") for name in (maps.SECTION, maps.GRID))
    with style.settings():
        figure, ((left, right),) = style.panels(1, 2, 3.4, sharey=True)
        for k, row in enumerate(section.itertuples()):
            colour = style.CURVES[k % len(style.CURVES)][0]
            left.plot(unpack(row.x), unpack(row.y), ".", color=colour, markersize=1.2, markeredgewidth=0)
        (x0, y0), (x1, y1) = maps.CORNERS
        image = None
        if len(grid):
            values = np.array([unpack(row.y) for row in grid.itertuples()])
            image = right.imshow(values, origin="lower", extent=(x0, x1, y0, y1), aspect="auto", cmap="cividis")
            figure.colorbar(image, ax=right, label="ln of the growth of a distance")
        left.set(xlim=(x0, x1), ylim=(y0, y1), xlabel="q2", ylabel="p2", title="section q1 = 0, p1 > 0")
        right.set(xlabel="q2", title="chaos of the starts")
    crossings = int(section["crossings"].sum())
    seconds = [number(part["seconds"].iloc[0]) for part in (section, grid) if len(part)]
    caption = (
        f"Left: {len(section)} orbits of energy 1/8, {crossings:,} crossings. Right: a grid of {maps.SIDE} x "
        f"{maps.SIDE} starts, each beside a neighbour at {maps.APART:g}, at t = {maps.T_GRID:g}: blue is regular, "
        "yellow chaotic. "
        f"Integrated in {' and '.join(seconds)} s."
    )
    return [Picture(style.save(figure, folder, "ensembles.png"), "maps of Henon-Heiles", caption)]


@of(against.TABLE)
def draw_costs(frame: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the error of the worst orbit over the cost of an orbit, a panel for each problem.

    ``frame`` is the table of `against`, a row for each run; the figure is saved in ``folder``.
    """
    problems, looks = list(dict.fromkeys(frame["problem"])), style.looks()
    with style.settings():
        figure, (panels,) = style.panels(1, len(problems), 3.0, sharey=False)
        names = list(dict.fromkeys(frame["integrator"]))
        for axes, problem in zip(panels, problems, strict=True):
            for look, name in zip(looks, names, strict=False):
                part = frame[(frame["problem"] == problem) & (frame["integrator"] == name) & (frame["error"] > 0)]
                axes.loglog(part["us"], part["error"], label=name, **look)
            axes.set(title=problem, xlabel="µs an orbit")
            axes.set_ylim(1e-15, 10)
            axes.grid(color="0.93", linewidth=0.5)
        panels[0].set_ylabel("error of the worst orbit")
        style.legend_above(figure, panels[0], 4)
    caption = f"The worst orbit's error at t = {against.T_END:g} over the time of an orbit, on one core."
    return [Picture(style.save(figure, folder, "ensembles-costs.png"), "cost against error", caption)]


def draw(data: Data, folder: Path) -> list[Picture]:
    """Draw the maps of Henon-Heiles, and error over cost beside heyoka; figures without data are left out."""
    return [*(draw_maps(data, folder) or ()), *(draw_costs(data, folder) or ())]


@of(lanes.TABLE)
def table(frame: pd.DataFrame) -> Table:
    """Make the page's table: for each ensemble the time of an orbit's step, and the speed-ups by lanes and by cores.

    ``frame`` is the table of `lanes`, a row for each ensemble.
    """
    columns = ["problem", "method", "in lanes", "ns scalar", "ns ensemble", "gain", "gain, low", "gain, high"]
    columns += ["ns all cores", "cores", "speed-up", "speed-up, low", "speed-up, high", "largest difference"]
    caption = (
        "Nanoseconds of an orbit's step; medians. Gain: lanes over the scalar kernel; speed-up: all cores over one; "
        "both taken round by round with 95 % intervals. The largest difference is that of the ends from the scalar "
        "kernel's."
    )
    return Table(frame[columns].head(ROWS), caption)


@of(against.TABLE)
def full_table(frame: pd.DataFrame) -> pd.DataFrame:
    """Make the long table: this project's and heyoka's cheapest run for every problem and error, and the cost ratio.

    ``frame`` is the table of `against`, a row for each run.
    """
    return _compared(frame)


PAGE = Page(
    id="ensembles",
    question="What does an orbit cost when there are thousands of them?",
    tables=(lanes.TABLE, against.TABLE, maps.TABLE),
    setting=(
        f"{lanes.ORBITS} orbits that start within {lanes.SPREAD} of a problem's own, in SIMD lanes, on one core and "
        f"on all; h = {lanes.H}.",
        "The scalar kernel is the same source for one orbit; both sum with compensation and solve stages to round-off.",
        f"Beside heyoka's batches: {against.JUDGED} distinct orbits to t = {against.T_END:g}, one core, its own "
        "number of lanes and twice it, tolerances at most a factor of ten apart.",
        f"Section and grid of Hénon–Heiles at H = 1/8: {maps.METHOD}, h = {maps.STEP}, to t = {maps.LONG:g} and "
        f"{maps.T_GRID:g}.",
        "Seconds are from arrays of starts to arrays of ends, warm: layout, checks and threads are in them.",
    ),
    verdicts=(gain, beside_heyoka, parallel),
    answer=answer,
    figures=draw,
    table=table,
    whole=full_table,
    limits=(
        f"As fast as all cores could: {100 * WANTED:g} % of their number, or {100 * OF_CEILING:g} % of what they "
        f"give a bare loop, where that is less. The loop is leapfrog steps of {ceiling.WIDTH} oscillators, compiled, "
        "as many on each core as on one.",
        "Times are the machine's own; other work on its cores changes them, those on all cores most.",
        "The error is the worst orbit's. The cost at an error is taken by a power law between two runs whose errors "
        f"are less than a factor {against.SPAN:g} apart; where they are farther apart it is that of the finer one. "
        "Costs whose intervals overlap are a tie.",
        "The scalar kernel's time is of the problem's own orbit; lanes go on until the slowest of their orbits is "
        "solved.",
    ),
    command="pytest benchmarks/experiments/ensembles",
)
