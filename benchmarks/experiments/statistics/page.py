"""The report's page "statistics": the largest steps at which integrators still give averages over chaotic orbits."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Page, Picture, Table, of

from . import claims, measure
from .measure import EXACT, TABLE
from .scenes import SCENES

if TYPE_CHECKING:
    from .scenes import Scene

#: Rows of panels of the figure, and the methods that it shows.
ROWS = 2
SHOWN = ("symplectic-euler-q", "stormer-verlet", "calvo-sanz-serna-4", "blanes-moan-srkn6b", "rk4", "dop853")


@of(TABLE, EXACT)
def answer(rows: pd.DataFrame, exact: pd.DataFrame) -> str:
    """Return the page's answer: the method that is most often the cheapest, and the costs of leapfrog and RK4.

    These costs are told relative to the cheapest method, as medians over the scenes.  ``rows`` has a row for each scene
    (a statistic of an ensemble of orbits), method and step, ``exact`` the exact value of each scene.
    """
    found = claims.by_scene(rows, exact)
    if found.empty:
        return "No method reaches 1 % in any scene."
    best = found.idxmin(axis=1).value_counts()
    leapfrog, rk4 = ((found[id] / found.min(axis=1)).median() for id in ("stormer-verlet", "rk4"))
    return (
        f"{best.index[0]} gives statistics to 1 % in the fewest evaluations on {best.iloc[0]} of {rows['scene'].nunique()} scenes; in "
        f"the median leapfrog (stormer-verlet) needs {number(leapfrog)} times the fewest, RK4 {number(rk4)} times."
    )


@of(TABLE, EXACT)
def table(rows: pd.DataFrame, exact: pd.DataFrame) -> Table:
    """Return the page's table: gradient evaluations per unit of time for an error of 1 %.

    It has a row for each scene (a statistic of an ensemble) and a column for each method.  ``rows`` has a row for each
    scene, method and step, ``exact`` the exact value of each scene.
    """
    found = claims.by_scene(rows, exact).reindex([s for s in SCENES if s in set(rows["scene"])], fill_value=inf)
    known = exact.set_index("scene")
    shown = pd.DataFrame(
        {
            "scene": list(found.index),
            "exact": [number(known["exact"][s]) for s in found.index],
            "standard error": [number(known["standard error"][s]) for s in found.index],
            **{m: ["" if x == inf else number(x) for x in found[m]] for m in measure.METHODS},
        }
    )
    caption = (
        "Evaluations of the gradient in a unit of time at the largest step from which on the error and "
        f"{claims.SIGMAS:g} standard errors are within 1 %; empty where none was or the method cannot. "
        "`exact`: the statistic itself; `standard error`: that of the ensemble."
    )
    return Table(shown, caption)


@of(TABLE, EXACT)
def draw(rows: pd.DataFrame, exact: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the errors of the statistics against gradient evaluations, a panel for each scene; save in ``folder``.

    ``rows`` has a row for each scene (a statistic of an ensemble of orbits), method and step, ``exact`` the exact value
    of each scene.
    """
    found = claims.bounds(rows, exact)
    with style.settings():
        figure, panels = style.panels(ROWS, -(-len(SCENES) // ROWS), 4.0)
        every = [a for row in panels for a in row]
        for axes in every[len(SCENES) :]:
            axes.set_axis_off()
        for axes, id in zip(every, SCENES, strict=False):
            for k, method in enumerate(SHOWN):
                part = found[(found["scene"] == id) & (found["method"] == method)]
                axes.loglog(part["evaluations"], 100 * part["error"], label=method, **style.curve(k))
            axes.axhline(100 * measure.WANTED, color="0.4", linewidth=0.8)
            axes.set_title(id, fontsize="small")
            axes.grid(color="0.93", linewidth=0.5)
        figure.supxlabel("evaluations of the gradient in a unit of time", fontsize="medium")
        for row in panels:
            row[0].set_ylabel("error (%)")
        style.legend_above(figure, panels[0][0], 3)
        file = style.save(figure, folder, "statistics.png")
    caption = "Error of the statistic over the evaluations; the line is 1 %. Errors level off at the statistical uncertainty of the ensembles."
    return [Picture(file, "errors of statistics", caption)]


def _scene(s: Scene) -> str:
    formula = s.formula.replace("**2", "²").replace("*", " ")
    what = f"share of crossings of {s.plane} = 0 with {formula} > 0" if s.plane else f"mean of {formula}"
    what = what if formula else "mean of the largest Lyapunov exponents"
    return f"{s.id}: {what}, {s.orbits} orbits to t = {s.span:g}" + (f", E = {s.energy:g}" if s.energy else "")


def _settings() -> tuple[str, ...]:
    """Return texts for the page that describe all scenes (statistics of ensembles of orbits), two scenes in each."""
    told = [_scene(s) for s in SCENES.values()]
    return tuple("; ".join(told[k : k + 2]) + "." for k in range(0, len(told), 2))


PAGE = Page(
    id="statistics",
    question="Which integrator gives statistics of chaotic orbits at the least cost, and does structure matter?",
    tables=(TABLE, EXACT),
    setting=(
        *_settings(),
        "Starts lie on a surface of constant energy, by the measure that the flow keeps: averages over it are known exactly. "
        "For the atoms and the exponents Kahan and Li's method of order 8, with 16 steps between rows, stands for the exact flow.",
    ),
    verdicts=(claims.sound, claims.orders, claims.structure, claims.leapfrog, claims.lasting),
    answer=answer,
    figures=draw,
    table=table,
    limits=(
        "Cost is evaluations of the gradient: methods that iterate or solve equations pay for it besides.",
        "The ladder of steps is coarse, factors of 1.3 to 1.5; a step in between may do.",
        "Averages over the whole surface count regular islands, too: they are no averages of one chaotic orbit.",
        "Exponents are those of a finite time, over which an orbit's own varies.",
    ),
    command="pytest benchmarks/experiments/statistics",
)
