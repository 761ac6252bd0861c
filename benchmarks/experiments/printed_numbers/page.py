"""The report page on numbers that papers print on integrators, beside those measured here."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page import quoted
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Data, Page, Picture, Table, of

from . import brouwer, claims, minimum_norm, planets, timed
from .claims import OURS, PRINTED

TABLES = (
    planets.EVALUATIONS,
    planets.PERIHELIA,
    minimum_norm.TABLE,
    brouwer.TABLE,
    timed.VECTORS,
    timed.ENCOUNTERS,
)
GAUSS_16 = {
    "claim": "IRKGL16-SIMD beats explicit symplectic methods at high precision",
    "printed": "it can",
    "measured": "see page gauss-16",
    "outcome": "see there",
    "why they differ": "from which error on depends on the scene",
    "where": "",
    "source": "Antoñana, Makazaga & Murua 2026, abstract (2511.03655v2)",
}


def answer(data: Data) -> str | None:
    """Write the page's answer, a sentence: how many printed numbers the measurements reproduce, and how many not.

    ``data`` maps a table's name to the table; None if none can be judged.
    """
    found = quoted.count(data, (one for one in PRINTED if one.source != OURS))
    if found is None:
        return None
    return f"Of {found[0]} printed numbers that were measured again here {found[1]} are confirmed; {found[2]} are not."


def table(data: Data) -> Table | None:
    """Make the page's table, a row for each printed number: printed, measured, verdict, why they differ, source.

    ``data`` maps a table's name to the table; None if all are missing.
    """
    if all(data(name) is None for name in TABLES):
        return None
    caption = f"Printed with “about” is met within a factor of {claims.ABOUT:g}; “no better” means by less than {claims.NO_BETTER:g} times."
    return Table(pd.concat([quoted.lines(data, PRINTED), pd.DataFrame([GAUSS_16])], ignore_index=True), caption)


def draw(data: Data, folder: Path) -> list[Picture]:
    """Draw the errors of splittings on eight planets over evaluations, and errors of perihelia over energy errors.

    ``data`` maps a table's name to the table; a figure whose table is missing is left out.
    """
    return [p for p in (_splittings(data, folder), _perihelia(data, folder)) if p is not None]


@of(planets.EVALUATIONS)
def _splittings(rows: pd.DataFrame, folder: Path) -> Picture:
    with style.settings():
        figure, ((left, right),) = style.panels(1, 2, 3.2)
        for k, (name, part) in enumerate(rows.groupby("method", sort=False)):
            look = style.curve(k)
            left.loglog(part["evaluations"], part[claims.ENERGY], label=name, **look)
            right.loglog(part["evaluations"], part["position error"], label=name, **look)
        for axes, title in ((left, "relative energy error"), (right, "position error (AU)")):
            axes.set(xlabel="evaluations over a century", title=title)
            axes.grid(color="0.93", linewidth=0.5)
        style.legend_above(figure, left, 3)
        file = style.save(figure, folder, "printed-numbers-planets.png")
    return Picture(
        file,
        "splittings on eight planets",
        "Left: the largest relative energy error over a century. Right: the error of the positions after a decade.",
    )


#: How the ids of methods of a kind begin -> what the kind is called; the first that fits.
KINDS = {
    "rebound-whfast-plain": "WHFast",
    "rebound-whfast-corrector": "WHFast, corrected",
    "rebound-whfast": "WHFast, modified kick",
    "rebound-saba-cm": "SABACM",
    "rebound-saba": "SABA4",
}


def _kind(method: str) -> str:
    return next((kind for start, kind in KINDS.items() if method.startswith(start)), "this suite's")


@of(planets.PERIHELIA)
def _perihelia(rows: pd.DataFrame, folder: Path) -> Picture:
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 3.4)
        inner = rows[rows["planet"].isin(claims.INNER)]
        for k, (label, part) in enumerate(inner.groupby(inner["method"].map(_kind), sort=False)):
            look = style.curve(k) | {"linestyle": "none"}
            axes.loglog(part[claims.ENERGY], part["rate error"].abs(), label=label, **look)
        axes.set(xlabel="relative energy error", ylabel="error of the perihelion's rate (arcsec/yr)")
        axes.grid(color="0.93", linewidth=0.5)
        style.legend_above(figure, axes, 3)
        file = style.save(figure, folder, "printed-numbers-perihelia.png")
    caption = (
        f"A mark for each method and each of the {len(claims.INNER)} inner planets, at h = {number(planets.STEP)} days over "
        f"{planets.YEARS} years. From right to left the energy error falls; the rates' errors do not follow it."
    )
    return Picture(file, "energy errors beside perihelia", caption)


PAGE = Page(
    id="printed-numbers",
    question="Are the numbers that papers print on integrators confirmed here?",
    tables=TABLES,
    setting=(
        "Farrés, Rein: the Sun and eight planets from JPL's elements at J2000, Jacobi coordinates; energies over a century, "
        f"positions after a decade against certified states, perihelia over {planets.YEARS} years against ABA(10,6,4).",
        "Takaishi: ⟨ΔH²⟩^½ of trajectories over exp(−H) by Gauss's rule, V = q²/2 and q²/2 + q⁴/4, in steps that move "
        "positions first and in steps that move momenta first.",
        f"Brouwer: {brouwer.STARTS} Kepler orbits of e = 0.2, {brouwer.ORBITS} revolutions, the power of n in the rms energy error.",
        "WHFast512: the eight planets, in turns with WHFast. TRACE: the giants with "
        f"{timed.HEAVIER:g} times their masses, {timed.YEARS:g} years, h = {timed.SHARE:g} of Jupiter's period.",
    ),
    verdicts=(claims.everywhere, claims.inner, claims.gaussian, claims.ias15, claims.vectors),
    answer=answer,
    figures=draw,
    table=table,
    limits=(
        "Of the papers the abstracts were read; the scenes are this suite's, not the papers'. Biscani and Izzo's is quoted at second hand.",
        "Evaluations of a corrector, which acts at rows only, are not counted.",
        "Secular frequencies need millions of years; rates over these years contain oscillations of the giants' perihelia.",
        "WHFast512 needs AVX512: where the processor or REBOUND's build lacks it, its row is missing.",
        f"Exponents are compared with 1/2 within their own 95 % interval; heyoka at tolerance {brouwer.CONTROL[1]:g} is the control.",
    ),
    command="pytest benchmarks/experiments/printed_numbers",
)
