"""Statements about integrators in packages' guides, each quoted with its source and judged by measured rows.

Methods have their names in OrdinaryDiffEq.jl: McAte2 to McAte5 are McLachlan and Atela's of orders 2 to 5, KahanLi8
is Kahan and Li's of order 8, VelocityVerlet is the Stormer-Verlet method.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import product
from math import inf

import pandas as pd

from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import of
from phasebench.benchmarks.page.quoted import Quoted
from phasebench.benchmarks.page.verdict import Between, Count, Range, Verdict, at_least, at_most

from . import cost, encounters, energy, growth, orders

#: More than half.
MOST = at_least(0.501)
#: A power of time is met within this.
NEAR = 0.1
#: The errors of the state for which evaluations are compared.
ERRORS = tuple(10.0**-k for k in range(1, 11))
#: The energy errors for which times are compared.
ENERGIES = tuple(10.0**-k for k in range(4, 14))
#: The energy error of doubles that counts as machine precision.
MACHINE = 1e-14
MCATE2, VERLET = "mclachlan-atela-2", "stormer-verlet"
#: The table of another page, which has ensembles of longer runs.
BROUWER = "printed_numbers_brouwer"
#: The table of another page, with the energy errors and times of all of REBOUND's Wisdom-Holman settings.
RIVALS = "wisdom_holman_rivals"
PLANETS = "outer-solar-system"
#: WHFast with each kernel and corrector 17, by the kernel's name.
KERNELS = {
    "rebound-whfast": "lazy",
    "rebound-whfast-corrector-17": "default",
    "rebound-whfast-modifiedkick": "modified kick",
    "rebound-whfast-composition": "composition",
}
#: WHFast's correctors with the default kernel; energy errors nearer than this are equal.
CORRECTORS, EQUAL = {n: f"rebound-whfast-corrector-{n}" for n in (3, 5, 7, 11, 17)}, 1.05


# -- OrdinaryDiffEq.jl ------------------------------------------------------------------------------------------------


def _powers(rows: pd.DataFrame, column: str, symplectic: bool, power: float) -> dict:
    """Make the arguments of a `Verdict` on whether the errors of methods grow with the power ``power`` of time.

    ``rows`` is the table of `growth`, a row for each method, and ``column`` its column of fitted powers.  Only
    symplectic methods are judged if ``symplectic`` is True, only the other ones if it is False.
    """
    found = rows[rows["symplectic"] == symplectic].set_index("called")[column]
    worst = (found - power).abs().idxmax()
    expected = Between(power - NEAR, power + NEAR)
    return {"measured": Range(found.min(), found.max()), "expected": expected, "unit": "power of t", "where": worst}


@of(growth.TABLE)
def bounded(rows: pd.DataFrame) -> Verdict:
    """Whether the energy errors of symplectic methods stay bounded.

    ``rows`` is the table of `growth`, a row for each method.
    """
    return Verdict("The energy error of symplectic methods is bounded", **_powers(rows, "energy power", True, 0.0))


@of(growth.TABLE)
def linear(rows: pd.DataFrame) -> Verdict:
    """Whether the energy errors of symplectic methods drift linearly in time.

    ``rows`` is the table of `growth`, a row for each method.
    """
    return Verdict("The energy error of symplectic methods drifts linearly", **_powers(rows, "energy power", True, 1.0))


@of(growth.TABLE)
def quadratic(rows: pd.DataFrame) -> Verdict:
    """Whether the energy errors of methods that are not symplectic grow quadratically in time.

    ``rows`` is the table of `growth`, a row for each method.
    """
    return Verdict("The energy error of other methods grows quadratically", **_powers(rows, "energy power", False, 2.0))


@of(growth.TABLE)
def positions(rows: pd.DataFrame) -> Verdict:
    """Whether the position errors of symplectic methods grow linearly in time.

    ``rows`` is the table of `growth`, a row for each method.
    """
    return Verdict(
        "The position error of symplectic methods grows linearly", **_powers(rows, "position power", True, 1.0)
    )


@of(growth.TABLE)
def other_positions(rows: pd.DataFrame) -> Verdict:
    """Whether the position errors of methods that are not symplectic grow quadratically in time.

    ``rows`` is the table of `growth`, a row for each method.
    """
    return Verdict(
        "The position error of other methods grows quadratically", **_powers(rows, "position power", False, 2.0)
    )


def fewest(rows: pd.DataFrame) -> pd.DataFrame:
    """Find the fewest gradient evaluations with which each method meets an error: a row for each (problem, error).

    The columns are the methods; infinite if no run of a method meets the error.  ``rows`` is the table of `cost`, a row
    for each run.
    """
    found = {}
    for (name, id), part in rows.groupby(["problem", "method"], sort=False):
        for error in ERRORS:
            met = part[part["error"] <= error]["evaluations"]
            found[name, error, id] = float(met.min()) if len(met) else inf
    return pd.Series(found).unstack().reindex(columns=list(cost.METHODS)).fillna(inf)


@of(cost.TABLE)
def than_verlet(rows: pd.DataFrame) -> Verdict | None:
    """Whether McAte2 needs fewer gradient evaluations than VelocityVerlet for the same error.

    ``rows`` is the table of `cost`, with a row for each run; None if there is no error that both reach.
    """
    found = fewest(rows)[[VERLET, MCATE2]]
    found = found[found.max(axis=1) < inf]
    ratio = found[VERLET] / found[MCATE2]
    if ratio.empty:
        return None
    return Verdict(
        "McAte2 needs fewer evaluations than VelocityVerlet for the same error",
        Range(ratio.min(), ratio.max()),
        at_least(1.0),
        "times fewer",
        where="{} to {:g}".format(*ratio.idxmin()),
    )


@of(cost.TABLE)
def efficient(rows: pd.DataFrame) -> Verdict | None:
    """Whether McAte2 or McAte3 needs the fewest gradient evaluations of all methods in at least half of the cases.

    A case is a problem with an error that some method reaches.  ``rows`` is the table of `cost`; None without a case.
    """
    found = fewest(rows)
    found = found[found.min(axis=1) < inf]
    if found.empty:
        return None
    best = found.idxmin(axis=1)
    first = int(best.isin([MCATE2, "mclachlan-atela-3"]).sum())
    most = str(best.map(cost.METHODS).value_counts().index[0])
    return Verdict(
        "McAte2 or McAte3 needs the fewest evaluations in most applications",
        100 * first / len(best),
        at_least(50.0),
        "% of problems and errors",
        where=f"most often {most}",
    )


@of(cost.TABLE)
def loose(rows: pd.DataFrame) -> Verdict | None:
    """Whether McAte2 needs at most 1.1 times as many gradient evaluations as the best method for the same error.

    ``rows`` is the table of `cost`, with a row for each run; None if McAte2 reaches no error.
    """
    found = fewest(rows)
    ratio = (found[MCATE2] / found.min(axis=1)).replace(inf, float("nan")).dropna()
    if ratio.empty:
        return None
    return Verdict(
        "McAte2 is optimal in efficiency",
        Range(ratio.min(), ratio.max()),
        at_most(1.1),
        "times the fewest evaluations",
        where="{} to {:g}".format(*ratio.idxmax()),
    )


def _has_all(rows: pd.DataFrame, **values: Sequence) -> bool:
    """Return whether ``rows`` has a row for each combination of ``values``, a column's name -> its values."""
    return set(product(*values.values())) <= set(zip(*(rows[c] for c in values), strict=True))


