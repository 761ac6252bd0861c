"""PRINTED: numbers and statements that papers print on integrators, each with a verdict from measured rows.

Each is a `Quoted`: the function that judges it, the printed words, why the measurement may differ, and the paper.
"""

from __future__ import annotations

from math import inf, nan

import numpy as np
import pandas as pd

from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import of
from phasebench.benchmarks.page.quoted import Quoted
from phasebench.benchmarks.page.verdict import Between, Range, Verdict, at_least, at_most

from . import brouwer, minimum_norm, planets, timed
from .minimum_norm import LEAPFROG, MINIMUM_NORM, MOMENTA, POSITIONS

#: A number printed with "about" is met within this factor.
ABOUT = 2.0
#: Less than this gain is "no better".
NO_BETTER = 3.0
#: The smallest energy error of doubles that is asked for, and all of them.
SMALLEST = 1e-14
ERRORS = tuple(10.0**-k for k in range(8, 15))
INNER, GIANTS = ("mercury", "venus", "earth", "mars"), timed.GIANTS
#: Steps of the minimum-norm comparison up to which the order is seen; the rms error at which steps are compared.
SMALL, EQUAL = 1 / 16, 1e-3
ENERGY = "energy error"


def _about(value: float) -> Between:
    return Between(value / ABOUT, value * ABOUT)


# -- Farres et al. 2013 -----------------------------------------------------------------------------------------------


def fewest(rows: pd.DataFrame, error: float, column: str = ENERGY) -> pd.Series:
    """Return a series: method -> the fewest gradient evaluations with which its error is at most ``error``, sorted.

    ``rows`` has a row for each method and number of evaluations, with the error in ``column``; infinite if no row
    reaches the error.
    """
    met = rows[rows[column] <= error]
    found = met.groupby("method")["evaluations"].min().astype(float)
    ids = dict.fromkeys([*rows["method"], planets.BEST])
    return found.reindex(list(ids), fill_value=inf).sort_values(kind="stable")


def _lead(rows: pd.DataFrame, error: float, column: str) -> tuple[float, str]:
    """Compare the splitting ABA(10,6,4) with the cheapest other method at an error: (ratio, the other's id).

    The ratio is the fewest evaluations of the other method over those of ABA(10,6,4): infinite if only ABA(10,6,4)
    reaches ``error``, 0 if only the other does.  (NaN, "") if no method reaches it, or there is no other.  ``column``
    is the column of the error in ``rows``, which has a row for each method and number of evaluations.
    """
    found = fewest(rows, error, column)
    others = found.drop(planets.BEST)
    if others.empty or others.iloc[0] == found[planets.BEST] == inf:
        return nan, ""
    return float(others.iloc[0] / found[planets.BEST]), str(others.index[0])


@of(planets.EVALUATIONS)
def preference(rows: pd.DataFrame) -> Verdict | None:
    """Whether the splitting ABA(10,6,4) needs the fewest evaluations on eight planets at the smallest energy error.

    ``rows`` has a row for each splitting and step; None if ABA(10,6,4) does not reach this error, or is the only one.
    """
    if not fewest(rows, SMALLEST)[planets.BEST] < inf:
        return None
    lead, other = _lead(rows, SMALLEST, ENERGY)
    if lead != lead:
        return None
    return Verdict(
        "On eight planets ABA(10,6,4) needs the fewest evaluations at the smallest energy error",
        lead if lead < inf else 1e3,
        at_least(1.0),
        "times fewer",
        where=f"to {SMALLEST:g}; next {other}" if lead < inf else f"to {SMALLEST:g}; no other reaches it",
    )


@of(planets.EVALUATIONS)
def everywhere(rows: pd.DataFrame) -> Verdict | None:
    """Whether the splitting ABA(10,6,4) needs the fewest evaluations on eight planets at larger energy errors.

    The errors are those of `ERRORS` but the smallest, which `preference` judges.  ``rows`` has a row for each splitting
    and step; None if no other splitting reaches any of these errors.
    """
    leads = {e: lead for e in ERRORS[:-1] if (lead := _lead(rows, e, ENERGY))[0] < inf}
    if not leads:
        return None
    worst = min(leads, key=lambda e: leads[e][0])
    known = [lead for lead, _ in leads.values()]
    return Verdict(
        "On eight planets ABA(10,6,4) needs the fewest evaluations at every larger energy error",
        Range(min(known), max(known)),
        at_least(1.0),
        "times fewer",
        where=f"to {worst:g}: {leads[worst][1]}",
    )


