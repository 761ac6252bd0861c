"""Wisdom-Holman splittings beside REBOUND's."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of

#: Energy errors below this have a part of round-off, in which the two differ.
ROUND_OFF = 1e-11
#: Energy errors above that which differ by less than this, relatively, are the same.
SAME = 0.05
#: A step that takes at most this many times as long as REBOUND's keeps up with it.
SLOWER = 1.5
OURS, THEIRS = "energy error", "REBOUND's energy error"


@of("wisdom_holman")
def same(frame: pd.DataFrame) -> Verdict | None:
    """Whether the splittings are REBOUND's."""
    truncated = frame[(frame[OURS] > ROUND_OFF) & (frame[THEIRS] > ROUND_OFF)]
    if truncated.empty:
        return None
    apart = float((truncated[OURS] / truncated[THEIRS] - 1).abs().max())
    positions = float(frame["distance of early positions"].max())
    return Verdict(
        f"Where the energy error exceeds {ROUND_OFF:g} ({len(truncated)} of {len(frame)} rows) it differs from REBOUND's "
        f"of the same splitting and step by at most {number(100 * apart, 2)} %; early positions by at most "
        f"{number(positions)} of the orbit's size.",
        apart <= SAME,
        f"Energy errors differ from REBOUND's by at most {number(100 * apart, 2)} %.",
    )


@of("wisdom_holman")
def cost(frame: pd.DataFrame) -> Verdict:
    """What a step costs beside REBOUND's."""
    medians = frame.groupby("problem", sort=False)["time ratio"].median()
    parts = [f"{name} {x:.2f}" for name, x in medians.items()]
    return Verdict(
        f"A step takes, in units of REBOUND's (medians): {'; '.join(parts)}.",
        bool(medians.max() <= SLOWER),
        f"A step takes up to {medians.max():.2f} times as long as REBOUND's.",
    )


@of("wisdom_holman")
def least(frame: pd.DataFrame) -> Verdict:
    """Whose least energy error is smaller."""
    both = frame.groupby("problem", sort=False)[[OURS, THEIRS]].min()
    parts = [f"{name} {number(float(a))} and {number(float(b))}" for name, (a, b) in both.iterrows()]
    return Verdict(
        f"The least energy errors, ours and REBOUND's: {'; '.join(parts)}.",
        bool((both[OURS] <= 2 * both[THEIRS]).all()),
        "The least energy errors are no larger than REBOUND's.",
    )


@of("wisdom_holman")
def draw(frame: pd.DataFrame, folder) -> list[Picture]:
    """Energy error against time."""
    problems, methods = (list(dict.fromkeys(frame[c])) for c in ("problem", "method"))
    with style.settings():
        figure, (panels,) = style.panels(1, len(problems), 3.0, sharey=True)
        for axes, name in zip(panels, problems, strict=True):
            for k, method in enumerate(methods):
                part = frame[(frame["problem"] == name) & (frame["method"] == method)]
                look = style.curve(k % len(style.CURVES))
                axes.loglog(part["ns per step"] / part["h"], part[OURS], label=method, **look)
                theirs = {"linestyle": ":", "marker": look["marker"], "markerfacecolor": "none", "color": look["color"]}
                axes.loglog(part["REBOUND's ns per step"] / part["h"], part[THEIRS], **theirs)
            axes.set(title=name, xlabel="ns a unit of time")
            axes.grid(color="0.93", linewidth=0.5)
            style.plain_ticks(axes.xaxis)
        panels[0].set_ylabel("relative energy error")
        style.legend_above(figure, panels[0], 3)
    caption = "Energy error against time: filled marks are this project's, open marks on dotted lines REBOUND's."
    return [Picture(style.save(figure, folder, "wisdom_holman.png"), "energy error against time", caption)]


@of("wisdom_holman")
def table(frame: pd.DataFrame) -> Table:
    """The smallest error of each method on each problem."""
    best = frame.loc[frame.groupby(["problem", "method"], sort=False)[OURS].idxmin()]
    columns = ["problem", "method", "REBOUND's", "h", OURS, THEIRS, "ns per step", "time ratio"]
    return Table(best[columns].head(ROWS), "Of each method and problem the step with the least energy error.")


@of("wisdom_holman")
def _whole(frame: pd.DataFrame) -> pd.DataFrame:
    return frame


PAGE = Page(
    id="wisdom_holman",
    question="Are the Wisdom–Holman splittings REBOUND's, and what does a step cost?",
    tables=("wisdom_holman",),
    setting=(
        "H = H_Kepler + ε H_interaction in Jacobi coordinates; drifts solve Kepler's equation, kicks are the rest.",
        "The outer solar system, and perturbed Kepler at e = 0.2 and 0.6; the same splitting and step on both sides.",
        "Energy errors are relative, the greatest over 200 rows; distances are relative to the largest coordinate.",
        "Times are warm, without output, medians of rounds in turns; REBOUND runs with safe_mode = 0.",
    ),
    verdicts=(same, cost, least),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"Errors below {ROUND_OFF:g} are left out of the comparison: sums here are compensated, REBOUND's are not.",
        f"The same means within {100 * SAME:g} %; keeping up means {SLOWER} times REBOUND's time or less.",
        "The kernel of the corrected WHFast is the default one: REBOUND's lazy kernel is another method.",
    ),
    command="pytest benchmarks/experiments/wisdom_holman",
)
