"""Ensembles: the page."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.experiments.talks.measure import points
from phasebench.benchmarks.measure import timing
from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of, once

from . import against, ceiling, lanes, maps
from .compare import compared

#: What all cores are wanted to give, of their number, or of what they give a bare loop, where that is less.
WANTED, OF_CEILING = 0.9, 0.95
_compared = once(compared)


@of(lanes.TABLE)
def gain(frame: pd.DataFrame) -> Verdict | None:
    """What lanes gain on one core."""
    wide = frame[frame["in lanes"].astype(bool) & (frame["status"] == "ok")]
    if wide.empty:
        return None
    low, high = (wide.loc[getattr(wide["gain"], f)()] for f in ("idxmin", "idxmax"))
    slower = wide[~(wide["gain, low"] > 1)]
    same = int((wide["largest difference"] == 0).sum())
    gains = f"In lanes one core takes an orbit's step {low['gain']:.1f} ({_name(low)}) to {high['gain']:.1f}"
    text = f"{gains} times ({_name(high)}) as fast as the scalar kernel"
    text += f"; not surely faster: {listed([_name(r) for _, r in slower.iterrows()], 4)}" if len(slower) else ""
    text += f"; {same} of {len(wide)} ensembles end where it ends to the last bit"
    text += "" if same == len(wide) else f", the others within {number(wide['largest difference'].max())}"
    return Verdict(f"{text}.", slower.empty, f"Lanes gain {low['gain']:.1f} to {high['gain']:.1f}.")


def _name(row) -> str:
    return f"{row['method']}, {row['problem']}"


@of(against.TABLE)
def beside_heyoka(frame: pd.DataFrame) -> Verdict | None:
    """Whose orbit is cheaper at equal error."""
    table = _compared(frame)
    judged = table[table["cheaper"] != timing.NONE]
    if judged.empty:
        return None
    behind = judged[judged["cheaper"] == timing.PEERS]
    ahead = judged[judged["cheaper"] == timing.OURS]
    counts = f"At equal error an orbit in our lanes is cheaper than in heyoka's in {len(ahead)} of {len(judged)} cells"
    text = f"{counts}, in {len(judged) - len(ahead) - len(behind)} the intervals overlap"
    parts = [
        f"{problem} from {number(part['error'].max())} ({_range(part['ours / heyoka'])})"
        for problem, part in behind.groupby("problem", sort=False)
    ]
    text += f"; behind on {listed(parts, 4)}" if parts else "; behind nowhere"
    return Verdict(f"{text}.", behind.empty, f"{counts}.")


def _range(ratios: pd.Series) -> str:
    known = ratios.dropna()
    if known.empty:
        return "not reached"
    return f"{known.min():.2g} to {known.max():.2g} times" + (", or not reached" if len(known) < len(ratios) else "")


@of(lanes.TABLE, maps.TABLE)
def parallel(frame: pd.DataFrame, drawn: pd.DataFrame) -> Verdict | None:
    """What all cores give, and how long the maps take."""
    bare = frame["method"] == lanes.CEILING
    ran = frame[(frame["status"] == "ok") & ~bare]
    if ran.empty:
        return None
    cores = int(ran["cores"].max())
    best = frame.loc[bare, "speed-up"]
    wanted = min([WANTED * cores, *(OF_CEILING * best)])
    short = ran[~(ran["speed-up"] >= wanted)]
    text = f"{cores} cores are {ran['speed-up'].min():.2f} to {ran['speed-up'].max():.2f} times as fast as one"
    text += f", {best.max():.2f} times on a bare loop" if len(best) else ""
    text += f" (wanted: {wanted:.2f}"
    text += f"; less: {listed([_name(r) for _, r in short.iterrows()], 3)})" if len(short) else ")"
    seconds = drawn.groupby("map")["seconds"].first()
    text += "".join(
        f"; the {what} took {number(seconds[key])} s"
        for key, what in ((maps.SECTION, "section"), (maps.GRID, "map of chaos"))
        if key in seconds
    )
    return Verdict(f"{text}.", short.empty, f"{cores} cores: {ran['speed-up'].median():.2f} times one in the median.")


@of(maps.TABLE)
def draw_maps(frame: pd.DataFrame, folder) -> list[Picture]:
    """The section, and the chaos of the grid."""
    section, grid = (frame[frame["map"] == name].sort_values("line") for name in (maps.SECTION, maps.GRID))
    with style.settings():
        figure, ((left, right),) = style.panels(1, 2, 3.4, sharey=True)
        for k, row in enumerate(section.itertuples()):
            colour = style.CURVES[k % len(style.CURVES)][0]
            left.plot(points(row.x), points(row.y), ".", color=colour, markersize=1.2, markeredgewidth=0)
        (x0, y0), (x1, y1) = maps.CORNERS
        image = None
        if len(grid):
            values = np.array([points(row.y) for row in grid.itertuples()])
            image = right.imshow(values, origin="lower", extent=(x0, x1, y0, y1), aspect="auto", cmap="cividis")
            figure.colorbar(image, ax=right, label="ln of the growth of a distance")
        left.set(xlim=(x0, x1), ylim=(y0, y1), xlabel="q2", ylabel="p2", title="section q1 = 0, p1 > 0")
        right.set(xlabel="q2", title="chaos of the starts")
    crossings = int(section["crossings"].sum())
    caption = (
        f"Left: {len(section)} orbits of energy 1/8, {crossings:,} crossings. Right: a grid of {maps.SIDE} x {maps.SIDE} "
        f"starts, each beside a neighbour at {maps.APART:g}, at t = {maps.T_GRID:g}: blue is regular, yellow chaotic."
    )
    return [Picture(style.save(figure, folder, "ensembles.png"), "maps of Henon-Heiles", caption)]


@of(against.TABLE)
def draw_costs(frame: pd.DataFrame, folder) -> list[Picture]:
    """Cost against error."""
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
            style.plain_ticks(axes.xaxis)
        panels[0].set_ylabel("error of the worst orbit")
        style.legend_above(figure, panels[0], 4)
    caption = f"The worst orbit's error at t = {against.T_END:g} against the cost of an orbit, on one core."
    return [Picture(style.save(figure, folder, "ensembles-costs.png"), "cost against error", caption)]


def draw(data, folder) -> list[Picture]:
    """Both figures, where there are rows."""
    return [*(draw_maps(data, folder) or ()), *(draw_costs(data, folder) or ())]


@of(lanes.TABLE)
def table(frame: pd.DataFrame) -> Table:
    """What a step costs."""
    columns = ["problem", "method", "in lanes", "ns scalar", "ns ensemble", "gain", "gain, low", "gain, high"]
    columns += ["ns all cores", "cores", "speed-up", "speed-up, low", "speed-up, high", "largest difference"]
    caption = "Nanoseconds of an orbit's step; medians, ratios taken round by round with their 95 % intervals."
    return Table(frame[columns].head(ROWS), caption)


@of(against.TABLE)
def whole(frame: pd.DataFrame) -> pd.DataFrame:
    """Whose orbit is cheaper in every cell."""
    return _compared(frame)


PAGE = Page(
    id="ensembles",
    question="What does an orbit cost when there are thousands of them?",
    tables=(lanes.TABLE, against.TABLE, maps.TABLE),
    setting=(
        f"{lanes.ORBITS} orbits that start within {lanes.SPREAD} of a problem's own, in SIMD lanes, on one core and on all; h = {lanes.H}.",
        "The scalar kernel is the same source for one orbit; both sum with compensation and solve stages to round-off.",
        f"Beside heyoka's batches: {against.JUDGED} distinct orbits to t = {against.T_END:g}, one core, its own number of lanes and twice it, tolerances a factor of ten apart or less.",
        f"Section and grid of Henon-Heiles at H = 1/8: {maps.METHOD}, h = {maps.STEP}, to t = {maps.LONG:g} and {maps.T_GRID:g}.",
        "Seconds are from arrays of starts to arrays of ends, warm: layout, checks and threads are in them.",
    ),
    verdicts=(gain, beside_heyoka, parallel),
    figures=draw,
    table=table,
    whole=whole,
    limits=(
        f"The bare loop is leapfrog steps of {ceiling.WIDTH} oscillators, compiled, as many on each core as on one.",
        "Times are the machine's own; a neighbour on its cores moves them, and those on all cores most.",
        f"The error is the worst orbit's; the cost at an error is taken by a power law between two rungs whose errors are less than a factor {against.SPAN:g} apart; "
        "where they are farther apart it is that of the finer one.",
        "The scalar kernel's time is of the problem's own orbit; lanes go on until the slowest of their orbits is solved.",
    ),
    command="pytest benchmarks/experiments/ensembles",
)