@of(planets.EVALUATIONS)
def by_state(rows: pd.DataFrame) -> Verdict | None:
    """Whether the splitting ABA(10,6,4) needs the fewest evaluations to a given error of the planets' positions.

    The positions are those after a decade; None if no other method reaches the error.
    """
    error = 1e-8
    lead, other = _lead(rows, error, "position error")
    if not lead < inf:
        return None
    return Verdict(
        "ABA(10,6,4) needs the fewest evaluations for the planets' places after a decade",
        lead,
        at_least(1.0),
        "times fewer",
        where=f"to {error:g} AU: {other}",
    )


# -- Rein, Brown & Tamayo 2019 ----------------------------------------------------------------------------------------


def gains(rows: pd.DataFrame, one: str, other: str, names: tuple[str, ...]) -> pd.Series:
    """Return the errors of perihelion rates with the integrator ``one`` over those with ``other``: a series by planet.

    ``rows`` is the table of perihelia, ``names`` are the planets.  Ratios are absolute values; the series is empty if
    one of the integrators has no rows.
    """
    at = rows[rows["planet"].isin(names)].pivot_table(index="planet", columns="method", values="rate error", sort=False)
    if one not in at or other not in at:
        return pd.Series(dtype=float)
    return (at[one] / at[other]).abs()


@of(planets.PERIHELIA)
def energies(rows: pd.DataFrame) -> Verdict | None:
    """Whether WHFast's symplectic corrector of order 17 makes its energy error about a thousand times smaller.

    ``rows`` is the table of perihelia; None if it lacks WHFast without or with the corrector.
    """
    found = rows.groupby("method")[ENERGY].first()
    if not {planets.PLAIN, planets.CORRECTED} <= set(found.index):
        return None
    return Verdict(
        "Symplectic correctors make the energy error a thousand times smaller",
        float(found[planets.PLAIN] / found[planets.CORRECTED]),
        _about(1000.0),
        "times",
        where=f"h = {number(planets.STEP)} days",
    )


def _rates(rows: pd.DataFrame, names: tuple[str, ...]) -> dict | None:
    """Return the arguments of a `Verdict` on the claim that WHFast's symplectic corrector improves no perihelion rate.

    Measured is, for each of the planets ``names``, the error of the rate without the corrector over that with it.
    ``rows`` is the table of perihelia; None if it lacks WHFast without or with the corrector.
    """
    found = gains(rows, planets.PLAIN, planets.CORRECTED, names)
    if found.empty:
        return None
    measured = Range(found.min(), found.max())
    return {"measured": measured, "expected": at_most(NO_BETTER), "unit": "times smaller", "where": str(found.idxmax())}


@of(planets.PERIHELIA)
def inner(rows: pd.DataFrame) -> Verdict | None:
    """Whether WHFast's symplectic corrector makes the perihelion rate of no inner planet more accurate.

    ``rows`` is the table of perihelia; None if it lacks WHFast without or with the corrector.
    """
    found = _rates(rows, INNER)
    return found and Verdict("Symplectic correctors make no inner planet's perihelion rate better", **found)


@of(planets.PERIHELIA)
def giants(rows: pd.DataFrame) -> Verdict | None:
    """Whether WHFast's symplectic corrector makes the perihelion rate of no giant planet more accurate.

    ``rows`` is the table of perihelia; None if it lacks WHFast without or with the corrector.
    """
    found = _rates(rows, GIANTS)
    return found and Verdict("Symplectic correctors make no giant planet's perihelion rate better", **found)


@of(planets.PERIHELIA)
def same_energy(rows: pd.DataFrame) -> Verdict | None:
    """Whether SABAC2 has more accurate perihelion rates than WHFast with its symplectic corrector.

    SABAC2's energy error is like that of WHFast with the corrector; the rates are those of the inner planets.  ``rows``
    is the table of perihelia; None if one of the two integrators is missing.
    """
    found = gains(rows, planets.CORRECTED, "rebound-saba-cm-2", INNER)
    if found.empty:
        return None
    return Verdict(
        "SABAC2, with the corrected method's energy error, has better perihelion rates",
        Range(found.min(), found.max()),
        at_least(NO_BETTER),
        "times smaller",
        where=str(found.idxmin()),
    )


# -- Takaishi & de Forcrand 2006 --------------------------------------------------------------------------------------


