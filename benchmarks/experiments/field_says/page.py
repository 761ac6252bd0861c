"""The report page on what packages' guides say of integrators: each statement beside its measurement."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page import quoted
from phasebench.benchmarks.page.page import Data, Page, Picture, Table, of

from . import claims, cost, encounters, energy, growth, orders
from .claims import SAID

TABLES = (growth.TABLE, cost.TABLE, orders.TABLE, energy.TABLE, encounters.TABLE)
#: Methods that the figure shows.
SHOWN = ("stormer-verlet", "mclachlan-atela-2", "mclachlan-atela-3", "calvo-sanz-serna-4", "kahan-li-6", "kahan-li-8")


def answer(data: Data) -> str | None:
    """Write the page's answer, a sentence: how many statements hold, and how many do not; None if none is judged."""
    found = quoted.count(data, SAID)
    if found is None:
        return None
    return f"Of {found[0]} statements of packages' guides {found[1]} hold where they were tested; {found[2]} do not."


def table(data: Data) -> Table | None:
    """Make the page's table: each statement's words, measurement and verdict, why it does not hold, and its source.

    ``data`` maps a table's name to the table; None if nothing was measured.
    """
    if all(data(name) is None for name in TABLES):
        return None
    return Table(
        quoted.lines(data, SAID),
        f"A power of time is met within {claims.NEAR:g}; `printed`: the guide's words, in part; `where`: the worst case, or details.",
    )


@of(cost.TABLE)
def draw(rows: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw error against gradient evaluations on two problems, a curve for each of a few methods."""
    with style.settings():
        figure, ((left, right),) = style.panels(1, 2, 3.2)
        for axes, name in ((left, "henon-heiles:box"), (right, "outer-solar-system")):
            for k, id in enumerate(SHOWN):
                part = rows[(rows["problem"] == name) & (rows["method"] == id)]
                axes.loglog(part["evaluations"], part["error"], label=cost.METHODS[id], **style.curve(k))
            axes.set(xlabel="evaluations of the gradient", title=name.partition(":")[0])
            axes.grid(color="0.93", linewidth=0.5)
        left.set_ylabel("error of the state")
        style.legend_above(figure, left, 3)
        file = style.save(figure, folder, "field-says-cost.png")
    return [
        Picture(
            file,
            "error against evaluations",
            "Error of the state over the evaluations of the gradient: McAte2 beside VelocityVerlet and methods of higher order.",
        )
    ]


PAGE = Page(
    id="field-says",
    question="Does what packages' guides say of integrators hold?",
    tables=(*TABLES, claims.BROUWER, claims.RIVALS),
    setting=(
        f"Growth: a Kepler orbit of e = 0.2, {growth.ORBITS} revolutions, the power of n in the largest energy error of a "
        "revolution and in the position's error after it.",
        f"Cost: {len(cost.SCENES)} problems, errors of the state from 0.1 to 1e-10 against Gauss of order 16, "
        f"{len(cost.METHODS)} methods of OrdinaryDiffEq.jl's list that are here.",
        "Energy: the starts and times of SciMLBenchmarks.jl, KahanLi8 with h = 0.01, in compensated and in plain sums; for "
        "Vern9, DPRKN12 and their Taylor methods stand DOP853 and heyoka.",
        f"IAS15: Kepler orbits, {encounters.ORBITS} revolutions, energies in extended precision. WHFast: all its settings and "
        "SABA, energy error and time, from [Wisdom–Holman splittings](wisdom_holman.md).",
    ),
    verdicts=(claims.bounded, claims.linear, claims.than_verlet, claims.fifth, claims.short),
    answer=answer,
    figures=draw,
    table=table,
    limits=(
        "The methods run here are this suite's with the same coefficients, not Julia's programs.",
        "Statements are quoted in part; the whole text stands at the source, and may have changed since.",
        "“For most applications” has no definition: five problems and ten errors stand for them.",
    ),
    command="pytest benchmarks/experiments/field_says",
)
