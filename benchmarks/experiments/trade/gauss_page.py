"""The report's page "gauss-16": the error below which the Gauss method of order 16 is faster than explicit methods.

Its eight stages are evaluated in the lanes of vector registers, so that a sweep of its iteration costs little more than
one evaluation.  Antonana, Makazaga and Murua published the same independently, with the claim that is judged here.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, of, once
from phasebench.benchmarks.page.verdict import EVERY, Count, Verdict
from phasebench.benchmarks.problems.questions import BY_ID as QUESTIONS
from phasebench.integrators.families import parametric
from phasebench.integrators.registry import BY_ID

from .field import FIRST
from .front import RUNGS

if TYPE_CHECKING:
    from pathlib import Path

GAUSS = "gauss-8"
#: Families whose methods solve no equations, in steps of one length; parametric methods are told by their substeps.
EXPLICIT = ("splitting", "processed", "force_gradient", "trigonometric", "wisdom_holman", "runge_kutta")
#: The scene of the publication that the trade has, too.
PLANETS = "outer-planets-jupiter"


@cache
def is_explicit(id: str, separable: bool) -> bool:
    """Return whether the method ``id`` takes steps of one length and solves no equations.

    ``separable`` is True if the system's H is separable, as some methods are explicit only then.  False if ``id`` is
    that of a peer, another package's integrator.
    """
    if id not in BY_ID:
        return False
    method = BY_ID[id]
    if method.family != "parametric":
        return method.family in EXPLICIT
    return separable and parametric.is_splitting(method)


@once
def ratios(rungs: pd.DataFrame) -> pd.DataFrame:
    """Compare Gauss of order 16 with the fastest explicit method: a row for each scene and error that both reach.

    A row has both times in seconds, their ratio, and the explicit method's name.  ``rungs`` has all runs of the search.
    The rows of a scene end at the error where the search has dropped the best explicit methods: the fastest one is
    unknown from there on.
    """
    met = rungs[(rungs["status"] == "ok") & (rungs["seconds"] > 0)]
    rows = []
    for scene, part in met.groupby("scene", sort=False):
        separable = QUESTIONS[scene].build_problem().system.separable
        explicit, gauss = part[[is_explicit(id, separable) for id in part["id"]]], part[part["id"] == GAUSS]
        known: list[tuple] = []
        for accuracy in QUESTIONS[scene].accuracies:
            ours, others = (x[x["error"] <= accuracy] for x in (gauss, explicit))
            if len(ours) and len(others):
                best = others.loc[others["seconds"].idxmin()]
                if best["id"] in FIRST and known and known[-1][-1] != best["integrator"]:
                    break
                seconds = ours["seconds"].min(), best["seconds"]
                known.append((scene, accuracy, *seconds, seconds[0] / seconds[1], best["integrator"]))
        rows += known
    columns = ["scene", "accuracy", "gauss", "explicit", "ratio", "fastest explicit"]
    return pd.DataFrame(rows, columns=columns)


def crossing(part: pd.DataFrame) -> float:
    """Return the largest error at which, and at every smaller one, Gauss is no slower than explicit methods.

    ``part`` has the rows of `ratios` of one scene; NaN if there is no such error.
    """
    part = part.sort_values("accuracy")
    faster = (part["ratio"] <= 1).cummin()
    return float(part.loc[faster, "accuracy"].max()) if faster.any() else np.nan


def crossings(rungs: pd.DataFrame) -> pd.Series:
    """Return by scene the largest error at and below which the Gauss method is no slower than explicit methods.

    NaN for a scene without such an error.  ``rungs`` has all runs of the search.
    """
    return pd.Series({scene: crossing(part) for scene, part in ratios(rungs).groupby("scene", sort=False)}, dtype=float)


def _ends(rungs: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the rows of `ratios` (Gauss against explicit) at each scene's largest error, and at its smallest.

    Both tables are indexed by scene.  ``rungs`` has all runs of the search.
    """
    by = (found := ratios(rungs)).groupby("scene", sort=False)["accuracy"]
    return found.loc[by.idxmax()].set_index("scene"), found.loc[by.idxmin()].set_index("scene")


def _counted(holds: pd.Series, ratio: pd.Series) -> dict:
    """Return arguments of a `Verdict`: on how many scenes a claim ``holds``, and where it fails by the largest factor.

    ``holds`` and ``ratio``, Gauss' time over the best explicit method's, are indexed by scene.
    """
    wrong = np.log(ratio[~holds]).abs()
    where = "" if wrong.empty else f"{wrong.idxmax()}: {number(ratio[wrong.idxmax()])} times"
    measured = Count(int(holds.sum()), len(holds))
    return {"measured": measured, "expected": EVERY, "unit": "scenes", "where": where}


@of(RUNGS)
def fine(rungs: pd.DataFrame) -> Verdict:
    """Judge whether Gauss of order 16 is faster than explicit methods at a scene's smallest error, on every scene.

    The smallest error is the least one that both Gauss and an explicit method reach.
    """
    ratio = _ends(rungs)[1]["ratio"]
    return Verdict(
        "At the smallest error that both reach, Gauss of order 16 is the faster", **_counted(ratio <= 1, ratio)
    )