def _order(rows: pd.DataFrame, id: str, T: str) -> float:
    return float(rows[(rows["method"] == id) & (rows["T"] == T)]["order"].iloc[0])


@of(orders.TABLE)
def fourth(rows: pd.DataFrame) -> Verdict | None:
    """Whether McAte4 loses its order 4 if the kinetic energy is not quadratic.

    ``rows`` is the table of `orders`, a row for each method and kinetic energy; None if the method's rows are missing.
    """
    if not _has_all(rows, method=["mclachlan-atela-4"], T=[orders.QUADRATIC, orders.OTHER]):
        return None
    there, other = (_order(rows, "mclachlan-atela-4", T) for T in (orders.QUADRATIC, orders.OTHER))
    return Verdict(
        "McAte4 loses its order where the kinetic energy is not quadratic",
        other,
        at_most(3.5),
        where=f"order {number(there)} where it is",
    )


@of(orders.TABLE)
def fifth(rows: pd.DataFrame) -> Verdict | None:
    """Whether McAte5 has order 5 also if the kinetic energy is not quadratic.

    ``rows`` is the table of `orders`, a row for each method and kinetic energy; None if the method's rows are missing.
    """
    if not _has_all(rows, method=["mclachlan-atela-5"], T=[orders.QUADRATIC, orders.OTHER]):
        return None
    there, other = (_order(rows, "mclachlan-atela-5", T) for T in (orders.QUADRATIC, orders.OTHER))
    return Verdict(
        "McAte5 is of fifth order for every kinetic energy",
        other,
        Between(4.9, 5.1),
        where=f"T = {orders.OTHER}; order {number(there)} where T is quadratic",
    )


