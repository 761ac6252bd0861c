"""Times of a step, and the ratios that are claimed."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of

from .calls import FACTOR, MORE
from .calls import TABLE as CALLS

WANTED = "wanted, at most"
LOW, HIGH = "median, low", "median, high"
COLUMNS = ["ratio", "median", LOW, HIGH, WANTED]


@of("ratios")
def limits(ratios: pd.DataFrame) -> Verdict | None:
    """Whether the ratios are what is wanted."""
    limited = ratios.reindex(columns=COLUMNS).dropna(subset=WANTED)
    if limited.empty:
        return None
    over = limited[limited["median"] > limited[WANTED]]
    whole = int((limited[HIGH] <= limited[WANTED]).sum())
    names = [f"{r['ratio']} {r['median']:.2f} (wanted {r[WANTED]:g})" for _, r in over.iterrows()]
    counts = f"{len(limited) - len(over)} of {len(limited)} ratios are within what is wanted"
    text = f"{counts}, {whole} with their whole interval{f'; over it: {listed(names, 4)}' if names else ''}."
    return Verdict(text, over.empty, f"{counts}.")


@of("ratios")
def beside_c(ratios: pd.DataFrame) -> Verdict | None:
    """The cost beside a bare C loop."""
    loops = ratios[ratios["ratio"].str.contains("/ C")]
    if loops.empty:
        return None
    parts = [f"{r['ratio']} {r['median']:.2f}" for _, r in loops.iterrows()]
    text = f"Times of a step beside a bare C loop: {'; '.join(parts)}."
    return Verdict(text, True, text)


@of("speed")
def fastest(speed: pd.DataFrame) -> Verdict | None:
    """The range of all methods."""
    ran = speed[(speed["status"] == "ok") & speed["ns per step"].notna()]
    if ran.empty:
        return None
    low, high = (ran.loc[getattr(ran["ns per step"], f)()] for f in ("idxmin", "idxmax"))
    text = (
        f"A step takes from {number(low['ns per step'])} ns ({low['method']}, {low['problem']}) to "
        f"{number(high['ns per step'])} ns ({high['method']}, {high['problem']}), "
        f"{number(ran['ns per step'].median())} ns in the median of {len(ran)} pairs of a method and a problem ({_counted(ran)})."
    )
    return Verdict(text, True, text)


def _counted(ran: pd.DataFrame) -> str:
    """How many methods there are, and with how many parameters: a label is `id(lam=2)`."""
    settings = ran["method"].drop_duplicates()
    methods = settings.str.partition("(")[0].nunique()
    return f"{methods} methods, {len(settings)} with each of their parameters counted"


@of(CALLS)
def called(calls: pd.DataFrame) -> Verdict:
    """What a peer's prepared run adds to a bare script of its package."""
    within = calls["within"].astype(bool)
    worst = calls.loc[calls["ratio"].idxmax()]
    short = f"{int(within.sum())} of {len(calls)} peers run prepared within {FACTOR:g} of a bare script and {MORE * 1e6:g} us."
    text = (
        f"{short[:-1]}; the most is {number(worst['ratio'], 3)} times, of {worst['peer']} "
        f"({number(worst['us, prepared'], 3)} us beside {number(worst['us, bare script'], 3)} us)."
    )
    return Verdict(text, bool(within.all()), short)


@of("ratios")
def draw(ratios: pd.DataFrame, folder) -> list[Picture]:
    """The ratios with their quartiles."""
    ratios, y = ratios.reindex(columns=COLUMNS), np.arange(len(ratios))
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 1.0 + 0.2 * len(ratios))
        low, high = ratios["median"] - ratios[LOW], ratios[HIGH] - ratios["median"]
        axes.errorbar(ratios["median"], y, xerr=[low, high], fmt="o", color=style.BLUE, label="median, 95 % interval")
        axes.plot(ratios[WANTED], y, "|", color=style.VERMILION, markersize=11, markeredgewidth=1.6, label=WANTED)
        axes.set_yticks(y, ratios["ratio"])
        axes.set_ylim(len(ratios) - 0.5, -0.5)
        axes.set_xlim(left=0)
        axes.set_xlabel("ratio of the times of a step")
        axes.grid(axis="x", color="0.93", linewidth=0.5)
        style.legend_above(figure, axes, 2)
    caption = (
        "Ratios of times, medians of rounds in turns with 95 % intervals; upright marks: at most so much is wanted."
    )
    return [Picture(style.save(figure, folder, "speed.png"), "ratios of times", caption)]


@of("ratios")
def table(ratios: pd.DataFrame) -> Table:
    """The ratios."""
    caption = "Each ratio is taken round by round in one run, the competitors in turns."
    return Table(ratios.reindex(columns=COLUMNS).head(ROWS), caption)


@of("speed")
def _whole(speed: pd.DataFrame) -> pd.DataFrame:
    return speed


PAGE = Page(
    id="speed",
    question="What does a step cost, beside a bare C loop and beside the other schemes?",
    tables=("ratios", "speed", CALLS),
    setting=(
        "Seconds of the warm integration alone, without output and without compilation, divided by the steps.",
        "400,000 steps of h = 0.01 beside a C loop (gcc -O3 -march=native, uncompensated), 50,000 between schemes.",
        "Competitors run in turns, round by round; medians of the rounds' ratios, 95 % intervals.",
        "A peer's prepared run (`pb.prepare`) beside a bare script of its package: reset and the package's own call.",
    ),
    verdicts=(limits, beside_c, fastest, called),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        "Times are the machine's own: another processor or compiler moves the ratios, and a busy machine more so.",
        "Sums here are compensated, those of the C loops are not.",
        "The last kick of a step and the first of the next are one here, and in the C loop with merged kicks; the other "
        "makes both.",
    ),
    command="pytest benchmarks/experiments/speed",
)
