"""Numbers that papers print on integrators, beside those measured here."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from phasebench.benchmarks.page import said
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Data, Picture
from phasebench.benchmarks.page.study import Claim, Curves, Study, pictures, rows_of
from phasebench.benchmarks.page.verdict import at_least, at_most

from . import brouwer, irkgl, minimum_norm, planets, timed
from .planets import ENERGY

INNER = ("mercury", "venus", "earth", "mars")
#: How the ids of methods of a kind begin -> what the kind is called; the first that fits.
KINDS = {
    "rebound-whfast-plain": "WHFast",
    "rebound-whfast-corrector": "WHFast, corrected",
    "rebound-whfast": "WHFast, modified kick",
    "rebound-saba-cm": "SABACM",
    "rebound-saba": "SABA4",
}


def beside_ours(rows: pd.DataFrame, theirs: str, ours: list[str]) -> pd.Series:
    """The rms error of an integrator at the end over the smallest of ours, by that method."""
    end = rows.set_index("integrator")["rms"].reindex([theirs, *ours])
    known = end[ours].dropna()
    return (end[theirs] / known.nsmallest(1)).dropna()


def doubt(rows: pd.DataFrame) -> pd.Series:
    """The uncertainty of each rate over the error of plain WHFast."""
    plain = rows[rows["method"] == planets.PLAIN].groupby("planet")["rate error"].first().abs()
    return rows["uncertainty"] / rows["planet"].map(plain)


def kinds(data: Data) -> pd.DataFrame | None:
    """The errors of the inner planets' perihelia, with the kind of each method."""
    rows = rows_of(data, planets.PERIHELIA, f"planet in {INNER}")
    if rows is None:
        return None
    of = [
        next((kind for first, kind in KINDS.items() if id.startswith(first)), "this suite's") for id in rows["method"]
    ]
    return rows.assign(kind=of, error=rows["rate error"].abs())


SPLITTINGS = [
    Curves(planets.EVALUATIONS, "evaluations", y, "evaluations over a century", "", title=title)
    for y, title in ((ENERGY, "relative energy error"), ("position error", "position error (AU)"))
]
RATES = [
    Curves(
        kinds, ENERGY, "error", f"relative {ENERGY}", "error of the perihelion's rate (arcsec/yr)", "kind", line="none"
    )
]


def draw(data: Data, folder: Path) -> list[Picture]:
    """The errors of splittings on eight planets over evaluations, and errors of perihelia over energy errors."""
    caption = (
        "Left: the largest relative energy error over a century. Right: the error of the positions after a decade."
    )
    file, title = "printed-numbers-planets.png", "splittings on eight planets"
    found = pictures(SPLITTINGS, data, folder, file, title, caption, 3, 3.2) or []
    caption = (
        f"A mark for each method and each of the {len(INNER)} inner planets, at h = {number(planets.STEP)} days over "
        f"{planets.YEARS} years. From right to left the energy error falls; the rates' errors do not follow it."
    )
    file, title = "printed-numbers-perihelia.png", "energy errors beside perihelia"
    return found + (pictures(RATES, data, folder, file, title, caption, 3, 3.4) or [])


FUNCTIONS = {name: f for module in (planets, minimum_norm, brouwer, timed) for name, f in vars(module).items()}
SAID = said.statements(Path(__file__).with_suffix(".toml"), FUNCTIONS | {"beside_ours": beside_ours})
OURS = "of this suite, beside them"
CONTROL = f"tolerance == {brouwer.CONTROL[1]}"
STUDY = Study(
    id="printed-numbers",
    place=90,
    question="Are the numbers that papers print on integrators confirmed here?",
    answer=said.answer(
        [one for one in SAID.values() if one.entry["source"] != OURS],
        "Of {n} printed numbers that were measured again here {hold} are confirmed; {fail} are not.",
    ),
    setting=(
        "Farrés, Rein: the Sun and eight planets from JPL's elements at J2000, Jacobi coordinates; energies over a "
        "century, positions after a decade against certified states, perihelia over "
        f"{planets.YEARS} years against ABA(10,6,4).",
        "Takaishi: ⟨ΔH²⟩^½ of trajectories over exp(−H) by Gauss's rule, V = q²/2 and q²/2 + q⁴/4, in steps that move "
        "positions first and in steps that move momenta first.",
        f"Brouwer: {brouwer.STARTS} Kepler orbits of e = 0.2, {brouwer.ORBITS} revolutions, the power of n in the rms "
        "energy error.",
        "WHFast512: the eight planets, in turns with WHFast. TRACE: the giants with "
        f"{timed.HEAVIER:g} times their masses, {timed.YEARS:g} years, h = {timed.SHARE:g} of Jupiter's period.",
        "IRKGL16 is Gauss's method of order 16 in SIMD lanes, as gauss-8 is: times over its, at equal largest relative "
        f"energy errors of {irkgl.ROWS} rows, steps sqrt(2) apart; the planets are of other initial data.",
    ),
    runs=(*planets.RUNS, minimum_norm.RUNS, brouwer.RUNS, *timed.RUNS, irkgl.RUNS),
    claims=said.claims(SAID, shown=True),
    numbers=said.claims(SAID, shown=False),
    checks={
        "averages": Claim("<exp(-Delta H)> is 1", minimum_norm.TABLE, "abs(off)", at_most(1e-3)),
        "truncation": Claim("The control's error grows linearly", brouwer.TABLE, "exponent", at_least(0.9), CONTROL),
        "round-off": Claim("Round-off grows slower", brouwer.TABLE, "exponent", at_most(0.9), "tolerance != tolerance"),
        "rates": Claim("Rates are known far better than by plain WHFast", planets.PERIHELIA, doubt, at_most(1e-2)),
        "intervals": Claim("A speed-up is in its interval", timed.VECTORS, "0 < low <= gain <= high"),
    },
    figure=draw,
    shown=said.table(
        SAID,
        f"Printed with “about” is met within a factor of {said.ABOUT:g}; “no better” means by less than 3 times.",
    ),
    limits=(
        "Of the papers the abstracts were read, of IRKGL16's figures the authors' notebooks; the other scenes are this "
        "suite's, not the papers'. Biscani and Izzo's is quoted at second hand.",
        "Evaluations of a corrector, which acts at rows only, are not counted.",
        "Secular frequencies need millions of years; rates over these years contain oscillations of the giants' "
        "perihelia.",
        "WHFast512 needs AVX512: where the processor or REBOUND's build lacks it, its row is missing.",
        f"Exponents are compared with 1/2 within their own 95 % interval; heyoka at tolerance {brouwer.CONTROL[1]:g} "
        "is the control.",
    ),
)