# -- SciMLBenchmarks.jl -----------------------------------------------------------------------------------------------


def _energy(rows: pd.DataFrame, name: str, id: str) -> pd.Series:
    """Return an integrator's energy error on the problem ``name``: a series, time -> largest relative error so far."""
    return rows[(rows["problem"] == name) & (rows["integrator"] == id)].set_index("t")["energy error"]


def _over(rows: pd.DataFrame, symplectic: str, name: str) -> pd.Series:
    """Divide KahanLi8's energy error by the smallest error among the other integrators: a series, time -> ratio.

    ``rows`` is the table of `energy`, ``name`` the problem; ``symplectic`` selects the run of KahanLi8 by the kind of
    its sums, `energy.COMPENSATED` or `energy.PLAIN`.
    """
    others = [_energy(rows, name, id) for id in energy.RUNS if id not in (energy.COMPENSATED, energy.PLAIN)]
    return _energy(rows, name, symplectic) / pd.concat(others, axis=1).min(axis=1)


@of(energy.TABLE)
def short(rows: pd.DataFrame) -> Verdict | None:
    """Whether KahanLi8's energy error over a short time is larger than the other methods' smallest, on Henon-Heiles.

    ``rows`` is the table of `energy`; None if rows of an integrator are missing.
    """
    if not _has_all(rows, problem=["henon-heiles"], integrator=energy.RUNS):
        return None
    found = _over(rows, energy.COMPENSATED, "henon-heiles")
    plain = _over(rows, energy.PLAIN, "henon-heiles")
    return Verdict(
        "Over short times KahanLi8's energy error is larger than that of other accurate methods",
        float(found.iloc[0]),
        at_least(1.0),
        "times the smallest other",
        where=f"t = {found.index[0]:g}; {number(plain.iloc[0])} with plain sums",
    )


def _later(rows: pd.DataFrame, name: str) -> dict | None:
    """Make the arguments of a `Verdict` on whether KahanLi8's energy error becomes less noticeable as time grows.

    It does if the ratio of this error to the smallest error of the other integrators is no larger at the last time than
    at the first.  ``name`` is the problem; None if an integrator's rows on it are missing.
    """
    if not _has_all(rows, problem=[name], integrator=energy.RUNS):
        return None
    found = _over(rows, energy.PLAIN, name).dropna()
    ends = (f"{number(found.iloc[k])} at t = {found.index[k]:g}" for k in (0, -1))
    told = f"plain sums; {', '.join(ends)}"
    return {
        "measured": float(found.iloc[-1] / found.iloc[0]),
        "expected": at_most(1.0),
        "unit": "times",
        "where": told,
    }


@of(energy.TABLE)
def later(rows: pd.DataFrame) -> Verdict | None:
    """Whether KahanLi8's energy error is less noticeable beside other integrators' as time grows, on Henon-Heiles.

    ``rows`` is the table of `energy`; None if rows of an integrator are missing.
    """
    found = _later(rows, "henon-heiles")
    return found and Verdict("As time grows KahanLi8's energy error is less noticeable", **found)


@of(energy.TABLE)
def later_boson(rows: pd.DataFrame) -> Verdict | None:
    """Whether KahanLi8's energy error is less noticeable beside others' as time grows, on the quadrupole boson too.

    It is compared with the smallest error of the other integrators.  ``rows`` is the table of `energy`; None if rows of
    an integrator are missing.
    """
    found = _later(rows, "quadrupole-boson")
    return found and Verdict("On the quadrupole boson, too, it is less noticeable as time grows", **found)


