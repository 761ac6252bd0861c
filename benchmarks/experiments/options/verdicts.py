"""Functions that judge the methods' options: whether the defaults are the best, and whether costlier settings pay.

Each gets a measured table and returns a `Verdict` for a report page, or None if the table does not decide.
"""

from __future__ import annotations

from collections.abc import Callable

import pandas as pd

from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, Count, Range, Verdict, at_most

from . import arithmetic, findings, ladders, lambdas, nodes, solvers

#: Largest time of AVF's own quadrature over that of the fewest nodes that keep the energy.
DEAR = 2.0


def coarse(errors: pd.DataFrame) -> pd.DataFrame:
    """Select the best values of the parameter lambda (`findings.best_lambdas`) for the larger of the two steps.

    ``errors`` is the table of errors of the module `lambdas`.
    """
    found = findings.best_lambdas(errors)
    return found[found["finer"] == found["finer"].min()] if len(found) else found


@of(lambdas.ERRORS)
def half_is_best(errors: pd.DataFrame) -> Verdict | None:
    """Judge whether the parameter lambda = 1/2 has the smallest trajectory error, for every scheme and on every orbit.

    ``errors`` is the table of errors of the module `lambdas`; None if no run at 1/2 can be compared.
    """
    found = coarse(errors)
    if found.empty:
        return None
    worst = found.loc[found["gain"].idxmax()]
    best = f"{number(worst['gain'], 2)} times the error at λ = {number(float(worst['best']), 2)}"
    return Verdict(
        "λ = 1/2 has the smallest trajectory error",
        Count(int(found["half is best"].sum()), len(found)),
        EVERY,
        "cases of a scheme and a scene",
        where="" if found["half is best"].all() else f"{worst['method']} on {worst['scene']}: {best}",
    )


@of(lambdas.COSTS)
def half_is_longest(costs: pd.DataFrame) -> Verdict | None:
    """Judge whether the parameter lambda = 1/2 allows the longest step, for every scheme and on every orbit.

    ``costs`` is the table of costs of the module `lambdas`; None if it has no run at 1/2.
    """
    found = findings.longest(costs)
    if found.empty:
        return None
    off = found[~found["half is longest"]]
    return Verdict(
        "No λ that was tried allows a longer step than 1/2",
        Count(len(found) - len(off), len(found)),
        EVERY,
        "cases of a scheme and a scene",
        where=join_list([f"{r.method} on {r.scene}" for r in off.itertuples()], 3) if len(off) else "",
    )


def _scenes(found: pd.DataFrame, good: Callable[[pd.Series], bool]) -> tuple[Count, str] | None:
    """Count the scenes (orbits) on which ``good`` returns True: (count, text that names those where it does not).

    ``found`` is a result of `findings.cheapest`; ``good`` gets the names of a scene's fastest settings, from the
    largest to the smallest error.  None if ``found`` has no rows.
    """
    if found.empty:
        return None
    ordered = found.sort_values("error", ascending=False, kind="stable").groupby("scene", sort=False)["setting"]
    bad = [scene for scene in found["scene"].unique() if not good(ordered.get_group(scene))]
    scenes = found["scene"].nunique()
    return Count(scenes - len(bad), scenes), join_list(bad, 3) if bad else ""


@of(ladders.TABLE)
def order_rises(rungs: pd.DataFrame) -> Verdict | None:
    """Judge whether the order of the fastest composition rises as the error falls, on every orbit.

    ``rungs`` is the table of the module `ladders`; None if it has no completed runs of compositions.
    """
    found = _scenes(
        findings.cheapest(rungs, ladders.COMPOSITION), lambda orders: orders.astype(int).is_monotonic_increasing
    )
    return found and Verdict(
        "The cheapest order of a composition rises as the error falls", found[0], EVERY, "scenes", where=found[1]
    )


@of(ladders.TABLE)
def higher_r_pays(rungs: pd.DataFrame) -> Verdict | None:
    """Judge whether the fastest generating function has a higher order r at the smallest error than at the largest.

    ``rungs`` is the table of the module `ladders`; None if it has no completed runs of generating functions.
    """
    found = _scenes(findings.cheapest(rungs, ladders.GENERATING), lambda names: r(names.iloc[-1]) > r(names.iloc[0]))
    return found and Verdict(
        "A generating function of higher r pays at small errors", found[0], EVERY, "scenes", where=found[1]
    )


