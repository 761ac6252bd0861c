"""The report page on methods in extended phase space: are their papers' claims of symplecticity and order true?"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.judge.evidence import NO_DEFECT
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Data, Page, Picture, Table, of
from phasebench.benchmarks.page.shared import case
from phasebench.benchmarks.page.verdict import FAIL, Between, Range, Verdict, at_most

from .measure import BOTH, DIGITS, ECCENTRICITY, EPSILON, JUMPED, OMEGA, ONE, ORDERS, SPAN, SPECIAL, STEP, STRUCTURE

#: Largest difference of an order from the declared one that counts as agreement.
GATE = 0.1
#: An order this far below that of the table shows that it is lost.
LOST = 1.0
DEFECT_ORDER = "order of the defect"


def _defect(structure: pd.DataFrame, kind: str, map_of: str) -> dict | None:
    """Make the arguments of a `Verdict` on whether steps of the methods whose id begins with ``kind`` are symplectic.

    ``structure`` is the table of defects; ``map_of`` selects the map, `BOTH` (copies) or `ONE` ((q, p) from equal
    copies).  None without such rows.
    """
    part = structure[structure["method"].str.startswith(kind) & (structure["map"] == map_of)]
    if part.empty:
        return None
    worst = part.loc[part["defect"].idxmax()]
    where = case(worst)
    return {"measured": float(worst["defect"]), "expected": at_most(NO_DEFECT), "where": where}


@of(STRUCTURE)
def tao(structure: pd.DataFrame) -> Verdict | None:
    """Judge whether Tao's step is symplectic in the extended phase space, as his paper states."""
    found = _defect(structure, "tao", BOTH)
    return found and Verdict("Tao's step of both copies is symplectic", **found, otherwise=FAIL)


@of(STRUCTURE)
def semiexplicit(structure: pd.DataFrame) -> Verdict | None:
    """Judge whether Jayawardana and Ohsawa's semiexplicit step is symplectic in the original phase space, as stated."""
    found = _defect(structure, "jayawardana-ohsawa", ONE)
    if found is None:
        return None
    return Verdict("Jayawardana and Ohsawa's step is symplectic in the original phase space", **found, otherwise=FAIL)


@of(STRUCTURE)
def midpoint(structure: pd.DataFrame) -> Verdict | None:
    """Judge whether explicit steps that end at the mean of both copies are symplectic in the original phase space."""
    found = _defect(structure, "extended-midpoint", ONE)
    return found and Verdict("An explicit step projected to the copies' midpoint is symplectic for every H", **found)


def _finest(orders: pd.DataFrame) -> pd.DataFrame:
    """Select the row of every method's smallest step."""
    return orders.loc[orders.groupby("method", sort=False)["h"].idxmin()]


@of(ORDERS)
def general(orders: pd.DataFrame) -> Verdict | None:
    """Judge whether methods for every H (separable or not) keep their order on the relativistic orbit at small steps.

    The order of each method is taken at its smallest step; ``orders`` has a row for each method and step.
    """
    rows = _finest(orders[~orders["method"].isin((SPECIAL, JUMPED))].dropna(subset="order"))
    if rows.empty:
        return None
    off = rows["order"] - rows["declared"]
    worst = rows.loc[off.abs().idxmax()]
    return Verdict(
        "Methods for every H keep their order on a relativistic orbit at small steps",
        Range(float(off.min()), float(off.max())),
        Between(-GATE, GATE),
        "from the declared order",
        where=f"{worst['method']}, h = {number(worst['h'])}",
        otherwise=FAIL,
    )


@of(ORDERS)
def special(orders: pd.DataFrame) -> Verdict | None:
    """Judge whether a splitting made for the small relativistic part loses its order where the step is small."""
    rows = _finest(orders[orders["method"] == SPECIAL])
    if rows.empty:
        return None
    row = rows.iloc[0]
    return Verdict(
        "A splitting made for post-Newtonian parts loses its order at small steps",
        float(row["order"]),
        at_most(float(row["declared"]) - LOST),
        "as the order",
        where=f"h = {number(row['h'])}",
    )


def answer(data: Data) -> str | None:
    """Write the page's answer: which of the methods' steps are symplectic, and in which phase space."""
    found = [verdict(data) for verdict in (tao, semiexplicit, midpoint)]
    if None in found:
        return None
    copies, own, explicit = (v.expected.met(v.measured) for v in found)
    text = f"Tao's step is {'' if copies else 'not '}symplectic in both copies of the state together"
    text += f", the semiexplicit one {'' if own else 'not '}in the original phase space"
    return f"{text}; the explicit projection to the midpoint is {'' if explicit else 'not '}symplectic."


