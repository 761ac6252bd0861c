"""What does the integration of one orbit cost in an ensemble of thousands?"""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.ladder.choice import SPAN
from phasebench.benchmarks.measure import timing
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import of
from phasebench.benchmarks.page.shared import picture, together, worst
from phasebench.benchmarks.page.study import Claim, Number, Runs, Shown, Study, over
from phasebench.benchmarks.page.verdict import EVERY, NONE, Between, at_least, at_most
from phasebench.benchmarks.store.arrays import unpack
from phasebench.benchmarks.store.cells import ALONE, ProblemKey
from phasebench.integrators.registry import method

from . import against, lanes, maps

#: The wanted speed-up: the smaller of this share of the number of cores and this share of a bare loop's speed-up.
WANTED, OF_BARE = 0.9, 0.95
WIDE, ORBITS_OF = "`in lanes` and status == 'ok'", f"method != '{lanes.BARE}'"


@of(against.TABLE)
def reached(rows: pd.DataFrame) -> pd.DataFrame:
    """Costs of both sides at each problem and error that one of them reaches."""
    found = against.compared(rows)
    return found[found["cheaper"] != timing.NONE]


def where_behind(rows: pd.DataFrame) -> str:
    """The problems on which heyoka is cheaper, from which error on, and by how much."""
    parts = []
    for problem, part in rows[rows["cheaper"] == timing.PEERS].groupby("problem", sort=False):
        known = part["ours / heyoka"].dropna()
        by = f"{known.min():.2g} to {known.max():.2g} times" if len(known) else ""
        by += (", or " if by else "") + "not reached" if len(known) < len(part) else ""
        parts.append(f"{problem} from {number(part['error'].max())} ({by})")
    return join_list(parts, 4) if parts else ""


def speed_up(rows: pd.DataFrame) -> pd.Series:
    """The speed-up of each ensemble on all cores; what was not measured gains nothing."""
    return rows[(rows["status"] == "ok") & (rows["method"] != lanes.BARE)]["speed-up"].fillna(0.0)


def nearly(rows: pd.DataFrame) -> Between:
    """Condition: as fast as all cores could nearly be, by their number or by the bare loop."""
    bare = rows.loc[rows["method"] == lanes.BARE, "speed-up"]
    return at_least(min([WANTED * int(rows["cores"].max()), *(OF_BARE * bare)]))


@picture(maps.TABLE, "ensembles", "maps of Henon-Heiles")
def _draw_maps(frame: pd.DataFrame) -> tuple[style.Figure, str]:
    section, grid = (frame[frame["map"] == name].sort_values("line") for name in (maps.SECTION, maps.GRID))
    figure, ((left, right),) = style.panels(1, 2, 3.4, sharey=True)
    for k, row in enumerate(section.itertuples()):
        colour = style.CURVES[k % len(style.CURVES)][0]
        left.plot(unpack(row.x), unpack(row.y), ".", color=colour, markersize=1.2, markeredgewidth=0)
    (x0, y0), (x1, y1) = maps.CORNERS
    if len(grid):
        values = np.array([unpack(row.y) for row in grid.itertuples()])
        image = right.imshow(values, origin="lower", extent=(x0, x1, y0, y1), aspect="auto", cmap="cividis")
        figure.colorbar(image, ax=right, label="ln of the growth of a distance")
    left.set(xlim=(x0, x1), ylim=(y0, y1), xlabel="q2", ylabel="p2", title="section q1 = 0, p1 > 0")
    right.set(xlabel="q2", title="chaos of the starts")
    seconds = [number(part["seconds"].iloc[0]) for part in (section, grid) if len(part)]
    return figure, (
        f"Left: {len(section)} orbits of energy 1/8, {int(section['crossings'].sum()):,} crossings. Right: a grid of "
        f"{maps.SIDE} x {maps.SIDE} starts, each beside a neighbour at {maps.APART:g}, at t = {maps.T_GRID:g}: blue is "
        f"regular, yellow chaotic. Integrated in {' and '.join(seconds)} s."
    )