def _curve(rows: pd.DataFrame, name: str, id: str, first: str, length: float) -> pd.DataFrame:
    chosen = (rows["potential"] == name) & (rows["method"] == id) & (rows["first"] == first)
    return rows[chosen & (rows["length"] == length)].sort_values("h")


def ratios(rows: pd.DataFrame, name: str) -> list[float]:
    """List the ratios of leapfrog's rms energy error to that of the minimum-norm splitting at the same step.

    There is a ratio for each combination of a step up to `SMALL`, a length of the trajectory and the variable
    (positions or momenta) that a step moves first.  ``rows`` is the table of `minimum_norm`, ``name`` the potential.
    """
    out: list[float] = []
    for first in (POSITIONS, MOMENTA):
        for length in minimum_norm.LENGTHS:
            a, b = (_curve(rows, name, id, first, length).set_index("h")["rms"] for id in (LEAPFROG, MINIMUM_NORM))
            found = (a / b).dropna()
            out += list(found[found.index <= SMALL])
    return out


def _step_at(curve: pd.DataFrame) -> float:
    """Return the step h at which the rms energy error of a curve is `EQUAL`; NaN if no step of the curve is near it.

    ``curve`` has a row for each step.  Between two rows the error is taken to be a power of h.
    """
    rms, h = np.log(curve[["rms", "h"]].to_numpy(float)).T
    return float(np.exp(np.interp(np.log(EQUAL), rms, h, left=np.nan, right=np.nan)))


def longer(rows: pd.DataFrame, name: str) -> list[float]:
    """List the ratios of the minimum-norm splitting's step to leapfrog's, where each has the rms energy error `EQUAL`.

    There is a ratio for each combination of a length of the trajectory and the variable (positions or momenta) that a
    step moves first.  ``rows`` is the table of `minimum_norm`, ``name`` the potential.
    """
    out: list[float] = []
    for first in (POSITIONS, MOMENTA):
        for length in minimum_norm.LENGTHS:
            curves = [_curve(rows, name, id, first, length) for id in (LEAPFROG, MINIMUM_NORM)]
            if not any(curve.empty for curve in curves):
                one, other = map(_step_at, curves)
                out.append(other / one)
    return [x for x in out if x == x]


def _smaller(rows: pd.DataFrame, name: str) -> dict | None:
    """Return the arguments of a `Verdict` on the claim that the minimum-norm splitting has a tenth of leapfrog's error.

    Measured are the `ratios` of the rms errors.  ``name`` is the potential; None if ``rows`` has no rows of it.
    """
    found = ratios(rows, name)
    return {"measured": Range(min(found), max(found)), "expected": _about(10.0), "unit": "times"} if found else None


@of(minimum_norm.TABLE)
def anharmonic(rows: pd.DataFrame) -> Verdict | None:
    """Whether the minimum-norm splitting's energy error is about a tenth of leapfrog's on an anharmonic oscillator.

    ``rows`` is the table of `minimum_norm`; None if it has no rows of this oscillator.
    """
    found = _smaller(rows, "anharmonic")
    return found and Verdict("The minimum-norm splitting's energy error is about a tenth of leapfrog's", **found)


@of(minimum_norm.TABLE)
def gaussian(rows: pd.DataFrame) -> Verdict | None:
    """Whether the minimum-norm splitting's energy error is about a tenth of leapfrog's on the harmonic oscillator.

    ``rows`` is the table of `minimum_norm`; None if it has no rows of this oscillator.
    """
    found = _smaller(rows, "oscillator")
    return found and Verdict(
        "On a Gaussian the minimum-norm splitting's energy error is about a tenth of leapfrog's", **found
    )


@of(minimum_norm.TABLE)
def step(rows: pd.DataFrame) -> Verdict | None:
    """Whether the minimum-norm splitting's step is about three times as long as leapfrog's at equal energy error.

    Both are run on the anharmonic oscillator.  ``rows`` is the table of `minimum_norm`; None if no steps of equal error
    are found in it.
    """
    found = longer(rows, "anharmonic")
    if not found:
        return None
    return Verdict(
        "The minimum-norm splitting's step can be about three times as long",
        Range(min(found), max(found)),
        _about(3.0),
        "times",
    )


@of(minimum_norm.TABLE)
def efficiency(rows: pd.DataFrame) -> Verdict | None:
    """Whether the minimum-norm splitting goes some 50 % farther than leapfrog per force evaluation at equal error.

    Both are run on the anharmonic oscillator.  ``rows`` is the table of `minimum_norm`; None if no steps of equal error
    are found in it.
    """
    found = [100 * (x / minimum_norm.FORCES[MINIMUM_NORM] - 1) for x in longer(rows, "anharmonic")]
    if not found:
        return None
    return Verdict(
        "The minimum-norm splitting is some 50 % more efficient than leapfrog",
        Range(min(found), max(found)),
        _about(50.0),
        "%",
    )


