"""The certified references: whether what they state holds, how far an orbit can be followed, what other solvers say."""

from __future__ import annotations

import functools

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.truths import GROWN
from phasebench.benchmarks.measure.truths import SAFETY as TWICE
from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of
from phasebench.reference.certificates.check import AGAIN, LOOSE
from phasebench.reference.certificates.followed import DRAWS as DRAWN
from phasebench.reference.certificates.horizon import CENTRAL, DRAWS, FASTEST, LIMIT
from phasebench.reference.certificates.make import FACTOR, PRECISION
from phasebench.reference.certificates.others import SAFETY
from phasebench.reference.certificates.stored import TELLING

from .odd import LARGEST, MANY, ODD, beyond

COLUMNS = {
    "problem": "problem",
    "t_end": "t_end",
    "error": "error",
    "uncertainty": "uncertainty",
    "horizon": "horizon",
    "earliest": "earliest",
    "latest": "latest",
    "long double leaves": "this machine",
    "rate": "rate",
    "distance": "Gauss 16",
    "its uncertainty": "its uncertainty",
}


def told(function):
    """Make a function of the table one of ``data``, as `of`; rows of an earlier form, without an error, are left out."""

    @of("references")
    @functools.wraps(function)
    def of_rows(frame: pd.DataFrame, *more):
        rows = frame[frame["error"].notna()] if "error" in frame else frame.head(0)
        return None if rows.empty else function(rows, *more)

    return of_rows


@told
def unmoved(frame: pd.DataFrame) -> Verdict:
    """Whether what the references state is what is measured by other means."""
    changed = frame["changed"].astype(object).fillna("")
    wrong = frame[changed != ""]
    names = [f"{name} ({how})" for name, how in zip(wrong["problem"], changed[changed != ""], strict=True)]
    states = int(frame["states"].sum())
    if names:
        text = f"Of {len(frame)} references these state what does not hold: {listed(names, 4)}."
    else:
        worst = frame.loc[frame["uncertainty"].idxmax()]
        least, most = number(frame["least bound"].min()), number(frame["largest bound"].max())
        factor = least if least == most else f"{least} to {most}"
        text = (
            f"The digits of all {states} stored states of {len(frame)} references are within their stated uncertainties "
            f"(measured again in {AGAIN.bits} bits), which are {factor} times the error and at most "
            f"{number(worst['uncertainty'], 2)} ({worst['problem']} at t = {number(worst['t_end'])})."
        )
    return Verdict(text, wrong.empty, f"{len(wrong) or 'None'} of {len(frame)} references state what does not hold.")


@told
def second(frame: pd.DataFrame) -> Verdict:
    """Whether other solvers agree, on every state."""
    apart, bare = frame[frame["disagree"] > 0], frame[frame["unchecked"] > 0]
    pairs, none = int(frame["pairs"].sum()), int(frame["no comparison"].sum())
    if len(apart):
        text = f"Solvers disagree beyond their uncertainties on {listed(list(apart['problem']), 6)}"
    else:
        text = f"In all {pairs} comparisons with another solver the distance is within the uncertainties"
    text += f"; the second solver's own is {number(frame['its uncertainty'].median(), 2)} in the median"
    if none:
        said = "are no comparisons" if none > 1 else "is no comparison"
        text += f"; {none} more {said}: the solver's own uncertainty is above {TELLING:g} of the state"
    text += f". No other solver compares on every state of {listed(list(bare['problem']), 6)}" if len(bare) else ""
    short = f"Solvers disagree on {len(apart)} of {len(frame)} references"
    return Verdict(f"{text}.", apart.empty and bare.empty, f"{short}; {len(bare)} have a state without a comparison.")


@told
def horizons(frame: pd.DataFrame) -> Verdict:
    """Until when errors of trajectories may be told, and whether this machine's long double agrees."""
    short = frame[frame["horizon"] < frame["t_end"]]
    short = short.assign(part=short["horizon"] / short["t_end"]).sort_values("part")
    text = "Rounding to long double stays within its limit to the end of every orbit."
    if len(short):
        parts = [f"{r.problem} (t = {number(r.horizon)} of {number(r.t_end)})" for r in short.itertuples()]
        text = (
            f"Errors of trajectories may be told to the end on {len(frame) - len(short)} of {len(frame)} orbits, on the "
            f"others to the horizon: {listed(parts, 4)}."
        )
    leaves = frame["long double leaves"]
    limited = frame[(frame["earliest"] < frame["t_end"]) | (leaves < frame["t_end"])]
    inside = limited["long double leaves"].between(limited["earliest"], limited["latest"])
    outside = [f"{r['problem']} (t = {number(r['long double leaves'])})" for _, r in limited[~inside].iterrows()]
    if len(limited):
        text += (
            f" On this machine long double left the limit within the interval on {int(inside.sum())} of {len(limited)}"
        )
        text += f", outside on {listed(outside, 4)}." if outside else "."
    # Of 100 runs 5 are outside; more than three standard deviations above that, and the interval is wrong.
    most = 0.05 * len(limited) + 3 * np.sqrt(0.05 * 0.95 * len(limited))
    return Verdict(
        text, bool(len(outside) <= most), f"Horizons fall before the end on {len(short)} of {len(frame)} orbits."
    )