def r(setting: str) -> int:
    """Return the order r of a generating function from the name of its setting, such as "r = 3, λ = 1/2"."""
    return ladders.SETTINGS[ladders.GENERATING][setting][1]["order"]


@of(ladders.TABLE)
def schemes_pay(rungs: pd.DataFrame) -> Verdict | None:
    """Judge whether Scheme IV or V is the fastest energy-preserving method at some error, on every orbit.

    These schemes, and compositions of them, choose a parameter in each step so that H is kept.  ``rungs`` is the table
    of the module `ladders`; None if it has no run that keeps the energy.
    """
    found = _scenes(findings.cheapest(rungs, ladders.ENERGY), lambda names: names.str.startswith("scheme-").any())
    return found and Verdict(
        "Scheme IV or V is, at some error, the cheapest energy-preserving method",
        found[0],
        EVERY,
        "scenes",
        where=found[1],
    )


def _case(row: pd.Series) -> str:
    return f"{row['scene']}, h = {number(row['h'])}"


@of(nodes.TABLE)
def quadrature(table: pd.DataFrame) -> Verdict | None:
    """Judge whether the averaged vector field method's own choice of quadrature nodes keeps the energy.

    ``table`` is that of the module `nodes`; None if it cannot decide.
    """
    found = findings.quadratures(table)
    if found.empty:
        return None
    worst = found.loc[found["confirmed"].idxmax()]
    return Verdict(
        "AVF's quadrature, which chooses its nodes by itself, keeps the energy",
        float(worst["confirmed"]),
        at_most(findings.FLOOR),
        "of the energy's terms",
        where=_case(worst),
        otherwise=FAIL,
    )


@of(nodes.TABLE)
def quadrature_cost(table: pd.DataFrame) -> Verdict | None:
    """Judge whether AVF with its own quadrature takes at most `DEAR` times as long as with the fewest nodes keeping H.

    ``table`` is that of the module `nodes`; None if it cannot decide.
    """
    found = findings.quadratures(table)
    if found.empty:
        return None
    dear = found["confirmed / fewest"]
    return Verdict(
        "It takes little longer than the fewest nodes that keep the energy",
        Range(dear.min(), dear.max()),
        at_most(DEAR),
        "times as long",
        where=_case(found.loc[dear.idxmax()]),
    )


@of(solvers.TABLE)
def solving(table: pd.DataFrame) -> Verdict | None:
    """Judge whether the integrators' own solver of stage equations needs about as few evaluations as the best tried.

    ``table`` is that of the module `solvers`; None if it cannot decide.
    """
    found = findings.solving(table)
    if found.empty:
        return None
    return Verdict(
        "The stage equations are solved in the fewest evaluations",
        Range(found["engine"].min(), found["engine"].max()),
        at_most(findings.SAME),
        "times those of the best solver tried",
        where=_case(found.loc[found["engine"].idxmax()]),
    )


@of(arithmetic.ERRORS)
def compensation(table: pd.DataFrame) -> Verdict | None:
    """Judge whether compensated sums leave less round-off than plain ones, on every orbit.

    ``table`` is the table of errors of the module `arithmetic`; None if it cannot decide.
    """
    found = findings.sums(table)
    if found.empty:
        return None
    least = found.loc[found["gain"].idxmin()]
    return Verdict(
        "Compensated sums leave less round-off than plain ones",
        Count(int((found["gain"] > 1).sum()), len(found)),
        EVERY,
        "scenes",
        where=f"{least['scene']}: {number(least['gain'], 2)} times less",
        otherwise=FAIL,
    )


@of(arithmetic.ERRORS)
def single(table: pd.DataFrame) -> Verdict | None:
    """Judge whether double precision reaches smaller errors than single precision, on every orbit.

    ``table`` is the table of errors of the module `arithmetic`; None if it cannot decide.
    """
    found = findings.sums(table)
    if found.empty:
        return None
    worst = found.loc[found["floor of single"].idxmax()]
    return Verdict(
        "Double precision reaches smaller errors than single precision",
        Count(int((found["floor of single"] > found["error of doubles"]).sum()), len(found)),
        EVERY,
        "scenes",
        where=f"{worst['scene']}: single precision ends at {number(worst['floor of single'], 2)}",
    )