# -- Brouwer's law ----------------------------------------------------------------------------------------------------


def _law(rows: pd.DataFrame, id: str) -> dict | None:
    """Return the arguments of a `Verdict` on the claim that an integrator's energy error grows as the root of time.

    Measured is the power of time.  The claim holds if the power differs from 1/2 by no more than from the farther end
    of its own 95 % interval.  ``rows`` is the table of `brouwer`, ``id`` the integrator; None without a row of it at
    its default tolerance.
    """
    row = rows[(rows["integrator"] == id) & rows["tolerance"].isna()]
    if row.empty:
        return None
    low, a, high = (float(row.iloc[0][c]) for c in ("low", "exponent", "high"))
    spread = max(high - a, a - low)
    where = f"{number(low)} to {number(high)} (95 %); mean over rms {number(row.iloc[0]['bias'])}"
    return {"measured": a, "expected": Between(0.5 - spread, 0.5 + spread), "where": where}


@of(brouwer.TABLE)
def ias15(rows: pd.DataFrame) -> Verdict | None:
    """Whether IAS15's energy error grows as the square root of time.

    ``rows`` is the table of `brouwer`; None if it has no row of this integrator.
    """
    found = _law(rows, "rebound-ias15")
    return found and Verdict("IAS15's energy error grows as the square root of time", **found)


@of(brouwer.TABLE)
def heyoka(rows: pd.DataFrame) -> Verdict | None:
    """Whether heyoka's energy error grows as the square root of time.

    ``rows`` is the table of `brouwer`; None if it has no row of this integrator.
    """
    found = _law(rows, "heyoka")
    return found and Verdict("heyoka's energy error grows as the square root of time", **found)


@of(brouwer.TABLE)
def whfast(rows: pd.DataFrame) -> Verdict | None:
    """Whether WHFast's energy error grows as the square root of time.

    ``rows`` is the table of `brouwer`; None if it has no row of this integrator.
    """
    found = _law(rows, "rebound-whfast-plain")
    return found and Verdict("WHFast's energy error grows as the square root of time", **found)


@of(brouwer.TABLE)
def gauss(rows: pd.DataFrame) -> Verdict | None:
    """Whether the energy error of this suite's Gauss method of order 16 grows as the square root of time.

    ``rows`` is the table of `brouwer`; None if it has no row of this method.
    """
    found = _law(rows, "gauss-8")
    return found and Verdict("The energy error of Gauss of order 16 grows as the square root of time", **found)


@of(brouwer.TABLE)
def splitting(rows: pd.DataFrame) -> Verdict | None:
    """Whether the energy error of this suite's Wisdom-Holman splitting grows as the square root of time.

    ``rows`` is the table of `brouwer`; None if it has no row of this method.
    """
    found = _law(rows, "wisdom-holman")
    return found and Verdict(
        "This suite's Wisdom–Holman has an energy error growing as the square root of time", **found
    )


@of(brouwer.TABLE)
def smallest(rows: pd.DataFrame) -> Verdict | None:
    """Whether IAS15's rms energy error at the end is no larger than that of this suite's best method.

    ``rows`` is the table of `brouwer`, of which the runs at default tolerances count; None if IAS15 or this suite's
    methods are missing.
    """
    end = rows[rows["tolerance"].isna()].set_index("integrator")["rms"]
    ours = end[end.index.isin(("gauss-8", "wisdom-holman"))]
    if "rebound-ias15" not in end or ours.empty:
        return None
    return Verdict(
        "IAS15's energy error at the end is the smallest",
        float(end["rebound-ias15"] / ours.min()),
        at_most(1.0),
        "times the best of this suite",
        where=str(ours.idxmin()),
    )


# -- timed ------------------------------------------------------------------------------------------------------------


@of(timed.VECTORS)
def vectors(rows: pd.DataFrame) -> Verdict:
    """Whether WHFast512 (eight planets in a vector register) is up to 4.7 times as fast as WHFast."""
    where = rows.loc[rows["gain"].idxmin()]
    return Verdict(
        "WHFast512 is up to 4.7 times as fast as WHFast",
        float(rows["gain"].max()),
        _about(4.7),
        "times",
        where=f"least {number(rows['gain'].min())} ({where['corrector']}, h = {number(where['h'])})",
    )


