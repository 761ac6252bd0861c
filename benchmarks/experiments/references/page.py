"""The report page on the certified reference states: their errors, horizons, and distances from other solvers.

A horizon is the time up to which a run rounded to long double stays close to the exact orbit.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.truths import GROWN
from phasebench.benchmarks.measure.truths import SAFETY as TWICE
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Data, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, NONE, Count, Verdict, at_least
from phasebench.reference.certificates.check import AGAIN, LOOSE
from phasebench.reference.certificates.followed import DRAWS as DRAWN
from phasebench.reference.certificates.horizon import CENTRAL, DRAWS, FASTEST, LIMIT
from phasebench.reference.certificates.make import FACTOR, PRECISION
from phasebench.reference.certificates.others import SAFETY
from phasebench.reference.certificates.stored import TELLING

from .odd import LARGEST, MANY, ODD

if TYPE_CHECKING:
    from pathlib import Path

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


def judged_rows(frame: pd.DataFrame) -> pd.DataFrame:
    """Select the rows with a measured error from the table of references; rows of an older format have none."""
    return frame[frame["error"].notna()] if "error" in frame else frame.head(0)


def of_references(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator: let a function of the table of references be called with ``data``, a callable name -> table.

    The decorated function reads the table by ``data`` and passes its rows with a measured error, and all further
    arguments, on to ``function``; it returns None if there are no such rows.
    """

    @of("references")
    @functools.wraps(function)
    def from_rows(frame: pd.DataFrame, *more: Any) -> Any:
        rows = judged_rows(frame)
        return None if rows.empty else function(rows, *more)

    return from_rows


def _problems(rows: pd.DataFrame) -> str:
    return join_list(list(rows["problem"]), 4) if len(rows) else ""


@of_references
def confirmations(frame: pd.DataFrame) -> Verdict:
    """Judge whether the stated errors and horizons are confirmed when they are measured again.

    A horizon is the time up to which a run rounded to long double stays close to the exact orbit.  ``frame`` is the
    table of references, a row for each orbit.
    """
    wrong = frame[frame["changed"].astype(object).fillna("") != ""]
    return Verdict(
        "Errors and horizons, measured again, are as each reference states them",
        Count(len(frame) - len(wrong), len(frame)),
        EVERY,
        "references",
        where=_problems(wrong),
        otherwise=FAIL,
    )


@of(ODD)
def odd_times(frame: pd.DataFrame) -> Verdict:
    """Judge whether uncertainties bound the error at times between the stored states.

    ``frame`` is the table of the module `odd`, a row for each orbit and time.
    """
    good = frame["error"] <= frame["uncertainty"]
    tightest = frame.loc[(frame["uncertainty"] / frame["error"]).idxmin()]
    return Verdict(
        "At random times between stored states, the uncertainty bounds the error",
        Count(int(good.sum()), len(frame)),
        EVERY,
        "states",
        where=f"{tightest['problem']}, t = {number(tightest['t'])}",
        otherwise=FAIL,
    )


@of_references
def second(frame: pd.DataFrame) -> Verdict:
    """Judge whether no other solver differs from a reference state by more than the uncertainties of both.

    ``frame`` is the table of references, a row for each orbit.
    """
    apart = frame[frame["disagree"] > 0]
    return Verdict(
        "No other solver disagrees beyond the uncertainties of both",
        Count(int(frame["disagree"].sum()), int(frame["pairs"].sum())),
        NONE,
        "comparisons",
        where=_problems(apart),
        otherwise=FAIL,
    )


@of_references
def comparisons(frame: pd.DataFrame) -> Verdict:
    """Judge whether each stored state is compared with at least one other solver that is accurate enough.

    ``frame`` is the table of references, a row for each orbit.
    """
    bare = frame[frame["unchecked"] > 0]
    states = int(frame["states"].sum())
    return Verdict(
        "Another solver is accurate enough to check every stored state",
        Count(states - int(frame["unchecked"].sum()), states),
        EVERY,
        "states",
        where=_problems(bare),
        otherwise=FAIL,
    )


@of_references
def horizons(frame: pd.DataFrame) -> Verdict | None:
    """Judge whether a long double run loses its accuracy within the time interval predicted from random rounding.

    ``frame`` is the table of references, a row for each orbit; None if every run and interval reaches its end time.
    """
    leaves = frame["long double leaves"]
    limited = frame[(frame["earliest"] < frame["t_end"]) | (leaves < frame["t_end"])]
    if limited.empty:
        return None
    inside = limited["long double leaves"].between(limited["earliest"], limited["latest"])
    # 5 % of the runs are expected outside; three standard deviations more show that the interval is wrong.
    outside = 0.05 + 3 * np.sqrt(0.05 * 0.95 / len(limited))
    return Verdict(
        "A long double run on this machine leaves the limit within the predicted interval",
        Count(int(inside.sum()), len(limited)),
        at_least(1 - outside),
        "orbits",
        where=_problems(limited[~inside]),
        otherwise=FAIL,
    )


