"""Do the intervals of a drift cover it: on series whose drift is known, and on methods known to be bounded."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.experiments.drift.coverage import DRAWN
from phasebench.benchmarks.experiments.invariants import page as invariants
from phasebench.benchmarks.measure.drift import ABOVE, BLOCKS, LINES, SLOWEST
from phasebench.benchmarks.measure.metrics import CONFIDENCE
from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of
from phasebench.integrators.record import BOUNDED, DRIFT

#: A nominal interval of 95 % covers in a share of the draws between these.
LEAST, MOST = 0.9, 0.99
#: Methods that drift and stay near their orbit, so that their intervals must exclude 0 in every run.
CONTROLS = ("rk4", "radau-iia-2")


def resolved(periods: float) -> bool:
    """Whether an oscillation of so many periods in the whole time is told from a drift."""
    return periods > SLOWEST


@of("drift_coverage")
def coverage(table: pd.DataFrame) -> Verdict | None:
    """Whether the intervals cover the known drift as often as they say."""
    there = table["periods"].map(resolved)
    told, slow = table[there], table[~there]
    if told.empty:
        return None
    kinds = told.groupby("kind", sort=False)["covered"].mean()
    bad = sorted({*kinds[~kinds.between(LEAST, MOST)].index, *told[~(told["covered"] >= LEAST)]["kind"]})
    line = told["covered by the line"]
    said = f"the {CONFIDENCE:.0%} interval covers the true drift in {kinds.min():.1%} to {kinds.max():.1%} of the draws"
    least = number(told["periods"].min())
    text = (
        f"On {len(kinds)} kinds of series, with {least} to {number(told['periods'].max())} periods, {said}, and for one length and period in {told['covered'].min():.1%} to {told['covered'].max():.1%} "
        f"(the line through all points in {line.min():.0%} to {line.max():.0%})"
    )
    few = [f"with {number(p)} in {_range(part['covered'])}" for p, part in slow.groupby("periods", sort=True)]
    text += f"; of fewer periods, which are not told from a drift, {listed(few)}" if few else ""
    text += f"; too seldom or too often: {listed(bad, 3)}." if bad else "."
    short = f"On series of known drift, of {least} periods and more, {said}"
    return Verdict(text, not bad, f"{short}; {listed(few)}." if few else f"{short}.")


def _range(shares: pd.Series) -> str:
    return f"{shares.min():.0%} to {shares.max():.0%}"


def _intervals(rows: pd.DataFrame) -> pd.DataFrame:
    """The long runs with an interval, and whether it excludes 0."""
    ran = invariants.ended(rows)
    ran = ran[ran["energy_drift_low"].notna() & ran["canonical"]]
    return ran.assign(excludes=ran["sure"] != 0)


@of("rows")
def bounded(rows: pd.DataFrame) -> Verdict | None:
    """Whether the intervals of methods whose energy error is bounded hold 0."""
    ran = _intervals(rows)
    ran = ran[ran["declared"] == BOUNDED]
    if ran.empty:
        return None
    held, scenes = 1 - ran["excludes"].mean(), 1 - ran.groupby("scene", sort=False)["excludes"].mean()
    few = scenes[scenes < LEAST]
    least, runs = scenes.idxmin(), ran["scene"].value_counts()
    where = f"{scenes[least]:.1%} of the {runs[least]} on {least}"
    text = f"Of {len(ran)} long runs of methods declared bounded {held:.1%} have an interval that holds 0"
    text += f", least {where}" if len(scenes) > 1 else ""
    text += f" (below {LEAST:.0%}: {listed(list(few.index), 3)})" if len(few) else ""
    if held < 1:
        worst = ran.sort_values("share").iloc[-1]
        text += (
            f"; where it does not, the drift adds for certain at most {number(worst['share'])} of the largest error "
        )
        text += f"({worst['id']} on {worst['scene']}, h = {number(worst['h'])})"
    text += "."
    return Verdict(text, few.empty, f"Of bounded methods' intervals {held:.1%} hold 0, {where}.")


@of("rows")
def controls(rows: pd.DataFrame) -> Verdict | None:
    """Whether the intervals of every control exclude 0, and every control was measured."""
    ran = _intervals(rows)
    if ran.empty:
        return None
    ran = ran[(ran["declared"] == DRIFT) & (ran["energy_max"] > invariants.LEAST)]
    mine = {id: ran.loc[ran["id"] == id, "excludes"] for id in CONTROLS}
    counts = [f"{id} in {int(x.sum())} of {len(x)} runs" for id, x in mine.items()]
    nothing = [id for id, x in mine.items() if x.empty]
    held = [f"{r.id} on {r.scene}, h = {r.h:g}" for r in ran[~ran["excludes"]].itertuples()]
    text = f"The controls that drift have intervals that exclude 0: {' and '.join(counts)}; of all methods declared to "
    text += f"drift {int(ran['excludes'].sum())} of {len(ran)} runs that end"
    text += f"; not so {listed(held, 3)}" if held else ""
    text += f"; nothing was measured of {listed(nothing)}, which is no control" if nothing else ""
    return Verdict(f"{text}.", not nothing and not held, f"Methods that drift exclude 0: {' and '.join(counts)}.")


@of("drift_coverage")
def draw(table: pd.DataFrame, folder) -> list[Picture]:
    """Coverage over the number of periods, a panel for each length."""
    lengths = sorted(table["points"].unique())
    with style.settings():
        figure, (panels,) = style.panels(1, len(lengths), 3.3, sharey=True)
        for axes, points in zip(panels, lengths, strict=True):
            here = table[table["points"] == points]
            axes.axhspan(LEAST, MOST, color="0.9")
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
        f"Coverage of the true drift over the number of periods; grey: {LEAST:.0%} to {MOST:.0%}; dotted: {SLOWEST} "
        "periods, below which no oscillation is fitted; crosses: the least coverage of the line through all points."
    )
    return [Picture(style.save(figure, folder, "drift.png"), "coverage of the intervals", caption)]


@of("drift_coverage")
def table(found: pd.DataFrame) -> Table:
    """The rows whose coverage is farthest from the nominal one, resolved ones first."""
    far = (found["covered"] - CONFIDENCE).abs()
    told = found["periods"].map(resolved)
    shown = found.assign(far=far, told=told).sort_values(["told", "far"], ascending=False, kind="stable").head(ROWS)
    caption = "The resolved kinds of series farthest from the nominal coverage; half-widths are medians."
    return Table(shown.drop(columns=["far", "told"]), caption)


@of("drift_coverage")
def _whole(found: pd.DataFrame) -> pd.DataFrame:
    return found


PAGE = Page(
    id="drift",
    question="Do the intervals of a drift cover the drift?",
    tables=("drift_coverage", "rows"),
    setting=(
        "Fast oscillation is averaged under a smooth window, slow oscillation fitted line by line and taken away.",
        f"The slope is the median of the means of pairs of {BLOCKS} blocks' slopes, its interval that of signed ranks: "
        f"{BLOCKS} is the effective size of the sample.",
        f"Series: an oscillation with its harmonic at any phase, white noise, a random walk, a drift; {DRAWN} draws each.",
        "Runs: the long scenes of the canonical problems, where a method declared bounded has no drift to find.",
    ),
    verdicts=(coverage, bounded, controls),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"Wanted: {LEAST:.0%} to {MOST:.0%} for a kind of series, at least {LEAST:.0%} for each length and period and for the runs of each scene; of {DRAWN} draws a coverage has a standard error of "
        f"{number((CONFIDENCE * (1 - CONFIDENCE) / DRAWN) ** 0.5, 2)}.",
        f"An oscillation of fewer than {SLOWEST} periods in the whole time cannot be told from a drift: its interval covers too seldom.",
        f"At most {LINES} lines are fitted, each {ABOVE:g} times as high as the spectrum about it; the rest widens the "
        "interval.",
        "Round-off that does drift, and a harmonic that meets the steps' own frequency, exclude 0 rightly.",
        "Explicit Euler is no control: no long run of it ends with status ok, so that none has an interval. "
        f"Runs with an error up to {invariants.LEAST:g} are of round-off.",
        "The runs of a scene share its orbit: their intervals are not independent.",
    ),
    command="pytest benchmarks/experiments/drift benchmarks/experiments/trade",
)
