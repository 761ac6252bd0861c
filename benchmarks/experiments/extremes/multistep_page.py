"""The report page on symmetric multistep methods: at which steps Kepler's orbit is lost, and whether theory agrees."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.experiments.extremes import multistep
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import Data, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, Count, Verdict
from phasebench.integrators.coefficients.multistep import QUINLAN_TREMAINE, stable_intervals

if TYPE_CHECKING:
    from pathlib import Path

#: An orbit is lost where the energy error is so many times as large as at first, or as large as the energy.
LOST, WHOLE = 1e3, 0.1
#: Theory decides where errors grow by exp(SURE) or more, or by less than exp(QUIET), over a run.
SURE, QUIET = 30.0, 1.0
#: Theory is about the exact orbit: it is asked where the energy error is below this at first.
SMALL = 1e-4
#: A resonance: an error that has grown by this factor, and by less than `LOST`.
GROWN = 30.0
#: Smaller errors are round-off; smaller factors are drawn at 1.
NOISE = 1e-11


def _factor(rows: pd.DataFrame) -> pd.Series:
    """Compute by which factor the energy error has grown in each run.

    It is infinite if the error is as large as the energy or not finite.
    """
    factor = rows["largest"] / rows["first"].clip(lower=NOISE)
    return factor.where(np.isfinite(rows["largest"]) & (rows["largest"] < WHOLE), np.inf)


def lost(rows: pd.DataFrame) -> pd.Series:
    """True for each run that lost its orbit: its energy error grew by a factor `LOST` or to the size of the energy."""
    return _factor(rows) >= LOST


def decided(rows: pd.DataFrame) -> pd.Series:
    """True for each run whose outcome the linear theory decides: errors surely grow, or surely do not.

    Runs on an ellipse must also begin near the exact orbit, for which the theory is made.
    """
    grown = rows["rate"] * multistep.ORBITS
    return ((grown >= SURE) | (grown < QUIET)) & ((rows["e"] == 0) | (rows["first"] < SMALL))


def undecided(rows: pd.DataFrame) -> str:
    """Write a sentence on the runs that are not judged, since they are far from the exact orbit from the start.

    It says for how many of them the linear theory of parasitic growth would predict the wrong outcome, and names their
    methods; it is empty if there are none.
    """
    far = (rows["e"] > 0) & ~(rows["first"] < SMALL)
    grown = rows["rate"] * multistep.ORBITS
    sure = rows[far & ((grown >= SURE) | (grown < QUIET))]
    wrong = sure[lost(sure) != (sure["rate"] * multistep.ORBITS >= SURE)]
    if wrong.empty:
        return ""
    names = (f"{id} up to {own['N'].max():g} steps an orbit" for id, own in wrong.groupby("method", sort=False))
    return (
        f" Of {len(sure)} steps whose energy error exceeds {SMALL:g} at first, where theory is not asked, it would be wrong at "
        f"{len(wrong)}: {join_list(list(names), 4)}."
    )


def _agreement(rows: pd.DataFrame) -> dict[str, Any] | None:
    """Make the arguments of a verdict that orbits are lost where theory says so; None if theory decides no run."""
    sure = rows[decided(rows)]
    if sure.empty:
        return None
    right = lost(sure) == (sure["rate"] * multistep.ORBITS >= SURE)
    wrong = [f"{r.method} at {r.N:g} steps an orbit" for r in sure[~right].itertuples()]
    count = Count(int(right.sum()), len(sure))
    return {"measured": count, "expected": EVERY, "unit": "step sizes", "where": join_list(wrong, 3) if wrong else ""}


@of("extremes_multistep")
def circle(table: pd.DataFrame) -> Verdict | None:
    """Judge whether circular orbits are lost at the steps at which the closed-form linear theory is unstable."""
    found = _agreement(table[table["e"] == 0])
    return found and Verdict("A circular orbit is lost at the steps at which its linear theory is unstable", **found)


@of("extremes_multistep")
def ellipse(table: pd.DataFrame) -> Verdict | None:
    """Judge whether eccentric orbits are lost at the steps at which a Floquet multiplier exceeds 1."""
    found = _agreement(table[table["e"] > 0])
    return found and Verdict(
        "An eccentric orbit is lost at the steps at which a Floquet multiplier exceeds one", **found
    )


def farthest(table: pd.DataFrame) -> pd.Series:
    """Find the largest number of steps per revolution with which a run failed, by (e, order); 0 if none failed."""
    return table["N"].where(lost(table), 0.0).groupby([table["e"], table["order"]]).max()


@of("extremes_multistep")
def by_order(table: pd.DataFrame) -> Verdict | None:
    """Judge whether instabilities reach smaller steps for methods of higher order, by pairs of successive orders."""
    pairs = [(e, a, b) for e, of_e in farthest(table).groupby(level=0) for a, b in pairwise(of_e[e].items())]
    if not pairs:
        return None
    others = [f"e = {e:g}: order {b[0]} to {b[1]:g}, {a[0]} to {a[1]:g}" for e, a, b in pairs if not b[1] > a[1]]
    return Verdict(
        "Instabilities reach smaller steps, the higher the order",
        Count(len(pairs) - len(others), len(pairs)),
        EVERY,
        "pairs of orders",
        "; ".join(others[:2]),
    )


@of("extremes_multistep")
def by_frequencies(table: pd.DataFrame) -> Verdict | None:
    """Judge whether an eccentric orbit, which has more frequencies, has more unstable steps than a circular one."""
    count = lost(table).groupby([table["method"], table["e"]]).sum().unstack()
    if count.shape[1] < 2:
        return None
    more = count.iloc[:, -1] > count.iloc[:, 0]
    least = (count.iloc[:, -1] / count.iloc[:, 0].clip(lower=1)).idxmin()
    where = f"{least}: {int(count.iloc[:, 0][least])} on the circle, {int(count.iloc[:, -1][least])} on the ellipse"
    return Verdict(
        "An eccentric orbit has more unstable steps than a circular one",
        Count(int(more.sum()), len(more)),
        EVERY,
        "methods",
        where,
    )


@of("extremes_multistep_drift")
def bounded(table: pd.DataFrame) -> Verdict | None:
    """Judge whether energy and parasitic oscillations stay bounded at a number of steps an orbit without resonance.

    ``table`` has a row for each long run.  The drift of the control, which is not symmetric, is not judged but told in
    the verdict.  None if no symmetric method was run.
    """
    own = table[(table["method"] != multistep.CONTROL) & (table["N"] == multistep.OFF)]
    if own.empty:
        return None
    kept = [*((own["low"] <= 0) & (own["high"] >= 0)), *((own["growth low"] <= 0) & (own["growth high"] >= 0))]
    control = table[table["method"] == multistep.CONTROL]
    where = f"{multistep.CONTROL}, the control: {number(control['slope'].iloc[0], 2)} an orbit" if len(control) else ""
    return Verdict(
        "Off the resonances neither the energy nor a parasitic part grows",
        Count(sum(kept), len(kept)),
        EVERY,
        "intervals",
        where,
    )


def answer(data: Data) -> str | None:
    """Write the page's answer: how often linear theory foretells whether an orbit is lost.

    It also tells how many of the measured rates of growth, on long runs off the resonances, may be zero.
    """
    rows, kept = [v for v in (circle(data), ellipse(data)) if v], bounded(data)
    if not rows or kept is None:
        return None
    right, all_ = (sum(getattr(v.measured, name) for v in rows) for name in ("n", "of"))
    return (
        f"Symmetric multistep methods lose Kepler's orbit at oscillator-stable steps: linear theory about the orbit foretells {right} of "
        f"{all_} outcomes; off resonance {kept.measured.n} of {kept.measured.of} growth intervals hold zero."
    )


# -- the table and the figure ------------------------------------------------------------------------------------------


def spans(N: np.ndarray) -> str:
    """Format numbers N of steps an orbit as text, neighbours (`multistep.APART` apart) as ranges: "59.5 to 60, 90"."""
    parts: list[list[float]] = []
    for x in map(float, N):
        if parts and x - parts[-1][1] <= multistep.APART * 1.01:
            parts[-1][1] = x
        else:
            parts.append([x, x])
    return ", ".join(f"{a:g}" if a == b else f"{a:g} to {b:g}" for a, b in parts)


@of("extremes_multistep")
def table(rows: pd.DataFrame) -> Table:
    """Make the page's table: the steps an orbit at which each method loses the orbit, or its error grows."""
    out = []
    for (method, e), own in rows.groupby(["method", "e"], sort=False):
        limit = 2 * np.pi / stable_intervals(QUINLAN_TREMAINE[int(own["order"].iloc[0])])[0][1]
        gone, factor = lost(own), _factor(own)
        row = {"method": method, "e": e, "limit on the oscillator": f"{limit:.2f}", "lost at": spans(own["N"][gone])}
        slow = own["N"][~gone & (factor >= GROWN) & (own["largest"] > NOISE)]
        row["errors grow at"] = ", ".join(f"{x:g}" for x in slow[:12]) + (
            f" and {len(slow) - 12} more" if len(slow) > 12 else ""
        )
        out.append(row)
    caption = (
        f"Steps an orbit, {multistep.APART:g} apart up to {multistep.LAST:g}, at which {multistep.ORBITS} orbits are lost (the energy "
        f"error grows {LOST:g}-fold or to {WHOLE:g}), or their error grows more than {GROWN:g}-fold: resonances."
    )
    return Table(pd.DataFrame(out), caption + undecided(rows))


