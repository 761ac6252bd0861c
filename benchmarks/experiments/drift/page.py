"""The report page on drift intervals: tested on series with a known drift, and on methods with bounded energy error."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.experiments.drift.coverage import DRAWN, KINDS, SURE
from phasebench.benchmarks.measure.drift import ABOVE, LINES, SLOWEST
from phasebench.benchmarks.measure.metrics import CONFIDENCE
from phasebench.benchmarks.page.long_runs import NOISE, completed_runs
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Data, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, Between, Count, Range, Verdict, at_least
from phasebench.integrators.record import BOUNDED, DRIFT

if TYPE_CHECKING:
    from pathlib import Path

#: The share of draws of a kind that a nominal 95 % interval should cover; of a length and a period of it at least `LEAST`.
KIND_LEAST, MOST, LEAST = 0.93, 0.99, 0.9
#: The share of series in which a sure drift should be seen, where the oscillation has so many periods at least.
SEEN, PERIODS = 0.95, 4
#: Controls: methods that drift but stay near the orbit, so that their intervals must exclude 0.
CONTROLS = ("rk4", "radau-iia-2")


def is_resolved(periods: float) -> bool:
    """True if an oscillation has enough ``periods`` in the whole time to be told from a drift; 0 if there is none."""
    return periods > SLOWEST or periods == 0


def _resolved_rows(table: pd.DataFrame) -> pd.DataFrame:
    """Select the kinds of series whose oscillation has enough periods in the whole time to be told from a drift."""
    return table[table["periods"].map(is_resolved)]


def _kinds(table: pd.DataFrame) -> pd.Series:
    """Compute for each kind of series the share of the drawn series whose interval covers the true drift.

    Only series whose oscillation has enough periods to be told from a drift count.
    """
    return _resolved_rows(table).groupby("kind", sort=False)["covered"].mean()


def _noisy(kind: str) -> bool:
    """True for a kind of series with noise: what is left of one without it is round-off, which is over-covered."""
    return kind not in KINDS or bool(KINDS[kind].white or KINDS[kind].walk)


@of("drift_coverage")
def kinds(table: pd.DataFrame) -> Verdict | None:
    """Judge whether the drift intervals cover the known drift of each kind of series as often as they claim."""
    shares = _kinds(table)
    if shares.empty:
        return None
    noisy = shares[[_noisy(kind) for kind in shares.index]]
    return Verdict(
        "The 95 % interval covers the true drift of every kind of series",
        Range(shares.min(), noisy.max() if len(noisy) else shares.min()),
        Between(KIND_LEAST, MOST),
        "of the draws",
        where=(shares - CONFIDENCE).abs().idxmax(),
        otherwise=FAIL,
    )


@of("drift_coverage")
def power(table: pd.DataFrame) -> Verdict | None:
    """Judge whether a drift that is sure by a line in white noise is seen, with and without an oscillation."""
    if "seen" not in table:
        return None
    told = table[table["seen"].notna() & ((table["periods"] >= PERIODS) | (table["periods"] == 0))]
    if told.empty:
        return None
    worst = told.loc[told["seen"].idxmin()]
    return Verdict(
        "A drift that is sure by a line through white noise is seen",
        float(worst["seen"]),
        at_least(SEEN),
        "of the draws",
        where=f"{worst['kind']}, {worst['points']} points, {number(worst['periods'])} periods",
        otherwise=FAIL,
    )


def _intervals(rows: pd.DataFrame) -> pd.DataFrame:
    """Select the completed long runs on canonical systems whose energy drift has an interval.

    The added column ``excludes`` says whether the interval excludes 0.  ``rows`` is the table of runs.
    """
    ran = completed_runs(rows)
    ran = ran[ran["energy_drift_low"].notna() & ran["canonical"]]
    return ran.assign(excludes=ran["sure"] != 0)


def _bounded_runs(rows: pd.DataFrame) -> pd.DataFrame:
    """Select the long runs with a drift interval, of methods declared to have a bounded energy error."""
    ran = _intervals(rows)
    return ran[ran["declared"] == BOUNDED]


@of("rows")
def bounded_energy(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether the drift intervals of methods with bounded energy error contain 0 on each problem and span.

    ``rows`` is the table of runs; None if it has no long run of such a method.
    """
    ran = _bounded_runs(rows)
    if ran.empty:
        return None
    scenes = 1 - ran.groupby("scene", sort=False)["excludes"].mean()
    return Verdict(
        "In every scene drift intervals of methods declared bounded hold 0",
        Range(scenes.min(), scenes.max()),
        at_least(LEAST),
        "of the runs",
        where=scenes.idxmin(),
    )