@of(RUNGS)
def coarse(rungs: pd.DataFrame) -> Verdict:
    """Judge whether an explicit method is faster than Gauss of order 16 at a scene's largest error, on every scene.

    It is the largest of the errors for which methods are compared on the scene, and which both reach.
    """
    ratio = _ends(rungs)[0]["ratio"]
    return Verdict("At the largest error an explicit method is the faster", **_counted(ratio >= 1, ratio))


@of(RUNGS)
def answer(rungs: pd.DataFrame) -> str:
    """Return the page's answer: on how many scenes Gauss becomes faster than explicit methods, and from which error."""
    found = crossings(rungs)
    ever = found.dropna()
    if ever.empty:
        return f"On none of {len(found)} scenes is Gauss of order 16 faster than explicit methods."
    text = (
        f"On {len(ever)} of {len(found)} scenes Gauss of order 16 is faster than explicit methods for small errors: "
        f"from {number(10 ** np.median(np.log10(ever)), 1)} (median)"
    )
    planets = found.get(PLANETS, np.nan)
    return f"{text}." if np.isnan(planets) else f"{text}, on the outer planets from {number(planets, 1)}."


@of(RUNGS)
@style.styled
def draw(rungs: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the ratio of Gauss' time to the best explicit method's over the error: each scene, and their median.

    The outer planets have a curve of their own.
    """
    found = ratios(rungs)
    figure, ((axes,),) = style.panels(1, 1, 3.4)
    for scene, part in found.groupby("scene", sort=False):
        if scene != PLANETS:
            axes.loglog(part["accuracy"], part["ratio"], color=style.GREY, linewidth=0.5)
    middle = found.groupby("accuracy")["ratio"].median()
    axes.loglog(middle.index, middle, label="median of the scenes", **style.curve(0))
    planets = found[found["scene"] == PLANETS]
    if len(planets):
        axes.loglog(planets["accuracy"], planets["ratio"], label="outer planets", **style.curve(1))
    axes.axhline(1, color=style.GREY, linewidth=0.8, linestyle=":")
    axes.set(xlabel="error up to", ylabel="time of Gauss over the best explicit")
    axes.invert_xaxis()
    axes.legend(loc="lower left")
    caption = "Below the dotted line Gauss of order 16 is the faster; a grey line is a scene."
    return [Picture(style.save(figure, folder, "gauss-16.png"), "Gauss of order 16 beside explicit methods", caption)]


@of(RUNGS)
def table(rungs: pd.DataFrame) -> Table | None:
    """Return the page's table, a row for each scene: the error from which on Gauss is faster, and ratios of times.

    The ratios are those at the scene's largest and smallest error.  None without rows.
    """
    whole = _full_table(rungs)
    if whole.empty:
        return None
    caption = (
        "Faster from: the largest error from which on Gauss is no slower at every smaller one. Ratio: Gauss' time over "
        "that of the fastest explicit method, which is named for the smallest error. In the order of the first number"
        f"{'' if len(whole) <= ROWS else f', the first {ROWS} scenes'}."
    )
    return Table(whole.head(ROWS), caption)


def _full_table(rungs: pd.DataFrame) -> pd.DataFrame:
    first, last = _ends(rungs)
    found = crossings(rungs)
    rows = [
        {
            "scene": f"[{scene}](trade-{scene}.md)",
            "faster from": "nowhere" if np.isnan(found[scene]) else f"{found[scene]:.0e}",
            "ratio at the largest error": first["ratio"][scene],
            "smallest error": f"{last['accuracy'][scene]:.0e}",
            "ratio at the smallest": last["ratio"][scene],
            "fastest explicit": last["fastest explicit"][scene],
        }
        for scene in found.sort_values(ascending=False).index
    ]
    return pd.DataFrame(rows)


PAGE = Page(
    id="gauss-16",
    question="From which error on does the Gauss method of order 16 beat explicit methods?",
    tables=(RUNGS,),
    setting=(
        f"{GAUSS} has eight stages, whose equations are solved to round-off by fixed-point iteration, the stages side "
        "by side in the lanes of vector registers.",
        "M. Antoñana, J. Makazaga, A. Murua, arXiv 2511.03655, published such stages independently, in Julia, and "
        "that they can outperform explicit symplectic methods for high precision.",
        "Beside it: the fastest of all explicit methods of this project with steps of one length, splittings of a "
        "Kepler problem among them, at the same error.",
        "Scenes and times are those of the search in [the trade](trade.md).",
    ),
    verdicts=(fine, coarse),
    answer=answer,
    figures=draw,
    table=table,
    whole=of(RUNGS)(_full_table),
    limits=(
        "Times are those of the search, medians of a few warm runs that did not run in turns: ratios within a tenth "
        "of 1 may lie on either side.",
        "Methods that fall behind in the search are measured no further: beyond the crossing the explicit method may "
        "not be the best one. Where all but the first of the search are dropped a scene ends.",
        "Times are of this machine: the number of lanes is its processor's.",
    ),
    command="pytest benchmarks/experiments/trade",
)
