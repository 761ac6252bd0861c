"""Verdicts of the report on stability limits and on close encounters of the Kepler problem."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.experiments.extremes import encounters
from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, Count, Verdict, at_least, at_most
from phasebench.integrators.registry import BY_ID

#: Peers whose steps solve Kepler's problem exactly.
KEPLERIAN = ("rebound-whfast", "rebound-mercurius", "rebound-trace")
#: Largest relative difference from a closed form.
SHARP = 1e-10


@of("extremes_published")
def known_limits(known: pd.DataFrame) -> Verdict:
    """Judge whether measured stability limits equal the derived or printed ones."""
    agrees = known["agrees"].astype(bool)
    wrong = join_list(list(known.loc[~agrees, "method"]), 3) if not agrees.all() else ""
    return Verdict(
        "Known stability limits of hω are met to the digits that are given",
        Count(int(agrees.sum()), len(known)),
        EVERY,
        "limits",
        wrong,
        FAIL,
    )


@of("extremes_scheme_i")
def closed_form(sweep: pd.DataFrame) -> Verdict | None:
    """Judge whether Scheme I's limit equals its closed form at every lambda at which it is finite."""
    finite = sweep[np.isfinite(sweep["closed form"])]
    if finite.empty:
        return None
    off = (finite["limit"] / finite["closed form"] - 1).abs()
    where = f"λ = {finite.loc[off.idxmax(), 'lam']}"
    return Verdict(
        "Scheme I's stability limit is hω = 2 / |1 − 2λ|",
        float(off.max()),
        at_most(SHARP),
        "relative difference",
        where,
        FAIL,
    )


@of("extremes_linear")
def long_runs(linear: pd.DataFrame) -> Verdict:
    """Judge whether long runs near the limits stay bounded or grow as the step map predicts."""
    ran = linear[linear["runs"].fillna(0) > 0]
    astray = list(ran[ran["confirmed"] < ran["runs"]]["label"])
    right = Count(int(ran["confirmed"].sum()), int(ran["runs"].sum()))
    return Verdict(
        "Long runs beside the limits stay bounded or grow as the step map predicts",
        right,
        EVERY,
        "runs",
        join_list(astray, 3) if astray else "",
        FAIL,
    )


def reach(table: pd.DataFrame) -> pd.Series:
    """Find for each integrator the largest eccentricity up to which its error on Kepler orbits is small; 0 if none."""
    out = {}
    for method, rows in table.groupby("method", sort=False):
        rows = rows.sort_values("e")
        held = rows["held"].astype(bool)
        out[method] = float(rows["e"][held.cummin()].max()) if held.iloc[0] else 0.0
    return pd.Series(out, dtype=float)


def kind(method: str, measured: str) -> str:
    """Name the kind of an integrator's steps: "Kepler-solving" if they solve Kepler's problem, else ``measured``.

    ``measured`` is the kind in the table: "fixed", "adaptive" or "transformed".
    """
    family = BY_ID[method].family if method in BY_ID else ""
    return "Kepler-solving" if family in ("wisdom_holman", "fcirk") or method in KEPLERIAN else measured


@of("extremes_encounters")
def close(table: pd.DataFrame) -> Verdict:
    """Judge whether some integrator follows Kepler's orbit at every e, and name the kind of steps that fails first."""
    worst, last = reach(table), float(table["e"].max())
    kinds = {r.method: kind(r.method, r.kind) for r in table.drop_duplicates("method").itertuples()}
    best = worst.groupby(kinds, sort=False).max()
    return Verdict(
        "Some integrators hold Kepler's orbit up to the largest eccentricity",
        int((worst == last).sum()),
        at_least(1),
        f"of {len(worst)} integrators",
        where=f"{best.idxmin()} steps: to e = {best.min():.10g}, error {encounters.HELD:g}",
    )
