"""The report's page "speed": times of one step, and their ratios (to a C loop, or of two methods) with limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, Count, Verdict

from .calls import FACTOR, MORE
from .calls import TABLE as CALLS
from .translation import FACTOR as TRANSLATED
from .translation import TABLE as TRANSLATION

if TYPE_CHECKING:
    from pathlib import Path

WANTED = "wanted, at most"
LOW, HIGH = "median, low", "median, high"
#: Prefix of the names of the ratios to a C loop without merged kicks.
LOOP = "Stormer-Verlet / C loop,"
COLUMNS = ["ratio", "median", LOW, HIGH, WANTED]


@of("ratios")
def limits(ratios: pd.DataFrame) -> Verdict | None:
    """Judge whether every ratio of step times (to a C loop, or of two methods) is at most the limit set for it.

    None if no ratio has a limit.
    """
    limited = ratios.reindex(columns=COLUMNS).dropna(subset=WANTED)
    if limited.empty:
        return None
    over = limited["median"] / limited[WANTED]
    worst = limited.loc[over.idxmax()]
    return Verdict(
        "Every ratio of times is at most what is wanted",
        Count(int((limited["median"] <= limited[WANTED]).sum()), len(limited)),
        EVERY,
        "ratios",
        where=f"{worst['ratio']}: {number(worst['median'])}, wanted {worst[WANTED]:g}",
    )


@of(CALLS)
def call_overhead(calls: pd.DataFrame) -> Verdict:
    """Judge whether each peer (another package's integrator) takes hardly longer here than in a bare script of its own.

    ``calls`` has a row for each peer; its column "within" says whether the time is within the allowed overhead.
    """
    worst = calls.loc[calls["ratio"].idxmax()]
    return Verdict(
        "A peer's prepared run takes no longer than a bare script of its package",
        Count(int(calls["within"].astype(bool).sum()), len(calls)),
        EVERY,
        "peers",
        where=f"{worst['peer']}: {number(worst['ratio'], 3)} times",
        otherwise=FAIL,
    )


@of(TRANSLATION)
def translation(rows: pd.DataFrame) -> Verdict:
    """Judge whether heyoka takes no longer with the suite's equations than with equations written for it.

    ``rows`` has a row for each problem and tolerance; its column "within" says whether the ratio is small enough.
    """
    within = rows["within"].astype(bool)
    slow = rows[~within] if not within.all() else rows.nlargest(1, "ratio")
    named = (f"{p} {number(r, 3)}" for p, r in slow.groupby("problem")["ratio"].max().nlargest(5).items())
    return Verdict(
        "heyoka's runs take no longer than equations written for it by hand",
        Count(int(within.sum()), len(rows)),
        EVERY,
        "problems and tolerances",
        where=", ".join(named),
    )


@of("speed", "ratios")
def answer(speed: pd.DataFrame, ratios: pd.DataFrame) -> str | None:
    """Return the page's answer, a sentence: the range of the step times, and Stormer-Verlet's ratios to a C loop.

    ``speed`` has a row for each method and problem, ``ratios`` one for each ratio; None if no run completed.
    """
    ran = speed.loc[speed["status"] == "ok", "ns per step"].dropna()
    loops = ratios.loc[ratios["ratio"].str.startswith(LOOP), "median"]
    if ran.empty:
        return None
    text = (
        f"A step takes {number(ran.min())} ns to {number(ran.max() / 1e3)} µs, {number(ran.median())} ns in the "
        f"median of {len(ran)} pairs of method and problem"
    )
    if loops.empty:
        return f"{text}."
    return f"{text}; Störmer–Verlet takes {number(loops.min())} to {number(loops.max())} of a C loop's time."


@of("ratios")
def draw(ratios: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the ratios of step times with their intervals and limits; save the figure in ``folder``."""
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
    caption = "Ratios of times: medians of rounds in turns with 95 % intervals; upright marks: the most that is wanted."
    return [Picture(style.save(figure, folder, "speed.png"), "ratios of times", caption)]


@of("ratios")
def table(ratios: pd.DataFrame) -> Table:
    """Return the table of the page "speed": a row for each ratio of step times, with its interval and limit."""
    caption = "Ratios of the times of a step, taken round by round in one run, the competitors in turns."
    return Table(ratios.reindex(columns=COLUMNS).head(ROWS), caption)


@of("speed")
def _full_table(speed: pd.DataFrame) -> pd.DataFrame:
    return speed


PAGE = Page(
    id="speed",
    question="What does a step cost, beside a bare C loop and beside the other schemes?",
    tables=("ratios", "speed", CALLS, TRANSLATION),
    setting=(
        "The seconds of a warm integration, without output and compilation, divided by its steps; pendulum, "
        "Hénon–Heiles and perturbed Kepler motion.",
        "400,000 steps of h = 0.01 beside a C loop (gcc -O3 -march=native, uncompensated), 50,000 between schemes.",
        "Competitors run in turns, round by round; medians of the rounds' ratios, 95 % intervals.",
        "A peer's prepared run (`pb.prepare`) beside a bare script of its package: a reset and the package's own "
        f"call; at most {FACTOR:g} times and {MORE * 1e6:g} µs longer counts as no longer.",
        "heyoka's run of each problem (`pb.prepare`) beside the fastest of: equations written for heyoka by hand, "
        f"heyoka's own model, the derivatives as they stand; at most {TRANSLATED:g} times longer.",
    ),
    verdicts=(limits, call_overhead, translation),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        "Times are the machine's own: another processor or compiler changes the ratios, a busy machine even more.",
        "Sums here are compensated, those of the C loops are not.",
        "The last kick of a step and the first of the next are one here, and in the C loop with merged kicks; the "
        "other C loop makes both.",
    ),
    command="pytest benchmarks/experiments/speed",
)