@of(energy.TABLE)
def harder(rows: pd.DataFrame) -> Verdict | None:
    """Whether energy errors of integrators other than KahanLi8 are at least twice as large on the quadrupole boson.

    The error of each integrator at t = 1000 is compared with its own on Henon-Heiles.  ``rows`` is the table of
    `energy`; None if no such integrator was run on both problems.
    """
    ratio = {}
    for id in energy.RUNS:
        one, other = (_energy(rows, name, id).get(1e3) for name in energy.SCENES)
        if one and other and id not in (energy.COMPENSATED, energy.PLAIN):
            ratio[id] = other / one
    if not ratio:
        return None
    return Verdict(
        "On the quadrupole boson the energy errors of other methods are significantly larger",
        Range(min(ratio.values()), max(ratio.values())),
        at_least(2.0),
        "times",
        where=f"t = 1000; {min(ratio, key=lambda k: ratio[k])}",
    )


# -- REBOUND and heyoka -----------------------------------------------------------------------------------------------


@of(encounters.TABLE)
def machine(rows: pd.DataFrame) -> Verdict:
    """Whether IAS15 keeps the energy of Kepler orbits to machine precision at most eccentricities.

    ``rows`` is the table of `encounters`, a row for each eccentricity; most are more than half.
    """
    good = int((rows["energy error"] <= MACHINE).sum())
    worst = rows.loc[rows["energy error"].idxmax()]
    return Verdict(
        "In most cases IAS15 keeps the energy of Kepler orbits to machine precision",
        Count(good, len(rows)),
        MOST,
        "eccentricities",
        where=f"e = {worst['e']:g}: {number(worst['energy error'])}",
    )


@of(BROUWER)
def taylor(rows: pd.DataFrame) -> Verdict | None:
    """Whether heyoka's energy error grows with the square root of time, as a random walk of round-off does.

    None if heyoka has no row in ``rows``, the table of fitted exponents of growth.
    """
    row = rows[(rows["integrator"] == "heyoka") & rows["tolerance"].isna()]
    if row.empty:
        return None
    power, low, high, rms = (float(row[x].iloc[0]) for x in ("exponent", "low", "high", "rms"))
    wide = max(high - power, power - low)
    return Verdict(
        "heyoka's energy error stays round-off: it grows with the root of time",
        power,
        Between(0.5 - wide, 0.5 + wide),
        "power of t",
        where=f"after 10000 revolutions {number(rms)} rms",
    )


def _cheapest(rows: pd.DataFrame) -> dict[tuple[str, float], str]:
    """Return (problem, energy error) -> id of the method that reaches the error in the least time, where any does.

    ``rows`` has the energy error and the time of each run of REBOUND's integrators.
    """
    found = {}
    for error, (name, part) in product(ENERGIES, rows.groupby("problem")):
        met = part[part["energy error"] <= error]
        if len(met):
            found[name, error] = met.loc[met["ns a unit of time"].idxmin(), "method"]
    return found


def _settings(rows: pd.DataFrame) -> pd.DataFrame:
    """Select the runs of REBOUND's integrators that have a measured time.

    Every setting of an integrator, such as WHFast with a corrector, has an id of its own in the column "method".
    """
    return rows[(rows["kind"] == "rebound") & rows["ns a unit of time"].notna()]


@of(RIVALS)
def planets(rows: pd.DataFrame) -> Verdict | None:
    """Whether WHFast, in one of its settings, is the fastest Wisdom-Holman integrator of REBOUND on the outer planets.

    It has to be the fastest for more than half of the energy errors that some integrator reaches; None if no error is
    reached.  ``rows`` has a row for each run.
    """
    found = _settings(rows)
    best = _cheapest(found[found["problem"] == PLANETS])
    if not best:
        return None
    others = {error: id for (_, error), id in best.items() if not id.startswith("rebound-whfast")}
    return Verdict(
        "On the outer planets WHFast is the fastest of REBOUND's Wisdom-Holman integrators",
        Count(len(best) - len(others), len(best)),
        MOST,
        "energy errors",
        where=f"{others[max(others)]} to {max(others):g}" if others else "",
    )