@picture(
    against.TABLE, "ensembles-costs", "cost against error",
    f"The worst orbit's error at t = {against.T_END:g} over the time of an orbit, on one core.",
)  # fmt: skip
def _draw_costs(frame: pd.DataFrame) -> style.Figure:
    names, reached = frame["integrator"].unique(), frame[frame["error"] > 0].groupby("problem", sort=False)
    of_each = style.curves("integrator", "us", "error", names, sort=False, most=9)
    figure = style.row(reached, of_each, 3.0, "µs an orbit", "error of the worst orbit", legend=4)
    for axes in figure.axes:
        axes.set_ylim(1e-15, 10)
    return figure


STUDY = Study(
    id="ensembles",
    place=430,
    question="What does an orbit cost when there are thousands of them?",
    answer=f"SIMD lanes run {lanes.ORBITS} orbits {{gains.low}} to {{gains.high}} times as fast as singly; at equal "
    "error an orbit costs less than heyoka's in {cheaper} of {heyoka.of} cases, more in {heyoka.n}.",
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
    runs=(
        Runs(lanes.TABLE, lanes.costs, lanes.KEYS, needs=lanes.needs, where=ALONE, own=True, quick=lanes.KEYS[:1]),
        Runs(against.TABLE, against.against, over(problem=against.PROBLEMS), needs=against.NEEDS, where=ALONE,
             own=True),
        Runs(maps.TABLE, maps.maps, over(map=(maps.SECTION, maps.GRID)),
             needs=(method(maps.METHOD), ProblemKey(maps.PROBLEM)), where=ALONE, own=True),
    ),
    claims={
        "gain": Claim(
            "On one core lanes are faster than the scalar kernel",
            lanes.TABLE, "`gain, low` > 1", EVERY, rows=WIDE, unit="ensembles",
            where=worst("-`gain, low`", "{method}, {problem}: {gain:.3g} times as fast"),
        ),
        "heyoka": Claim(
            "At equal error no orbit is dearer than in heyoka's batches",
            reached, f"cheaper == '{timing.PEERS}'", NONE, unit="pairs of a problem and an error", where=where_behind,
        ),
        "cores": Claim(
            "All cores carry every ensemble nearly as fast as they could",
            lanes.TABLE, speed_up, nearly, unit="times one core", where="{method}, {problem}", span=True,
        ),
    },
    numbers={
        "gains": Claim("lanes gain", lanes.TABLE, "gain", at_least(1), rows=WIDE, span=True),
        "cheaper": Number(reached, f"cheaper == '{timing.OURS}'", take=pd.Series.sum),
    },
    checks={
        "arrive": Claim("Every orbit of an ensemble arrives", lanes.TABLE, "status == 'ok'", rows=ORBITS_OF),
        "ends": Claim("Orbits end where the scalar kernel ends them, but for last bits of sines",
                      lanes.TABLE, "`largest difference`", at_most(1e-11), rows=ORBITS_OF),
        "errors": Claim("Both sides reach small errors", against.TABLE,
                        lambda rows: rows.groupby(["problem", "side"])["error"].min(), at_most(1e-6)),
        "energy": Claim("States on the section have the energy of the start", maps.TABLE, "`energy error`",
                        at_most(1e-5), rows=f"map == '{maps.SECTION}'"),
    },
    figure=together(_draw_maps, _draw_costs),
    shown=Shown(
        lanes.TABLE,
        ("problem", "method", "in lanes", "ns scalar", "ns ensemble", "gain", "gain, low", "gain, high",
         "ns all cores", "cores", "speed-up", "speed-up, low", "speed-up, high", "largest difference"),
        "Nanoseconds of an orbit's step; medians. Gain: lanes over the scalar kernel; speed-up: all cores over one; "
        "both taken round by round with 95 % intervals. The largest difference is that of the ends from the scalar "
        "kernel's.",
    ),
    whole=of(against.TABLE)(against.compared),
    limits=(
        f"As fast as all cores could: {100 * WANTED:g} % of their number, or {100 * OF_BARE:g} % of what they "
        f"give a bare loop, where that is less. The loop is leapfrog steps of {lanes.WIDTH} oscillators, compiled, "
        "as many on each core as on one.",
        "Times are the machine's own; other work on its cores changes them, those on all cores most.",
        "The error is the worst orbit's. The cost at an error is taken by a power law between two runs whose errors "
        f"are less than a factor {SPAN:g} apart; where they are farther apart it is that of the finer one. "
        "Costs whose intervals overlap are a tie.",
        "The scalar kernel's time is of the problem's own orbit; lanes go on until the slowest of their orbits is "
        "solved.",
    ),
)  # fmt: skip
