"""Three bodies that meet, and an orbit that whirls: which steps hold them."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.experiments.extremes import encounters, meetings, verdicts
from phasebench.benchmarks.experiments.extremes.figures import best, curves, legend_below
from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, of


@of("extremes_meetings")
@style.drawn
def draw(table: pd.DataFrame, folder) -> list[Picture]:
    """The error over the steps, a panel for each scene."""
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
        "The error over the number of steps, each ladder climbed until the error is below the grey line; at the top: "
        "lost. At most nine integrators a panel."
    )
    return [Picture(style.save(figure, folder, "extremes-meetings.png"), "other close encounters", caption)]


@of("extremes_meetings")
def table(met: pd.DataFrame) -> Table:
    """The cheapest run that held of each integrator, or its best."""
    order = ["scene", "held", "steps"]
    rows = meetings.cheapest(met).sort_values(order, ascending=[True, False, True]).head(ROWS)
    shown = rows[["scene", "method", "kind", "steps", "evaluations", "error", "status"]]
    shown = shown.assign(evaluations=shown["evaluations"].where(shown["evaluations"] > 0, np.nan))
    caption = (
        f"The fewest steps with an error of at most {encounters.HELD:g}, or the least error of the ladder; peers that do "
        "not tell their evaluations have none."
    )
    return Table(shown, caption)


@of("extremes_meetings")
def whole(met: pd.DataFrame) -> pd.DataFrame:
    """Every rung."""
    return met


PAGE = Page(
    id="extremes-encounters",
    question="Which steps hold three bodies that meet, and an orbit that whirls?",
    tables=("extremes_meetings",),
    setting=(
        "Three bodies: masses 3, 4, 5 at rest, to t = 16, past the approach to 4e-4 at t = 15.83 (Burrau 1913; Szebehely & Peters 1967).",
        "Zoom-whirl: a geodesic of Schwarzschild's metric of eccentricity 1/2 at the edge of stability, to t = 1000; H is not separable.",
        f"The error is that of the coordinates at certified states; ladders of steps by factors of 4, tolerances {meetings.TOLERANCES[0]:g} to {meetings.TOLERANCES[-1]:g}.",
        "Transformed: Hairer and Soderlind's reversible steps, or (of K) Poincare's K = σ (H + p_t) with a symplectic method.",
    ),
    verdicts=(verdicts.met,),
    figures=draw,
    table=table,
    whole=whole,
    limits=(
        f"A run of a method of this project ends after {meetings.SECONDS:g} s, and counts as it ended.",
        "The three bodies' motion multiplies an error by about 10^4 up to the end: a lost run is on another orbit.",
        "MERCURIUS and TRACE are made for one dominating body: they are among [Kepler's encounters](extremes.md).",
        "A step costs one evaluation or a hundred: the table has both, the page on speed the seconds.",
    ),
    command="pytest benchmarks/experiments/extremes",
    listed=False,
)