@of(ODD)
def odd_times(frame: pd.DataFrame) -> Verdict:
    """Whether uncertainties hold at times of which no state is stored."""
    wrong = beyond(frame.to_dict("records"))
    ratio = frame["uncertainty"] / frame["error"]
    early = frame[frame["early"].astype(bool)]
    before = int((frame["long double"] > TWICE * frame["two runs"]).sum())
    text = (
        f"At {len(frame)} times of {frame['problem'].nunique()} orbits of which no state is stored, {len(wrong)} states "
        f"are off by more than their uncertainty: it is {number(ratio.min(), 2)} to {number(ratio.max(), 2)} times the "
        f"error. While rounding is below {LIMIT:g} of the state, it is at most "
        f"{number((early['uncertainty'] / early['size']).max(), 2)} of it. {TWICE:g} times the difference of two long "
        f"double runs, alone, would bound their error at {len(frame) - before}."
    )
    text += f" Beyond: {listed(wrong, 2)}." if wrong else ""
    short = f"{len(wrong) or 'None'} of {len(frame)} uncertainties at odd times are below the error."
    return Verdict(text, not wrong, short)


@told
def draw(frame: pd.DataFrame, folder) -> list[Picture]:
    """The errors of the digits with their stated uncertainties, and the horizons with their intervals."""
    shown = frame.sort_values("uncertainty").reset_index(drop=True)
    y = np.arange(len(shown))
    with style.settings():
        figure, ((left, right),) = style.panels(1, 2, 1.3 + 0.145 * len(shown))
        for k, (column, label) in enumerate((("error", "error of the digits"), ("uncertainty", "stated uncertainty"))):
            colour, _, marker = style.CURVES[k]
            left.semilogx(shown[column], y, marker, color=colour, label=label)
        left.set_xlabel("max norm over (q, p) at the last time")
        colour, _, marker = style.CURVES[2]
        t_end = shown["t_end"]
        right.hlines(y, shown["earliest"] / t_end, shown["latest"] / t_end, color=colour, linewidth=2, label="interval")
        right.plot(shown["horizon"] / t_end, y, marker, color=colour, label="horizon")
        right.plot(shown["long double leaves"] / t_end, y, "x", color="0.2", label="long double on this machine")
        right.set_xlabel("horizon / t_end")
        left.set_yticks(y, shown["problem"])
        right.set_yticks(y, [""] * len(y))
        for axes in (left, right):
            axes.set_ylim(-0.7, len(shown) - 0.3)
            axes.grid(color="0.93", linewidth=0.5)
            axes.legend(loc="lower right" if axes is left else "lower left")
    caption = (
        "Each reference: the error of its digits at the last time and the uncertainty that is stated of them; until when "
        "it can be followed, with the interval of 95 of 100 runs in long double."
    )
    return [Picture(style.save(figure, folder, "references.png"), "errors, uncertainties and horizons", caption)]


@told
def table(frame: pd.DataFrame) -> Table:
    """The orbits that part exponentially or whose interval begins before the end, then the largest uncertainties."""
    hard = frame["rate"].notna() | (frame["earliest"] < frame["t_end"])
    shown = pd.concat([frame[hard], frame[~hard].nlargest(10, "uncertainty")])
    caption = (
        "The orbits whose neighbours part exponentially or whose horizon's interval begins before the end, then the ten "
        "largest uncertainties; all at t_end."
    )
    return Table(shown[list(COLUMNS)].rename(columns=COLUMNS).head(ROWS), caption)


@told
def _whole(frame: pd.DataFrame) -> pd.DataFrame:
    return frame[list(COLUMNS)].rename(columns=COLUMNS)


PAGE = Page(
    id="references",
    question="Can the references that errors are measured against be trusted, and until when?",
    tables=("references", ODD),
    setting=(
        f"The stored digits are a Taylor run in 113 bits. Their uncertainty is {FACTOR:g} times their distance from a run "
        f"in {PRECISION.bits} bits of another order, and what that run may be off. Errors are max norms over (q, p).",
        f"Measured again here: the error against a third run in {AGAIN.bits} bits at the tolerance {AGAIN.tolerance}; a "
        f"reference fails where it is above the stated uncertainty, or {LOOSE:g} times below it.",
        f"At odd times a state is told from two runs in long double and {DRAWN} displaced ones; its uncertainty is {TWICE:g} "
        f"times the difference of the two, {GROWN:g} times what a rounding grows to, and a double's rounding. It is judged "
        f"in {MANY} bits, above d = {LARGEST} in quadruple precision.",
        f"Horizon: until when a state that is rounded to long double at every step stays within {LIMIT:g} of its size, in "
        f"the median of {DRAWS} seeded draws of the rounding. It is the problem's, not a machine's.",
        "`earliest` to `latest`: where 95 of 100 runs in long double leave the limit; `this machine`: where one did. "
        "No error of a trajectory is told later than the horizon. "
        "`Gauss 16` (8 stages, long double) shares no code with the Taylor runs: its distance from the orbit, the largest "
        "at any time, beside its own uncertainty.",
    ),
    verdicts=(unmoved, odd_times, second, horizons),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        "All Taylor runs are heyoka's, from the same formulae: an error of these shows in the Gauss method's distance alone, "
        f"to its own uncertainty: {SAFETY:g} times the difference of two step sizes, and round-off grown as neighbours part.",
        f"A solver whose own uncertainty is above {TELLING:g} of the state's size has not two digits of it: it neither agrees "
        "nor disagrees.",
        f"The interval takes rounding for normally distributed: {CENTRAL[1]:.3g} to {CENTRAL[0]:.3g} medians hold 95 % of it. "
        f"A rate (1/t) is given where neighbours part faster than t^{FASTEST:g}.",
    ),
    command="pytest benchmarks/experiments/references",
)
