"""The intervals of a drift: on series with a known drift, and on long runs of methods declared bounded or drifting."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.drift import ABOVE, LINES, SLOWEST
from phasebench.benchmarks.measure.drift_coverage import DRAWN, KINDS, SERIES, SURE, coverage
from phasebench.benchmarks.measure.metrics import CONFIDENCE
from phasebench.benchmarks.page.long_runs import NOISE, completed_runs
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Data, Table, of
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Runs, Study, rows_of
from phasebench.benchmarks.page.verdict import EVERY, Between, Range, at_least
from phasebench.integrators.record import BOUNDED, DRIFT

TABLE, RUNS = "drift_coverage", "rows"
#: The share of draws of a kind that a nominal 95 % interval should cover; at least `EACH` of those of a length and a
#: period, and `LEAST` of a scene's runs.
KIND_LEAST, MOST, EACH, LEAST = 0.93, 0.99, 0.85, 0.9
#: The share of series in which a sure drift should be seen, where the oscillation has so many periods at least.
SEEN, PERIODS = 0.95, 4
#: Controls: methods that drift but stay near the orbit, so that their intervals must exclude 0.
CONTROLS = ("rk4", "radau-iia-2")
#: Series without an oscillation, or with one of enough periods in the whole time to be told from a drift.
RESOLVED = f"(periods > {SLOWEST} or periods == 0)"


def shares(frame: pd.DataFrame) -> pd.Series:
    """The share of the drawn series whose interval covers the true drift, by kind."""
    return frame.groupby("kind", sort=False)["covered"].mean()


def judged(frame: pd.DataFrame) -> Range:
    """The least share of all kinds, and the largest of those with noise.

    What is left of a series without noise is round-off, which is over-covered.
    """
    found = shares(frame)
    noisy = [share for kind, share in found.items() if KINDS[kind].white or KINDS[kind].walk]
    return Range(found.min(), max(noisy, default=found.min()))


def farthest(frame: pd.DataFrame) -> str:
    """The kind whose share is farthest from the nominal one."""
    return (shares(frame) - CONFIDENCE).abs().idxmax()


#: The completed long runs, a function of data.
COMPLETED = of(RUNS)(completed_runs)
#: Runs on canonical systems whose drift has an interval; those of methods declared bounded, and declared to drift with
#: an energy error above round-off.
INTERVALS = "canonical and energy_drift_low == energy_drift_low"
OF_BOUNDED = f"{INTERVALS} and declared == '{BOUNDED}'"
OF_DRIFTING = f"declared == '{DRIFT}' and energy_max > {NOISE}"
#: True for an interval that excludes 0.
EXCLUDES = "sure != 0"


def controls(ran: pd.DataFrame) -> pd.Series:
    """True for a control that has an interval."""
    return pd.Series({id: id in set(ran.query(OF_DRIFTING)["id"]) for id in CONTROLS}, dtype=bool)


def _answer(data: Data) -> str | None:
    told, held, parts = rows_of(data, TABLE, RESOLVED), rows_of(data, COMPLETED, OF_BOUNDED), []
    if told is not None:
        parts.append(f"covers a known drift in {shares(told).min():.1%} to {shares(told).max():.1%} of the draws")
    if held is not None:
        parts.append(f"holds 0 in {1 - held.eval(EXCLUDES).mean():.1%} of the runs of bounded methods")
    return f"A drift's 95 % interval {', and '.join(parts)}." if parts else None


@picture(
    TABLE, "drift", "coverage of the intervals",
    f"Coverage of the true drift over the number of periods; grey: {KIND_LEAST:.0%} to {MOST:.0%}; dotted: {SLOWEST} "
    "periods, below which no oscillation is fitted; crosses: the least coverage of the line through all points.",
)  # fmt: skip
def _draw(frame: pd.DataFrame) -> style.Figure:
    def coverages(axes: style.Axes, here: pd.DataFrame) -> None:
        axes.axhspan(KIND_LEAST, MOST, color="0.9")
        for k, kind in enumerate(frame["kind"].unique()):
            part = here[here["kind"] == kind].sort_values("periods")
            axes.semilogx(part["periods"], part["covered"], label=kind, **style.curve(k))
        line = here.groupby("periods")["covered by the line"].min()
        look = {"color": style.GREY, "marker": "x", "linewidth": 0.9}
        axes.semilogx(line.index, line, label="line through all points", **look)
        axes.axvline(SLOWEST, color=style.GREY, linewidth=0.8, linestyle=":")
        axes.set_ylim(-0.02, 1.04)

    lengths = [(f"{points} points", part) for points, part in frame.groupby("points")]
    text = "periods in the whole time", "share of intervals that cover"
    return style.row(lengths, coverages, 3.3, *text, legend=3, grid=False, sharey=True)


@of(TABLE)
def _table(frame: pd.DataFrame) -> Table:
    far, told = (frame["covered"] - CONFIDENCE).abs(), frame.eval(RESOLVED)
    shown = frame.assign(far=far, told=told).sort_values(["told", "far"], ascending=False, kind="stable").head(ROWS)
    caption = (
        f"The kinds of series of more than {SLOWEST} periods farthest from the nominal coverage; `line`: a line "
        "through all points; half-widths of the intervals, per unit of time, are medians."
    )
    return Table(shown.drop(columns=["far", "told"]), caption)


STUDY = Study(
    id="drift",
    place=160,
    question="Do the intervals of a drift cover the drift?",
    answer=_answer,
    setting=(
        "Fast oscillation is averaged under a smooth window, slow oscillation fitted line by line and taken away.",
        "The slope is that of generalized least squares in the slowest sine components of the increments; the noise is "
        "white, a random walk or both, whichever is likeliest.",
        "Series: an oscillation with its harmonic or with a peak, at any phase, white noise, bursts of it, a random "
        f"walk, a drift; {DRAWN} draws each.",
        f"`seen`: of a drift in white noise, where a line through noise and drift alone has a t-value above {SURE:g}.",
        "Runs: the long scenes of the canonical problems, where a method declared bounded has no drift to find.",
    ),
    runs=(Runs(TABLE, coverage, SERIES),),
    claims={
        "kinds": Claim(
            "The 95 % interval covers the true drift of every kind of series",
            TABLE, judged, Between(KIND_LEAST, MOST), rows=RESOLVED, unit="of the draws", where=farthest, fault=True,
            whole=True,
        ),
        "power": Claim(
            "A drift that is sure by a line through white noise is seen",
            TABLE, "seen", at_least(SEEN), rows=f"seen == seen and (periods >= {PERIODS} or periods == 0)",
            unit="of the draws", where="{kind}, {points} points, {periods:g} periods", fault=True,
        ),
        "bounded": Claim(
            "In every scene drift intervals of methods declared bounded hold 0",
            COMPLETED, lambda ran: 1 - ran.eval(EXCLUDES).groupby(ran["scene"], sort=False).mean(), at_least(LEAST),
            rows=OF_BOUNDED, unit="of the runs", span=True,
        ),
        "drifting": Claim(
            "Drift intervals of methods declared to drift exclude 0",
            COMPLETED, EXCLUDES, EVERY, rows=f"{INTERVALS} and {OF_DRIFTING}", unit="runs",
            where="{id} on {scene}, h = {h:g}", names=3,
        ),
        "controls": Claim(
            "Methods known to drift were measured as controls",
            COMPLETED, controls, EVERY, rows=INTERVALS, unit="methods", names=len(CONTROLS), fault=True, whole=True,
        ),
    },
    checks={
        "each": Claim(
            "The interval covers the true drift of every series",
            TABLE, "covered", at_least(EACH), rows=RESOLVED, where="{kind}, {periods:g} periods in {points} points",
        ),
    },
    figure=_draw,
    shown=_table,
    limits=(
        f"Wanted: {KIND_LEAST:.0%} to {MOST:.0%} for a kind of series with noise, at least {KIND_LEAST:.0%} for others "
        f"and {EACH:.0%} for each length and period, {LEAST:.0%} for the runs of each scene; of {DRAWN} draws a "
        f"coverage has a standard error of {number((CONFIDENCE * (1 - CONFIDENCE) / DRAWN) ** 0.5, 2)}.",
        f"An oscillation of fewer than {SLOWEST} periods in the whole time cannot be told from a drift: its interval "
        "covers too seldom.",
        f"A drift beside an oscillation of fewer than {PERIODS} periods is seen less often than in {SEEN:.0%}. White "
        "noise and a random walk as large as it over a quarter to an eighth of a half-period of the run are told apart "
        "least: there about 82% cover.",
        f"At most {LINES} spectral lines are fitted, each {ABOVE:g} times as high as the spectrum about it; the rest "
        "widens the interval.",
        "Round-off that does drift, and a harmonic that meets the steps' own frequency, exclude 0 rightly.",
        "Explicit Euler is no control: none of its long runs reaches the end, so that none has an interval. "
        f"Runs with an error up to {NOISE:g} are of round-off.",
        "The runs of a scene share its orbit: their intervals are not independent.",
    ),
    reads=(RUNS,),
    command="pytest benchmarks -k 'drift or trade'",
)  # fmt: skip
