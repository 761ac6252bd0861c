"""The report page on close encounters of three bodies and a zoom-whirl orbit: which kind of steps follows them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.experiments.extremes import close_encounters, encounters
from phasebench.benchmarks.experiments.extremes.figures import best, curves, legend_below
from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, Count, Verdict

if TYPE_CHECKING:
    from pathlib import Path

(TABLE,) = close_encounters.TABLES


@of(TABLE)
def adaptive(table: pd.DataFrame) -> Verdict:
    """Judge whether every integrator with adaptive steps reaches the wanted error in each of its close encounters."""
    rows = close_encounters.cheapest(table)
    rows = rows[rows["kind"] == "adaptive"]
    lost = [f"{r.method}, {r.scene}" for r in rows[~rows["held"]].itertuples()]
    return Verdict(
        "Integrators with adaptive steps reach the wanted error in every scene",
        Count(int(rows["held"].sum()), len(rows)),
        EVERY,
        "cases of an integrator and a scene",
        join_list(lost, 3) if lost else "",
    )


@of(TABLE)
def answer(table: pd.DataFrame) -> str:
    """Write the page's answer: for each close encounter the fewest steps of each kind that reach the wanted error.

    It also names the kinds of steps (fixed, adaptive, transformed) that fail.
    """
    parts = []
    for scene, rows in close_encounters.cheapest(table).groupby("scene", sort=False):
        fewest = rows[rows["held"]].groupby("kind", sort=False)["steps"].min()
        needs = " or ".join(f"{steps} {kind}" for kind, steps in fewest.items())
        lost = [kind for kind in dict.fromkeys(rows["kind"]) if kind not in fewest]
        parts.append(f"{scene}: {needs or 'none'}{f' ({join_list(lost)} fail)' if lost else ''}")
    return f"Steps needed for an error of {encounters.HELD:g} after close encounters: {'; '.join(parts)}."


@of(TABLE)
@style.styled
def draw(table: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the error at the end over the number of steps, a panel for each close encounter."""
    scenes = list(dict.fromkeys(table["scene"]))
    figure, (panels,) = style.panels(1, len(scenes), 3.8)
    for axes, scene in zip(panels, scenes, strict=True):
        part = table[table["scene"] == scene]
        curves(axes, part, "method", "steps", "error", best(part, "method", "error"), (1e-14, 10))
        axes.axhline(encounters.HELD, color=style.GREY, linewidth=0.8)
        axes.set(title=scene, xlabel="steps")
        legend_below(axes)
    panels[0].set_ylabel("error at the end")
    caption = (
        "The error over the number of steps, with ever smaller steps until it is below the grey line; at the top: the "
        "orbit is lost. At most nine integrators a panel."
    )
    return [Picture(style.save(figure, folder, "extremes-meetings.png"), "other close encounters", caption)]


@of(TABLE)
def table(met: pd.DataFrame) -> Table:
    """Make the page's table: each integrator's run with the fewest steps that follows an encounter, else its best."""
    order = ["scene", "held", "steps"]
    rows = close_encounters.cheapest(met).sort_values(order, ascending=[True, False, True]).head(ROWS)
    shown = rows[["scene", "method", "kind", "steps", "evaluations", "error", "status"]]
    shown = shown.assign(evaluations=shown["evaluations"].where(shown["evaluations"] > 0, np.nan))
    caption = (
        f"The fewest steps with an error of at most {encounters.HELD:g}, else the run of the least error; evaluations are "
        "empty for packages that do not count them."
    )
    return Table(shown, caption)


@of(TABLE)
def full_table(met: pd.DataFrame) -> pd.DataFrame:
    """Return the measured table unchanged: every run through the close encounters, at every step or tolerance."""
    return met


PAGE = Page(
    id="extremes-encounters",
    question="Which steps hold close encounters of three bodies, and a zoom-whirl orbit?",
    tables=(TABLE,),
    setting=(
        "Three bodies: masses 3, 4, 5 at rest, to t = 16, past the approach to 4e-4 at t = 15.83 (Burrau 1913; Szebehely & Peters 1967).",
        "Zoom-whirl: a geodesic of Schwarzschild's metric of eccentricity 1/2 at the edge of stability, to t = 1000; H is not separable.",
        "The error is that of the coordinates at a certified state, relative where they are above 1; steps get smaller by factors of 4, "
        f"tolerances go from {close_encounters.TOLERANCES[0]:g} to {close_encounters.TOLERANCES[-1]:g}.",
        "Transformed: steps that change along the orbit, by Hairer and Söderlind's reversible control or (`of K`) by Poincaré's K = σ (H + p_t) with a symplectic method.",
    ),
    verdicts=(adaptive,),
    answer=answer,
    figures=draw,
    table=table,
    whole=full_table,
    limits=(
        f"A run of a method of this project is stopped after {close_encounters.SECONDS:g} s, and counts with the status it had.",
        "The three bodies' motion multiplies an error by about 10^4 up to the end: a run with a large error is on another orbit.",
        "MERCURIUS and TRACE are made for one dominating body: they are among [Kepler's encounters](extremes.md).",
        "A step costs one evaluation or a hundred: steps are no cost; evaluations are in the table, seconds on the page [speed](speed.md).",
    ),
    command="pytest benchmarks/experiments/extremes",
    listed=False,
)
