"""The report page on splittings of H into many parts, around black holes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Data, Page, Picture, Table, of
from phasebench.benchmarks.page.shared import case, declared_orders, growth
from phasebench.benchmarks.page.verdict import FAIL, Verdict, at_least, at_most

from .measure import ACCURACY, ENERGY, PROBLEMS, SPAN, H

#: The spread of a bounded energy over all steps is at most this many times that over a tenth; one that grows, `GROWS`.
BOUNDED, GROWS = 2.0, 5.0
#: An order is what is declared if it is as near as this.
NEAR = 0.3
#: "Several orders of magnitude" is at least two.
ORDERS = 100.0


@of(ENERGY)
def bounded(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether the energy of explicit splittings into parts stays bounded.

    The spread over all steps may be at most `BOUNDED` times that over the first tenth.  ``rows`` is the table of long
    runs; None if it has no splitting.
    """
    own = rows[rows["split"].astype(bool)]
    if own.empty:
        return None
    times = growth(own)
    return Verdict(
        "The energy of explicit splittings through parts stays bounded",
        float(times.max()),
        at_most(BOUNDED),
        "times the spread over the first tenth",
        where=case(own.loc[times.idxmax()]),
    )


@of(ENERGY)
def grows(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether the energy of the fourth-order Runge-Kutta method, the control, grows.

    ``rows`` is the table of long runs; None if it has none of this method.
    """
    explicit = rows[rows["method"] == "rk4"]
    if explicit.empty:
        return None
    times = growth(explicit)
    return Verdict(
        "The energy of the fourth-order Runge-Kutta method grows",
        float(times.min()),
        at_least(GROWS),
        "times the spread over the first tenth",
        where=case(explicit.loc[times.idxmin()]),
        otherwise=FAIL,
    )


@of(ACCURACY)
def orders(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether splittings into parts have their declared orders.

    ``rows`` is the table of errors.
    """
    return declared_orders(
        rows[rows["split"].astype(bool)], "Splittings through parts converge with the declared order", NEAR
    )


def _ratios(rows: pd.DataFrame, worse: str, better: str) -> pd.Series:
    """Divide the errors of the method ``worse`` by those of ``better`` at the least step: a series by problem.

    ``rows`` is the table of errors; the series is empty if it lacks one of the two methods.
    """
    least = rows[np.isclose(rows["h"], rows["h"].min())]
    errors = least.pivot_table(index="problem", columns="method", values="error")
    return (errors[worse] / errors[better]).dropna() if {worse, better} <= set(errors) else pd.Series(dtype=float)


@of(ACCURACY)
def optimized(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether an optimized composition of order 4 is, as is claimed, `ORDERS` times better than Yoshida's.

    Their errors are compared at the least step; ``rows`` is the table of errors, None if it lacks one of the two.
    """
    ratios = _ratios(rows, "abc-yoshida-4", "abc-4")
    if ratios.empty:
        return None
    return Verdict(
        "An optimized composition is orders of magnitude better than Yoshida's at one step",
        float(ratios.min()),
        at_least(ORDERS),
        "times smaller error",
        where=str(ratios.idxmin()),
    )


@of(ACCURACY)
def midpoint(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether Strang's splitting is as accurate as the implicit midpoint rule at the least step.

    ``rows`` is the table of errors; None if it lacks one of the two.
    """
    ratios = _ratios(rows, "implicit-midpoint", "abc-2")
    if ratios.empty:
        return None
    return Verdict(
        "At one step Strang's splitting is as accurate as the implicit midpoint rule",
        float(ratios.min()),
        at_least(1.0),
        "times smaller error",
        where=str(ratios.idxmin()),
    )


def answer(data: Data) -> str | None:
    """Write the page's answer, a sentence: how far energies' spreads grow, and what an optimized composition gains.

    ``data`` maps a table's name to the table; None if one of the numbers was not measured.
    """
    found = [verdict(data) for verdict in (bounded, grows, optimized)]
    if None in found:
        return None
    kept, grown, gain = (v.measured for v in found)
    return (
        f"The energy's spread grows at most {number(kept)} times with splittings through parts, at least {number(grown)} with "
        f"rk4; an optimized composition is at least {number(gain)} times more accurate than Yoshida's."
    )


@of(ACCURACY)
def draw(rows: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the error of the end state against the step, a panel for each problem and a curve for each method."""
    with style.settings():
        figure, (panels,) = style.panels(1, 2, 3.4)
        for axes, name in zip(panels, PROBLEMS, strict=True):
            shown = rows[(rows["problem"] == name) & (rows["method"] != "gauss-4")]
            for k, (method, part) in enumerate(shown.groupby("method", sort=False)):
                axes.loglog(part["h"], part["error"], label=method, **style.curve(k))
            axes.set(xlabel="step h", ylabel="error of the end state", title=name)
            steps = sorted(shown["h"].unique())
            axes.set_xticks(steps, [f"{h:g}" for h in steps])
            axes.tick_params(which="minor", labelbottom=False)
            axes.grid(color="0.93", linewidth=0.5)
        style.legend_above(figure, panels[0], 4)
    caption = f"Errors at t = {SPAN:g} against the certified states."
    return [Picture(style.save(figure, folder, "parts.png"), "error against step", caption)]


@of(ACCURACY)
def table(rows: pd.DataFrame) -> Table:
    """Make the page's table: the errors, orders and evaluations of each method on each problem at the step h = 1."""
    one = rows[np.isclose(rows["h"], 1.0)]
    columns = ["problem", "method", "error", "uncertainty", "order", "evaluations"]
    caption = (
        "At h = 1: the error of the end state with the reference's uncertainty, the order from this step and twice it, and "
        "evaluations a step: flows of a part for splittings through parts, of the whole field for the others."
    )
    return Table(one[columns], caption)


@of(ACCURACY)
def _all(rows: pd.DataFrame) -> pd.DataFrame:
    return rows


PAGE = Page(
    id="parts",
    question="Around black holes, do explicit splittings of H into many parts do what papers claim?",
    tables=(ACCURACY, ENERGY),
    setting=(
        "H is a sum of parts whose exact flows are known: five for Kerr's geodesics, in a time chosen for that, and four for a "
        "charge around a Schwarzschild black hole in a magnetic field.",
        "`abc-2` is Strang's splitting, `abc-yoshida-4` three of its steps, `abc-4` and `abc-6` are optimized compositions, "
        "`abc-processed-6` is processed.",
        f"Long runs: a million steps of h = {H:g}.",
        "Claims: bounded energies, and better than implicit methods of the same order (Wang et al. 2021, Wu et al. 2021); "
        "optimized compositions several orders of magnitude better than Yoshida's (Zhou et al. 2022, arXiv:2201.02922).",
    ),
    verdicts=(bounded, grows, orders, optimized, midpoint),
    answer=answer,
    figures=draw,
    table=table,
    whole=_all,
    limits=(
        "Of the papers the abstracts were read; orbits and steps are this suite's. Their optimized methods are of the same "
        "class as `abc-4`, not shown to be the same.",
        "A flow of a part costs less than the whole field; times are in the trade.",
        "That a composition costs twice a step of Yoshida's is in the table, not in the ratio.",
    ),
    command="pytest benchmarks/experiments/parts",
)