def answer(data: Data) -> str | None:
    """Write the page's answer: how many reference orbits are confirmed, and how many long double follows only in part.

    If only the states between the stored times were measured, the answer is on these.  ``data`` maps a table's name to
    the table; None if both tables are missing.
    """
    frame, odd = data("references"), data(ODD)
    rows = pd.DataFrame() if frame is None else judged_rows(frame)
    if len(rows):
        verdict, short = confirmations(data).measured, int((rows["horizon"] < rows["t_end"]).sum())
        return (
            f"{verdict.n} of {verdict.of} reference orbits are confirmed, uncertain by at most "
            f"{number(rows['uncertainty'].max(), 2)}; {short} of them can be followed in long double for a part of their "
            "time span only."
        )
    if odd is None or odd.empty:
        return None
    return f"{odd_times(data).measured.n} of {len(odd)} reference states at random times are within their uncertainty."


@of_references
def draw(frame: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the errors of the stored digits with their uncertainties (left), and the horizons with intervals (right).

    A horizon is the time up to which a run rounded to long double stays close to the exact orbit.  ``frame`` is the
    table of references, a row for each orbit; the figure is saved in ``folder``.
    """
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
        "Left: the error of each reference's digits at its last time, and the uncertainty stated for them. Right: its "
        "horizon, with the interval in which 95 of 100 long double runs leave the limit."
    )
    return [Picture(style.save(figure, folder, "references.png"), "errors, uncertainties and horizons", caption)]


@of_references
def table(frame: pd.DataFrame) -> Table:
    """Make the page's table, a row for each orbit that is hard to follow, then the ten largest uncertainties.

    An orbit is hard to follow if neighbours diverge exponentially, or if long double may lose accuracy before its end.
    ``frame`` is the table of references, a row for each orbit.
    """
    hard = frame["rate"].notna() | (frame["earliest"] < frame["t_end"])
    shown = pd.concat([frame[hard], frame[~hard].nlargest(10, "uncertainty")])
    caption = (
        "The orbits with exponential divergence (rate, in 1/t) or whose interval begins before the end, then the ten "
        "largest uncertainties; errors at t_end. Comparisons left out, because the other solver has not two digits: "
        f"{int(frame['no comparison'].sum())}."
    )
    return Table(shown[list(COLUMNS)].rename(columns=COLUMNS).head(ROWS), caption)


@of_references
def _full_table(frame: pd.DataFrame) -> pd.DataFrame:
    return frame[list(COLUMNS)].rename(columns=COLUMNS)


PAGE = Page(
    id="references",
    question="Can the references that errors are measured against be trusted, and until when?",
    tables=("references", ODD),
    setting=(
        f"Stored digits: a Taylor run in 113 bits. Their uncertainty: {FACTOR:g} times their distance from a run in "
        f"{PRECISION.bits} bits and of another order, plus that run's own. Errors are max norms over (q, p).",
        f"The error is measured again by a third run, in {AGAIN.bits} bits at the tolerance {AGAIN.tolerance}. A "
        f"reference fails where it exceeds the stated uncertainty, or is {LOOSE:g} times smaller.",
        f"Between stored times: two long double runs and {DRAWN} displaced ones. Uncertainty: {TWICE:g} times the "
        f"difference of the two, {GROWN:g} times the growth of a rounding error, and a double's rounding; judged in "
        f"{MANY} bits, above d = {LARGEST} in quadruple precision.",
        "Horizon: the time until which a state that is rounded to long double at every step stays within "
        f"{LIMIT:g} of its size, in the median of {DRAWS} seeded draws of the rounding; `earliest` to `latest` holds 95 "
        "of 100 runs, `this machine` is one. Later, no error of a trajectory is given.",
        "`Gauss 16` (8 stages, long double) shares no code with the Taylor runs: its largest distance from the orbit, "
        "beside its own uncertainty.",
    ),
    verdicts=(confirmations, odd_times, second, comparisons, horizons),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        "All Taylor runs are heyoka's, from the same formulae: a mistake there shows only in the distance of the Gauss "
        f"method, down to its own uncertainty ({SAFETY:g} times the difference of two step sizes, and grown round-off).",
        f"A solver whose own uncertainty is above {TELLING:g} of the state's size has not two digits: it is not compared.",
        "Some runs leave the interval by chance: 5 % are expected outside, and up to three standard deviations more are "
        "allowed.",
        f"The interval takes rounding as normally distributed: {CENTRAL[1]:.3g} to {CENTRAL[0]:.3g} medians hold 95 % of "
        f"it. Divergence counts as exponential where neighbours part faster than t^{FASTEST:g}.",
    ),
    command="pytest benchmarks/experiments/references",
)