@of(RIVALS)
def correctors(rows: pd.DataFrame) -> Verdict | None:
    """Whether WHFast's energy error is smallest with the symplectic corrector 11 or 17, for most problems and steps.

    ``rows`` has a row for each run; most are more than half.  None if no problem and step has runs with all correctors.
    """
    found = _settings(rows).pivot_table(index=["problem", "h"], columns="method", values="energy error")
    found = found.reindex(columns=list(CORRECTORS.values())).dropna()
    if found.empty:
        return None
    high = found[[CORRECTORS[11], CORRECTORS[17]]].min(axis=1) / found.min(axis=1)
    name, _ = high.idxmax()
    return Verdict(
        "Corrector 11 or 17 gives WHFast its smallest energy error in most cases",
        Count(int((high <= EQUAL).sum()), len(high)),
        MOST,
        "problems and steps",
        where=f"{name}: {number(high.max())} times",
    )


@of(RIVALS)
def kernels(rows: pd.DataFrame) -> Verdict | None:
    """Whether WHFast's lazy kernel (lazy implementer's modified kick) is the fastest of its kernels in most cases.

    A case is a problem with an energy error that some kernel reaches, and most cases are at least half of them.
    ``rows`` has a row for each run; None without a case.
    """
    found = _settings(rows)
    best = _cheapest(found[found["method"].isin(KERNELS)])
    if not best:
        return None
    others = Counter(KERNELS[id] for id in best.values() if KERNELS[id] != "lazy")
    return Verdict(
        "The lazy kernel is often the fastest of WHFast's kernels for an energy error",
        Count(len(best) - others.total(), len(best)),
        at_least(0.5),
        "problems and errors",
        where=", ".join(f"{kernel} {n}" for kernel, n in others.most_common()),
    )


GUIDE = "OrdinaryDiffEqSymplecticRK.jl, documentation, August 2026"
HENON, BOSON = (f"SciMLBenchmarks.jl, {name}, July 2026" for name in ("Hénon–Heiles", "boson"))
IAS15, HEYOKA = "REBOUND 5, documentation of IAS15", "heyoka.py, README"
WHFAST, OLDER = "REBOUND 5, documentation of WHFast", "REBOUND 4, documentation of integrators"
SAID = (
    Quoted(bounded, "Bounded energy error over long time periods", "", GUIDE),
    Quoted(linear, "Linear energy drift instead of quadratic", "it is the position's error that grows linearly", GUIDE),
    Quoted(
        quadratic,
        "standard integrators have energy error growing quadratically",
        "the position's error does; the energy's grows linearly",
        GUIDE,
    ),
    Quoted(positions, "a linear drift ... of this trajectory (v6.96)", "", GUIDE),
    Quoted(other_positions, "Normal integrators tend to have a quadratic ... drift (v6.96)", "", GUIDE),
    Quoted(than_verlet, "VelocityVerlet: less efficient in terms of accuracy than McAte2", "", GUIDE),
    Quoted(
        loose,
        "McAte2 (second-order, optimal efficiency)",
        "of second order perhaps; methods of higher order need fewer",
        GUIDE,
    ),
    Quoted(
        efficient,
        "For computational efficiency: McAte2 or McAte3",
        "errors from 0.1 to 1e-10 are asked for; at the largest it is closer",
        GUIDE,
    ),
    Quoted(fourth, "McAte4 (requires quadratic kinetic energy)", "", GUIDE),
    Quoted(fifth, "McAte5: Fifth-order", "it is a Nyström method, as McAte4 is, and no condition is named", GUIDE),
    Quoted(
        short,
        "its energy error fluctuations are larger than for other methods",
        "with compensated sums they are the smallest; theirs are plain",
        HENON,
    ),
    Quoted(later, "if the simulation time is increased, the energy error ... is less noticeable", "", HENON),
    Quoted(later_boson, "the energy error of the symplectic methods is less noticeable", "", BOSON),
    Quoted(harder, "the energy error for the other integration methods increased significantly", "", BOSON),
    Quoted(machine, "in most cases accurate down to machine precision", "", IAS15),
    Quoted(planets, "the best choice for systems in which there is a dominant central object", "", WHFAST),
    Quoted(correctors, "For high accuracy simulation set this value to 11 or 17", "", WHFAST),
    Quoted(kernels, "Lazy implementer's modified kick. This is often the best option", "", OLDER),
    Quoted(
        taylor,
        "maintain machine precision accuracy over tens of billions of timesteps",
        "",
        HEYOKA,
    ),
)