@of(ORDERS)
def draw(orders: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the error on the relativistic orbit against the step, a curve for each method."""
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 3.4)
        for k, (name, part) in enumerate(orders.groupby("method", sort=False)):
            axes.loglog(part["h"], part["error"], label=name, **style.curve(k))
        axes.set(xlabel="step h", ylabel="error at the end")
        axes.grid(color="0.93", linewidth=0.5)
        style.legend_above(figure, axes, 3)
    caption = (
        f"Error of (q, p) at t = {number(float(SPAN))} after the pericentre against the step, in {DIGITS} digits. The order is the "
        f"slope: that of {SPECIAL}, made for the small part, falls to 2 at small steps."
    )
    return [Picture(style.save(figure, folder, "extended.png"), "error on a relativistic orbit", caption)]


def _maps(structure: pd.DataFrame) -> pd.DataFrame:
    """Summarize the symplecticity defects: a row for each map, with the largest defect and its orders in h."""
    rows = []
    for (name, map_of), part in structure.groupby(["method", "map"], sort=False):
        worst = part.loc[part["defect"].idxmax()]
        seen = part[DEFECT_ORDER].dropna()
        orders = f"{seen.min():.1f} to {seen.max():.1f}" if len(seen) else ""
        rows.append({"method": name, "map": map_of, "defect": worst["defect"], "on": worst["problem"], "order": orders})
    return pd.DataFrame(rows)


@of(STRUCTURE)
def table(structure: pd.DataFrame) -> Table:
    """Make the page's table: a row for each step map with its largest symplecticity defect, and its order in h."""
    caption = (
        f"Largest defect of symplecticity of a step h = {STEP} over three systems, and the order in h with which it vanishes "
        f"(blank: it is the differences' own). rk4 is the control."
    )
    return Table(_maps(structure).head(ROWS).rename(columns={"order": DEFECT_ORDER}), caption)


@of(ORDERS)
def _full_table(orders: pd.DataFrame) -> pd.DataFrame:
    columns = ["method", "declared", "h", "steps", "error", "order"]
    return orders[columns].assign(order=orders["order"].map(lambda x: "" if np.isnan(x) else f"{x:.2f}"))


PAGE = Page(
    id="extended",
    question="Are the explicit methods in extended phase space what their papers claim?",
    tables=(STRUCTURE, ORDERS),
    setting=(
        "H(q, y) + H(x, p): on two copies (q, p), (x, y) of the state, each part has an explicit flow, whatever H is.",
        "Tao 2016 binds the copies; Jayawardana and Ohsawa 2023 project symmetrically (implicit); the midpoint (q + x, p + y)/2 "
        "is the explicit projection (Luo et al. 2017).",
        "Mei, Wu and Jiang (arXiv 2504.12567) state explicit maps that are symplectic in the original phase space for every H.",
        "Liang and Mei (arXiv 2607.01596) report that post-Newtonian splittings lose their order at small steps: a Schwarzschild "
        f"orbit, ε = {EPSILON}, e = {ECCENTRICITY}, as a Kepler problem plus ε W(q, p).",
        f"All in {DIGITS} digits or more; systems (q² + 1)(p² + 1)/2, a coupled double well with p in its coupling, Hénon–Heiles.",
    ),
    verdicts=(tao, semiexplicit, midpoint, general, special),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        "Of both arXiv papers only the abstracts could be read. The explicit map is taken to be the projection to the midpoint, "
        "the special splitting to be ABA(8,6,4) with Kepler flows and a symmetric product for ε W.",
        "From equal copies the step projected to the midpoint is an explicit Runge–Kutta method. Symplecticity for every H needs "
        "b² = 0 for each of its weights b, as of any explicit partitioned Runge–Kutta method.",
        f"A defect of at most {NO_DEFECT:g} counts as none. The projected step's vanishes with h to the power 2p + 2 at order p: in "
        "double precision it is not seen at order 4.",
        "The abstract has the loss of order at h < ε³, in its own units; here ε³h², of the symmetric product, exceeds εh⁸, of the "
        "table, below h = ε^(1/3).",
        f"On the orbit Tao's ω is {OMEGA}; with his default, 20, the steps would have to be ten times shorter.",
    ),
    command="pytest benchmarks/experiments/extended",
)