@of("rows")
def drifting(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether the drift intervals of all methods declared to drift exclude 0.

    ``rows`` is the table of runs; None if it has no long run of such a method with an energy error above round-off.
    """
    ran = _drifting(rows)
    if ran.empty:
        return None
    held = ran[~ran["excludes"]]
    return Verdict(
        "Drift intervals of methods declared to drift exclude 0",
        Count(int(ran["excludes"].sum()), len(ran)),
        EVERY,
        "runs",
        where=join_list([f"{r.id} on {r.scene}, h = {r.h:g}" for r in held.itertuples()], 3) if len(held) else "",
    )


@of("rows")
def controls(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether every control, a method that must drift, was measured.

    Without a control the verdict `drifting` proves nothing.  ``rows`` is the table of runs; None if it has no long run
    with an interval.
    """
    if _intervals(rows).empty:
        return None
    there = [id for id in CONTROLS if (_drifting(rows)["id"] == id).any()]
    missing = [id for id in CONTROLS if id not in there]
    return Verdict(
        "Methods known to drift were measured as controls",
        Count(len(there), len(CONTROLS)),
        EVERY,
        "methods",
        where=join_list(missing) if missing else "",
        otherwise=FAIL,
    )


def _drifting(rows: pd.DataFrame) -> pd.DataFrame:
    """Select the long runs of methods declared to drift, with an energy error above round-off."""
    ran = _intervals(rows)
    return ran[(ran["declared"] == DRIFT) & (ran["energy_max"] > NOISE)]


def answer(data: Data) -> str | None:
    """Write the page's answer: how often intervals cover a known drift, and how often 0 for bounded energy errors."""
    table, rows = data("drift_coverage"), data("rows")
    parts = []
    if table is not None and len(shares := _kinds(table)):
        parts.append(f"covers a known drift in {shares.min():.1%} to {shares.max():.1%} of the draws")
    if rows is not None and len(ran := _bounded_runs(rows)):
        parts.append(f"holds 0 in {1 - ran['excludes'].mean():.1%} of the runs of bounded methods")
    return f"A drift's 95 % interval {', and '.join(parts)}." if parts else None


@of("drift_coverage")
def draw(table: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the coverage of the drift's interval over the number of periods, a panel for each length of series."""
    lengths = sorted(table["points"].unique())
    with style.settings():
        figure, (panels,) = style.panels(1, len(lengths), 3.3, sharey=True)
        for axes, points in zip(panels, lengths, strict=True):
            here = table[table["points"] == points]
            axes.axhspan(KIND_LEAST, MOST, color="0.9")
            for k, kind in enumerate(dict.fromkeys(table["kind"])):
                part = here[here["kind"] == kind].sort_values("periods")
                axes.semilogx(part["periods"], part["covered"], label=kind, **style.curve(k))
            line = here.groupby("periods")["covered by the line"].min()
            axes.semilogx(
                line.index, line, color=style.GREY, marker="x", linewidth=0.9, label="line through all points"
            )
            axes.axvline(SLOWEST, color=style.GREY, linewidth=0.8, linestyle=":")
            axes.set(title=f"{points} points", xlabel="periods in the whole time", ylim=(-0.02, 1.04))
        panels[0].set_ylabel("share of intervals that cover")
        style.legend_above(figure, panels[0], 3)
    caption = (
        f"Coverage of the true drift over the number of periods; grey: {KIND_LEAST:.0%} to {MOST:.0%}; dotted: {SLOWEST} "
        "periods, below which no oscillation is fitted; crosses: the least coverage of the line through all points."
    )
    return [Picture(style.save(figure, folder, "drift.png"), "coverage of the intervals", caption)]


@of("drift_coverage")
def table(found: pd.DataFrame) -> Table:
    """Make the page's table: the series with the coverage farthest from nominal, resolved oscillations first."""
    far = (found["covered"] - CONFIDENCE).abs()
    told = found["periods"].map(is_resolved)
    shown = found.assign(far=far, told=told).sort_values(["told", "far"], ascending=False, kind="stable").head(ROWS)
    caption = f"The kinds of series of more than {SLOWEST} periods farthest from the nominal coverage; `line`: a line through all points; half-widths of the intervals, per unit of time, are medians."
    return Table(shown.drop(columns=["far", "told"]), caption)


@of("drift_coverage")
def _full_table(found: pd.DataFrame) -> pd.DataFrame:
    """Return the measured table "drift_coverage" unchanged: the coverage of every kind of series."""
    return found


PAGE = Page(
    id="drift",
    question="Do the intervals of a drift cover the drift?",
    tables=("drift_coverage", "rows"),
    setting=(
        "Fast oscillation is averaged under a smooth window, slow oscillation fitted line by line and taken away.",
        "The slope is that of generalized least squares in the slowest sine components of the increments; the noise is "
        "white, a random walk or both, weighted by their likelihoods.",
        f"Series: an oscillation with its harmonic or with a peak, at any phase, white noise, bursts of it, a random walk, a drift; {DRAWN} draws each.",
        f"`seen`: of a drift in white noise, where a line through noise and drift alone has a t-value above {SURE:g}.",
        "Runs: the long scenes of the canonical problems, where a method declared bounded has no drift to find.",
    ),
    verdicts=(kinds, power, bounded_energy, drifting, controls),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        f"Wanted: {KIND_LEAST:.0%} to {MOST:.0%} for a kind of series with noise, at least {KIND_LEAST:.0%} for others and {LEAST:.0%} for each length and period and for the runs of each scene; of {DRAWN} draws a coverage has a standard error of "
        f"{number((CONFIDENCE * (1 - CONFIDENCE) / DRAWN) ** 0.5, 2)}.",
        f"An oscillation of fewer than {SLOWEST} periods in the whole time cannot be told from a drift: its interval covers too seldom.",
        f"A drift beside an oscillation of fewer than {PERIODS} periods is seen less often than in {SEEN:.0%}. White noise and a random walk as large as it over a quarter to an eighth of a half-period of the run are told apart least: there about 82% cover.",
        f"At most {LINES} spectral lines are fitted, each {ABOVE:g} times as high as the spectrum about it; the rest widens the "
        "interval.",
        "Round-off that does drift, and a harmonic that meets the steps' own frequency, exclude 0 rightly.",
        "Explicit Euler is no control: none of its long runs reaches the end, so that none has an interval. "
        f"Runs with an error up to {NOISE:g} are of round-off.",
        "The runs of a scene share its orbit: their intervals are not independent.",
    ),
    command="pytest benchmarks/experiments/drift benchmarks/experiments/trade",
)