def _against(rows: pd.DataFrame, id: str, printed: float) -> dict | None:
    """Return the arguments of a `Verdict` on the claim that TRACE is ``printed`` times as fast as another integrator.

    ``rows`` is the table of close encounters, ``id`` the other integrator; None if one of the two is not in the table.
    """
    row = rows[rows["integrator"] == id]
    if row.empty or timed.TRACE not in set(rows["integrator"]):
        return None
    found, ours = row.iloc[0], rows[rows["integrator"] == timed.TRACE].iloc[0]
    where = f"energy error {number(found[ENERGY])}, TRACE's {number(ours[ENERGY])}"
    return {"measured": float(found["times TRACE"]), "expected": _about(printed), "unit": "times", "where": where}


@of(timed.ENCOUNTERS)
def mercurius(rows: pd.DataFrame) -> Verdict | None:
    """Whether TRACE is 12 times as fast as MERCURIUS in close encounters.

    ``rows`` is the table of close encounters; None if one of the two integrators is missing.
    """
    found = _against(rows, timed.RIVALS[0], 12.0)
    return found and Verdict("TRACE is 12 times as fast as MERCURIUS in close encounters", **found)


@of(timed.ENCOUNTERS)
def trace(rows: pd.DataFrame) -> Verdict | None:
    """Whether TRACE is 15 times as fast as IAS15 in violent scattering.

    ``rows`` is the table of close encounters; None if one of the two integrators is missing.
    """
    found = _against(rows, timed.RIVALS[1], 15.0)
    return found and Verdict("TRACE is 15 times as fast as IAS15 in violent scattering", **found)


# -- all of them ------------------------------------------------------------------------------------------------------


OURS = "of this suite, beside them"
FARRES = "Farrés et al. 2013, abstract (1208.0716)"
REIN = "Rein, Brown & Tamayo 2019, abstract (1908.03468)"
TAKAISHI = "Takaishi & de Forcrand 2006, abstract (hep-lat/0505020)"
LU = "Lu, Hernandez & Rein 2024, abstract (MNRAS 533, 3708)"
PRINTED = (
    Quoted(preference, "(10,6,4) preferred", "", FARRES),
    Quoted(everywhere, "(10,6,4) preferred", "they ask for round-off; above it fewer stages do", FARRES),
    Quoted(by_state, "(10,6,4) preferred", "they judge by the energy; ε²h² needs longer than a decade", FARRES),
    Quoted(energies, "three orders of magnitude", "depends on h: the corrected error falls faster", REIN),
    Quoted(inner, "no better", "ε²h² turns the perihelion; a corrector removes εh² alone", REIN),
    Quoted(giants, "no better", "here the start, off by εh², decides: SABAC1, without ε²h², errs alike", REIN),
    Quoted(same_energy, "higher order is better", "SABAC2 has no term ε²h²", REIN),
    Quoted(anharmonic, "about 10", "theirs is lattice QCD, ours one oscillator", TAKAISHI),
    Quoted(gaussian, "about 10", "linear forces see one combination of both error terms", TAKAISHI),
    Quoted(step, "about 3", "the square root of the errors' ratio", TAKAISHI),
    Quoted(efficiency, "about 50 %", "theirs is lattice QCD, ours one oscillator", TAKAISHI),
    Quoted(ias15, "t^1/2, 10⁹ orbits", "one planet, fewer orbits", "Rein & Spiegel 2015, abstract (1409.4779)"),
    Quoted(heyoka, "t^1/2", "one planet, fewer orbits", "Biscani & Izzo 2021; quoted at second hand"),
    Quoted(whfast, "t^1/2 for small steps", "one planet", "Rein & Tamayo 2015, abstract (1506.01084)"),
    Quoted(gauss, "t^1/2", "", OURS),
    Quoted(splitting, "t^1/2", "its round-off has a mean at this step", OURS),
    Quoted(
        smallest, "accurate to round-off", "IAS15's sums are compensated, as ours are", "Rein & Spiegel 2015, title"
    ),
    Quoted(
        vectors, "up to 4.7", "another processor and version", "Javaheri, Rein & Tamayo 2023, abstract (2307.05683)"
    ),
    Quoted(mercurius, "12 (13 in the preprint)", "another scene: giants with heavier masses", LU),
    Quoted(trace, "15 (20 in the preprint)", "another scene: four planets, few encounters", LU),
)
