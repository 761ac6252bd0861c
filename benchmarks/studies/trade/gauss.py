"""The error below which the Gauss method of order 16 is faster than explicit methods.

Its eight stages are evaluated in the lanes of vector registers, so that a sweep of its iteration costs little more than
one evaluation.  Antonana, Makazaga and Murua published the same independently, with the claim that is judged here.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.ladder.competitors import FIRST
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Data, Table, of, once
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Study
from phasebench.benchmarks.problems.questions import BY_ID as QUESTIONS
from phasebench.integrators.families import parametric
from phasebench.integrators.registry import BY_ID

from .front import RUNGS

GAUSS = "gauss-8"
#: Families whose methods solve no equations, in steps of one length; parametric methods are told by their substeps.
EXPLICIT = ("splitting", "processed", "force_gradient", "trigonometric", "wisdom_holman", "runge_kutta")
#: The scene of the publication that the trade has, too.
PLANETS = "outer-planets-jupiter"


@cache
def is_explicit(id: str, separable: bool) -> bool:
    """True if a method (no peer) takes steps of one length and solves no equations, if H is ``separable`` or not."""
    if id not in BY_ID:
        return False
    method = BY_ID[id]
    if method.family != "parametric":
        return method.family in EXPLICIT
    return separable and parametric.is_splitting(method)


@of(RUNGS)
@once
def ratios(rungs: pd.DataFrame) -> pd.DataFrame:
    """Times of Gauss of order 16 and of the fastest explicit method: a row for each scene and error that both reach.

    The rows of a scene end at the error where the search has dropped the best explicit methods: the fastest one is
    unknown from there on.
    """
    met = rungs[(rungs["status"] == "ok") & (rungs["seconds"] > 0)]
    rows = []
    for scene, part in met.groupby("scene", sort=False):
        separable = QUESTIONS[scene].build_problem().system.separable
        explicit, gauss = part[[is_explicit(id, separable) for id in part["id"]]], part[part["id"] == GAUSS]
        before = None
        for accuracy in QUESTIONS[scene].accuracies:
            ours, others = (x[x["error"] <= accuracy] for x in (gauss, explicit))
            if len(ours) and len(others):
                best = others.loc[others["seconds"].idxmin()]
                if best["id"] in FIRST and before not in (None, best["integrator"]):
                    break
                before = best["integrator"]
                rows.append((scene, accuracy, ours["seconds"].min() / best["seconds"], before))
    return pd.DataFrame(rows, columns=["scene", "accuracy", "ratio", "fastest explicit"])


def crossings(found: pd.DataFrame) -> pd.Series:
    """The largest error of each scene at which, and at every smaller one, Gauss is no slower; NaN if there is none."""
    ordered = found.sort_values("accuracy")
    faster = (ordered["ratio"] <= 1).groupby(ordered["scene"]).cummin()
    return ordered[faster].groupby("scene")["accuracy"].max().reindex(found["scene"].unique())


def extreme(which: str) -> Callable[[Data], pd.DataFrame | None]:
    """The rows at the largest ("idxmax") or the smallest ("idxmin") error of each scene, the clearest ratio first."""

    def rows(found: pd.DataFrame) -> pd.DataFrame:
        out = found.loc[found.groupby("scene", sort=False)["accuracy"].agg(which)]
        return out.iloc[np.argsort(-np.log(out["ratio"]).abs(), kind="stable")]

    return of(ratios)(rows)


largest, smallest = extreme("idxmax"), extreme("idxmin")


@of(ratios)
def _answer(found: pd.DataFrame) -> str:
    first = crossings(found)
    ever = first.dropna()
    if ever.empty:
        return f"On none of {len(first)} scenes is Gauss of order 16 faster than explicit methods."
    text = (
        f"On {len(ever)} of {len(first)} scenes Gauss of order 16 is faster than explicit methods for small errors: "
        f"from {number(10 ** np.median(np.log10(ever)), 1)} (median)"
    )
    return f"{text}, on the outer planets from {number(ever[PLANETS], 1)}." if PLANETS in ever else f"{text}."


@picture(
    ratios, "gauss-16", "Gauss of order 16 beside explicit methods",
    "Below the dotted line Gauss of order 16 is the faster; a grey line is a scene.",
)  # fmt: skip
def _draw(found: pd.DataFrame) -> style.Figure:
    figure, ((axes,),) = style.panels(1, 1, 3.4)
    planets = found["scene"] == PLANETS
    for _, part in found[~planets].groupby("scene", sort=False):
        axes.loglog(part["accuracy"], part["ratio"], color=style.GREY, linewidth=0.5)
    middle = found.groupby("accuracy")["ratio"].median()
    axes.loglog(middle.index, middle, label="median of the scenes", **style.curve(0))
    if planets.any():
        axes.loglog(found["accuracy"][planets], found["ratio"][planets], label="outer planets", **style.curve(1))
    axes.axhline(1, color=style.GREY, linewidth=0.8, linestyle=":")
    axes.set(xlabel="error up to", ylabel="time of Gauss over the best explicit")
    axes.invert_xaxis()
    axes.legend(loc="lower left")
    return figure


@of(ratios, largest, smallest)
def _full_table(found: pd.DataFrame, first: pd.DataFrame, last: pd.DataFrame) -> pd.DataFrame:
    cross = crossings(found).sort_values(ascending=False)
    first, last = (x.set_index("scene").loc[cross.index] for x in (first, last))
    columns = {
        "scene": [f"[{scene}](trade-{scene}.md)" for scene in cross.index],
        "faster from": ["nowhere" if np.isnan(x) else f"{x:.0e}" for x in cross],
        "ratio at the largest error": first["ratio"],
        "smallest error": [f"{x:.0e}" for x in last["accuracy"]],
        "ratio at the smallest": last["ratio"],
        "fastest explicit": last["fastest explicit"],
    }
    return pd.DataFrame(columns).reset_index(drop=True)


@of(_full_table)
def _table(whole: pd.DataFrame) -> Table:
    caption = (
        "Faster from: the largest error from which on Gauss is no slower at every smaller one. Ratio: Gauss' time over "
        "that of the fastest explicit method, which is named for the smallest error. In the order of the first number"
        f"{'' if len(whole) <= ROWS else f', the first {ROWS} scenes'}."
    )
    return Table(whole.head(ROWS), caption)


STUDY = Study(
    id="gauss-16",
    place=30,
    question="From which error on does the Gauss method of order 16 beat explicit methods?",
    reads=(RUNGS,),
    runs=(),
    answer=_answer,
    setting=(
        f"{GAUSS} has eight stages, whose equations are solved to round-off by fixed-point iteration, the stages side "
        "by side in the lanes of vector registers.",
        "M. Antoñana, J. Makazaga, A. Murua, arXiv 2511.03655, published such stages independently, in Julia, and "
        "that they can outperform explicit symplectic methods for high precision.",
        "Beside it: the fastest of all explicit methods of this project with steps of one length, splittings of a "
        "Kepler problem among them, at the same error.",
        "Scenes and times are those of the search in [the trade](trade.md).",
    ),
    claims={
        "fine": Claim(
            "At the smallest error that both reach, Gauss of order 16 is the faster",
            smallest, "ratio <= 1", unit="scenes", where="{scene}: {ratio:.3g} times",
        ),
        "coarse": Claim(
            "At the largest error an explicit method is the faster",
            largest, "ratio >= 1", unit="scenes", where="{scene}: {ratio:.3g} times",
        ),
    },
    figure=_draw,
    shown=_table,
    whole=_full_table,
    command="pytest benchmarks -k trade",
    limits=(
        "Times are those of the search, medians of a few warm runs that did not run in turns: ratios within a tenth "
        "of 1 may lie on either side.",
        "Methods that fall behind in the search are measured no further: beyond the crossing the explicit method may "
        "not be the best one. Where all but the first of the search are dropped a scene ends.",
        "Times are of this machine: the number of lanes is its processor's.",
    ),
)  # fmt: skip
