"""Statistics of chaotic orbits, and the largest steps at which integrators give them right."""

from __future__ import annotations

from math import inf
from pathlib import Path

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Picture, Table, of
from phasebench.benchmarks.page.study import Claim, Runs, Study, over
from phasebench.benchmarks.page.verdict import EVERY, at_least, at_most

from . import claims
from .measure import EXACT, METHODS, TABLE, WANTED, able, ladder, needs, reference
from .scenes import SCENES, Scene

#: Rows of panels of the figure, and the methods that it shows.
ROWS = 2
SHOWN = ("symplectic-euler-q", "stormer-verlet", "calvo-sanz-serna-4", "blanes-moan-srkn6b", "rk4", "dop853")


@of(TABLE, EXACT)
def answer(rows: pd.DataFrame, exact: pd.DataFrame) -> str:
    """The method that is most often the cheapest, and the costs of leapfrog and RK4 over it, as medians over scenes."""
    found = claims.by_scene(rows, exact)
    if found.empty:
        return "No method reaches 1 % in any scene."
    best = found.eq(found.min(axis=1), axis=0)
    wins = best.sum().max()
    names = " and ".join(m for m in found if best[m].sum() == wins)
    leapfrog, rk4 = ((found[id] / found.min(axis=1)).median() for id in ("stormer-verlet", "rk4"))
    return (
        f"{names} needs the fewest evaluations for 1 % on {wins} of {rows['scene'].nunique()} scenes, ties "
        f"included; in the median leapfrog (stormer-verlet) needs {number(leapfrog)} times the "
        f"fewest, RK4 {number(rk4)} times."
    )


@of(TABLE, EXACT)
def table(rows: pd.DataFrame, exact: pd.DataFrame) -> Table:
    """The evaluations for an error of 1 %: a row for each scene, a column for each method."""
    found = claims.by_scene(rows, exact).reindex([s for s in SCENES if s in set(rows["scene"])], fill_value=inf)
    known = exact.set_index("scene")
    shown = pd.DataFrame(
        {
            "scene": list(found.index),
            "exact": [number(known["exact"][s]) for s in found.index],
            "standard error": [number(known["standard error"][s]) for s in found.index],
            **{m: ["" if x == inf else number(x) for x in found[m]] for m in METHODS},
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
    """The errors of the statistics against evaluations, a panel for each scene."""
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
            axes.axhline(100 * WANTED, color="0.4", linewidth=0.8)
            axes.set_title(id, fontsize="small")
            axes.grid(color="0.93", linewidth=0.5)
        figure.supxlabel("evaluations of the gradient in a unit of time", fontsize="medium")
        for row in panels:
            row[0].set_ylabel("error (%)")
        style.legend_above(figure, panels[0][0], 3)
        file = style.save(figure, folder, "statistics.png")
    caption = (
        "Error of the statistic over the evaluations; the line is 1 %. Errors level off at the statistical uncertainty "
        "of the ensembles."
    )
    return [Picture(file, "errors of statistics", caption)]


def _scene(s: Scene) -> str:
    formula = s.formula.replace("**2", "²").replace("*", " ")
    what = f"share of crossings of {s.plane} = 0 with {formula} > 0" if s.plane else f"mean of {formula}"
    what = what if formula else "mean of the largest Lyapunov exponents"
    return f"{s.id}: {what}, {s.orbits} orbits to t = {s.span:g}" + (f", E = {s.energy:g}" if s.energy else "")


DESCRIBED = [_scene(s) for s in SCENES.values()]
STUDY = Study(
    id="statistics",
    place=110,
    question="Which integrator gives statistics of chaotic orbits at the least cost, and does structure matter?",
    answer=answer,
    setting=(
        *("; ".join(DESCRIBED[k : k + 2]) + "." for k in range(0, len(DESCRIBED), 2)),
        "Starts lie on a surface of constant energy, by the measure that the flow keeps: averages over it are known "
        "exactly. For the atoms and the exponents Kahan and Li's method of order 8, with 16 steps between rows, stands "
        "for the exact flow.",
    ),
    runs=(
        Runs(TABLE, ladder, [{"scene": s, "method": m} for s in SCENES for m in METHODS if able(s, m)], needs=needs),
        Runs(EXACT, reference, over(scene=tuple(SCENES)), needs=needs),
    ),
    claims={
        "sound": Claim(
            "Fine runs have the averages over the surface of constant energy",
            EXACT, lambda rows: claims.off(rows) <= claims.SAME, EVERY, rows="known", unit="scenes",
            where=claims.farthest, checked=True,
        ),
        "orders": Claim(
            "For statistics of chaotic orbits higher order is no practical advantage",
            TABLE, claims.ratio(claims.of_order(0, 2), claims.of_order(4, 99)), at_most(1.0), beside=(EXACT,),
            unit="times the evaluations of order 4 or more, by order 2", span=True,
        ),
        "structure": Claim(
            "For statistics a symplectic method of order 4 is cheaper than RK4",
            TABLE, claims.ratio(lambda found: found[claims.RK4], lambda found: found[[*claims.FOURTH]].min(axis=1)),
            at_least(1.0), beside=(EXACT,), unit="times the evaluations, by RK4", span=True,
        ),
        "leapfrog": Claim(
            "Leapfrog gives statistics to 1 % at the least cost",
            TABLE, claims.leapfrog, at_most(1.0), beside=(EXACT,), unit="times the fewest evaluations", span=True,
        ),
        "lasting": Claim(
            "Where symplectic methods give a statistic they give it at late times too",
            TABLE, claims.lasting, EVERY, rows="symplectic", beside=(EXACT,), unit="rows", where=claims.drifting,
        ),
    },
    figure=draw,
    shown=table,
    whole=lambda data: None,
    limits=(
        "Cost is evaluations of the gradient: methods that iterate or solve equations pay for it besides.",
        "The ladder of steps is coarse, factors of 1.3 to 1.5; a step in between may do.",
        "Averages over the whole surface count regular islands, too: they are no averages of one chaotic orbit.",
        "Exponents are those of a finite time, over which an orbit's own varies.",
    ),
)  # fmt: skip
