"""The certified references: how exact they are, how far they reach, and whether a second solver agrees."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of
from phasebench.reference.certificates.make import FASTEST, SAFETY

COLUMNS = {
    "problem": "problem",
    "t_end": "t_end",
    "uncertainty": "uncertainty",
    "long double": "long double",
    "horizon": "horizon",
    "rate": "rate",
    "distance": "Gauss 16",
    "its uncertainty": "its uncertainty",
}


def _worst(frame: pd.DataFrame, column: str) -> str:
    worst = frame.loc[frame[column].idxmax()]
    return f"{number(worst[column], 2)} ({worst['problem']} at t = {number(worst['t_end'])})"


@of("references")
def unmoved(frame: pd.DataFrame) -> Verdict:
    """Whether the stored states are what is computed anew."""
    changed = frame["changed"].astype(object).fillna("")
    moved = frame[changed != ""]
    names = [f"{name} ({how})" for name, how in zip(moved["problem"], changed[changed != ""], strict=True)]
    text = f"{len(frame)} references with {int(frame['states'].sum())} stored states were computed anew: "
    text += f"these changed: {listed(names, 4)}." if names else "none moved by more than its uncertainty"
    text += "" if names else f", which is at most {_worst(frame, 'uncertainty')}."
    return Verdict(text, moved.empty, f"{len(moved) or 'None'} of {len(frame)} references moved when computed anew.")


@of("references")
def second(frame: pd.DataFrame) -> Verdict:
    """Whether a second solver agrees."""
    apart, pairs = frame[frame["disagree"] > 0], int(frame["pairs"].sum())
    text = (
        f"Solvers disagree beyond their uncertainties on {listed(list(apart['problem']), 6)}"
        if len(apart)
        else f"In all {pairs} comparisons with another solver the distance is within the uncertainties"
    )
    text += f"; the second solver's own uncertainty is {number(frame['its uncertainty'].median(), 2)} in the median."
    return Verdict(text, apart.empty, f"Solvers disagree on {len(apart)} of {len(frame)} references.")


@of("references")
def horizons(frame: pd.DataFrame) -> Verdict:
    """Where long double, the reference of a run whose end is not stored, leaves its limit."""
    short = frame[~frame["holds to the end"].astype(bool)].sort_values("horizon")
    parts = [f"{r.problem} ({number(r.horizon)} of {number(r.t_end)})" for r in short.itertuples()]
    text = "Long double holds to the end on every orbit."
    if parts:
        text = (
            f"Long double leaves its limit before the end on {len(short)} of {len(frame)} orbits: {listed(parts, 4)}."
        )
    return Verdict(text, True, text)


@of("references")
def draw(frame: pd.DataFrame, folder) -> list[Picture]:
    """The uncertainty of the digits, and the distances of two other solvers."""
    shown = frame.sort_values("long double").reset_index(drop=True)
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 1.3 + 0.145 * len(shown))
        for k, column in enumerate(("uncertainty", "long double", "distance")):
            colour, _, marker = style.CURVES[k]
            label = {"uncertainty": "uncertainty of the stored digits", "distance": "Gauss of order 16"}.get(
                column, column
            )
            axes.semilogx(shown[column], np.arange(len(shown)), marker, color=colour, label=label)
        axes.set_yticks(range(len(shown)), shown["problem"])
        axes.set_ylim(-0.7, len(shown) - 0.3)
        axes.set_xlabel("largest distance from the stored digits, maximum norm over (q, p)")
        axes.grid(color="0.93", linewidth=0.5)
        style.legend_above(figure, axes, 3)
    caption = "Each reference: the uncertainty of its digits, and how far a long double run and the Gauss method end from them."
    return [Picture(style.save(figure, folder, "references.png"), "the references' uncertainties", caption)]


@of("references")
def table(frame: pd.DataFrame) -> Table:
    """The orbits whose neighbours part exponentially, or that leave the limit, then the largest uncertainties."""
    hard = frame["rate"].notna() | ~frame["holds to the end"].astype(bool)
    shown = pd.concat([frame[hard], frame[~hard].nlargest(10, "uncertainty")])
    caption = (
        "The orbits whose neighbours part exponentially or whose horizon is short, then the ten largest uncertainties."
    )
    return Table(shown[list(COLUMNS)].rename(columns=COLUMNS).head(ROWS), caption)


@of("references")
def _whole(frame: pd.DataFrame) -> pd.DataFrame:
    return frame[list(COLUMNS)].rename(columns=COLUMNS)


PAGE = Page(
    id="references",
    question="How exact are the references that errors are measured against, and how far do they reach?",
    tables=("references",),
    setting=(
        "The stored digits are a Taylor run in quadruple precision; their uncertainty is its distance from a second "
        "run at a tolerance 50 times as large. Errors are max norms over (q, p), the largest at any time up to t_end.",
        "`long double` is the same Taylor method in 80 bits, `Gauss 16` (8 stages) shares no code with it: distances from "
        "the stored digits.",
        "Horizon: the last time at which long double is within its limit; a trajectory's error is not reported later.",
    ),
    verdicts=(unmoved, second, horizons),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"The Gauss method's uncertainty is SAFETY = {SAFETY:g} times the difference of two step sizes, and its round-off "
        "grown as neighbouring trajectories part.",
        f"A rate (1/t) is given where neighbours part faster than t^{FASTEST:g}; the horizon is a property of one run and machine.",
    ),
    command="pytest benchmarks/experiments/references",
)