@of("extremes_multistep")
def full_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Select the runs that lost an orbit, or should lose it by theory."""
    return rows[lost(rows) | (rows["rate"] * multistep.ORBITS >= SURE)]


@of("extremes_multistep")
def figures(rows: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the growth of the energy error over the steps an orbit, as a list of one picture."""
    return [draw(rows, folder)]


@style.styled
def draw(rows: pd.DataFrame, folder: Path) -> Picture:
    """Draw for each method the factor by which the energy error grows, over the number of steps an orbit."""
    methods = list(dict.fromkeys(rows["method"]))
    figure, panels = style.panels(2, -(-len(methods) // 2), 4.9)
    for axes, id in zip(panels.flat, methods, strict=False):
        for e, colour in zip(multistep.ECCENTRICITIES, (style.ORANGE, style.BLUE), strict=True):
            own = rows[(rows["method"] == id) & (rows["e"] == e)]
            axes.semilogy(own["N"], _factor(own).clip(1, 1e10), color=colour, linewidth=0.8, label=f"e = {e:g}")
            theory = own["N"][own["rate"] * multistep.ORBITS >= SURE]
            axes.plot(theory, np.full(len(theory), 0.2 if e else 0.5), "|", color=colour, markersize=5)
        axes.set(title=id, ylim=(0.1, 3e10))
    panels.flat[0].legend(loc="upper right")
    for axes in panels[-1]:
        axes.set_xlabel("steps an orbit")
    for axes in panels[:, 0]:
        axes.set_ylabel("growth of the energy error")
    caption = (
        f"Kepler, {multistep.ORBITS} orbits: the factor by which the largest energy error exceeds that at first; below, where the "
        "linear theory about the orbit is unstable."
    )
    return Picture(style.save(figure, folder, "extremes-multistep.png"), "unstable steps on Kepler's orbit", caption)


PAGE = Page(
    id="extremes-multistep",
    question="At which steps do symmetric multistep methods fail on Kepler's orbit?",
    tables=multistep.TABLES,
    setting=(
        "Kepler, H = |p|² / 2 − 1 / |q|, semi-major axis 1; quinlan-tremaine-8 to -14, started by Gauss, with N steps an orbit "
        "from the stability limit on the oscillator on.",
        "Theory, e = 0: roots of ρ₊ρ₋ − (9/4) K² σ₊σ₋ with ρ± = ρ(e^(±iφ) z) − (K/2) σ(e^(±iφ) z), φ = 2π / N, K = −ρ(e^(iφ)) / σ(e^(iφ)). "
        "e > 0: eigenvalues of the linearized steps of two orbits, multiplied.",
        "The claims on orders and frequencies are those of the abstract of G. D. Quinlan, arXiv:astro-ph/9901136 (1999).",
        f"Growth: {multistep.LONG} orbits with {multistep.OFF:g} steps each, e = {multistep.ECCENTRIC:g}; parasitic parts are differences of order "
        f"{multistep.DIFFERENCE} of q in {multistep.WINDOWS} windows; drifts with intervals as on [the page of drifts](drift.md).",
        f"Control: {multistep.CONTROL}, Stormer's method, not symmetric, by the same kernel.",
    ),
    verdicts=(circle, ellipse, by_order, by_frequencies, bounded),
    answer=answer,
    figures=figures,
    table=table,
    whole=full_table,
    limits=(
        "Nothing is judged where theory has errors grow, but hardly in so many orbits; nor, as the theory is about the exact "
        f"orbit, on an ellipse whose energy error exceeds {SMALL:g} in the first orbits.",
        "Resonances, where an orbit is a whole number of parasitic periods, let errors grow like the time: longer runs show more of them.",
        "Only the abstract of Quinlan's paper was at hand: the steps an orbit that its text prints are not compared.",
        "Grid points that are no multiples of the spacing are not tried: a narrower unstable interval between two of them is not seen.",
    ),
    command="pytest benchmarks/experiments/extremes",
    listed=False,
)
