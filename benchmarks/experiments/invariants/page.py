"""Energy and angular momentum over long times: the largest error and the drift with its interval."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.experiments.matrix import matrix
from phasebench.benchmarks.experiments.trade import sweep
from phasebench.benchmarks.page.markdown import listed, number, table
from phasebench.benchmarks.page.page import Page
from phasebench.benchmarks.problems import problem
from phasebench.integrators.record import DRIFT as DRIFTS
from phasebench.integrators.record import ROUND_OFF
from phasebench.integrators.registry import BY_ID

#: A drift counts when its interval excludes zero and it adds this share of the largest error over the whole time.
SHARE = 0.5


def _write(data, figures):
    rows = data("rows")
    if rows is None:
        return None
    part = rows[rows["purpose"] == sweep.DRIFT].copy()
    if part.empty or not (part["status"] == "ok").any():
        return ["No drift scene was measured to its end."], ""
    for column in ("energy_drift", "energy_drift_low", "energy_drift_high", "global_error"):
        if column not in part:
            part[column] = float("nan")
    if "kind" not in part:
        part["kind"] = sweep.KIND
    # Verdicts are of this project's methods: what other packages claim is tested on the page of the audit.
    ours = part[part["kind"] == sweep.KIND]
    verdict = _verdicts(ours) if (ours["status"] == "ok").any() else ["No method reached the end of a drift scene."]
    for kind, members in (("methods", ours), ("peers", part[part["kind"] != sweep.KIND])):
        stopped = members[~members["status"].isin(["ok", "skipped"])]
        if len(stopped):
            names = listed(sorted(stopped["method"].unique()))
            verdict.append(f"{len(stopped)} runs of {kind} did not reach the end: {names}.")
    body = [
        "`energy error` is the largest |H - H0| over every step (of peers: over at most 5000 rows); `drift` the secular slope "
        "of H - H0 per unit of time with its 95 % interval, bounded oscillation removed.\n"
    ]
    for scene, members in part.groupby("scene", sort=False):
        shown = members[members["status"] != "skipped"].copy()
        shown["drift"] = shown.apply(_drift, axis=1)
        columns = {"method": "method", "h": "h"} | ({"tol": "tolerance"} if _known(shown, "tol") else {})
        columns |= {"energy_max": "energy error", "drift": "drift of the energy"}
        columns |= {
            c: c.removesuffix("_max").replace("-", " ") + " error"
            for c in shown
            if c.endswith("_max") and c != "energy_max" and shown[c].notna().any()
        }
        columns |= {"global_error": "global error"} if _known(shown, "global_error") else {}
        early = _known(shown, "global_error_time") and shown["global_error_time"].min() < 0.99 * shown["t_end"].max()
        columns |= {"global_error_time": "at t ="} if early else {}
        columns |= {"fallbacks": "fallbacks", "seconds": "seconds", "status": "status"}
        body += [
            f"## {scene}\n",
            f"To t = {number(members['t_end'].iloc[0])}.{_horizon(shown) if early else ''}\n",
            table(shown, columns),
        ]
        for r in shown[shown["status"] != "ok"].itertuples():
            size = f"h = {number(r.h)}" if r.h == r.h else f"tolerance {number(r.tol)}"
            body.append(f"- {r.method}, {size}: {r.status}: {r.reason}.")
        body.append("")
    return verdict, "\n".join(body)


def _verdicts(ours: pd.DataFrame) -> list[str]:
    """What is kept and what drifts, of the methods' rows."""
    ran = ours[ours["status"] == "ok"].copy()
    ran["declared"] = ran["id"].map(lambda i: BY_ID[i].energy)
    sure = (ran["energy_drift_low"] > 0) | (ran["energy_drift_high"] < 0)
    ran["drifts"] = sure & (ran["energy_drift"].abs() * ran["t_end"] > SHARE * ran["energy_max"])
    names = ran["problem"].str.partition(":")[0]
    few = pd.Series([matrix.too_few_nodes(*pair) for pair in zip(ran["id"], names, strict=True)], ran.index)
    ran["canonical"] = names.map({n: problem(n).system.canonical for n in names.unique()})
    exact = ran[(ran["declared"] == ROUND_OFF) & (ran["fallbacks"] == 0) & ~few]
    verdict = []
    if len(exact):
        worst = exact.loc[exact["energy_max"].idxmax()]
        verdict.append(
            f"Energy of the {exact['id'].nunique()} energy-preserving methods: at most {number(worst['energy_max'])} "
            f"({worst['method']}, {worst['scene']}, h = {number(worst['h'])}) over {len(exact)} runs without a fallback."
        )
    if few.any():
        verdict.append(
            "HBVM(k, s) keeps polynomials of degree at most 2k/s: with too few nodes its energy error is at most "
            f"{number(ran[few]['energy_max'].max())}."
        )
    wrong = ran[ran["drifts"] & (ran["declared"] != DRIFTS) & (ran["energy_max"] > 1e-12)]
    elsewhere, wrong = wrong[~wrong["canonical"]], wrong[wrong["canonical"]]
    verdict.append(
        "A secular energy drift is seen in "
        + listed(sorted(ran[ran["drifts"] & (ran["declared"] == DRIFTS)]["method"].unique()))
        + " (declared so); "
        + (
            "in no method declared to have none, on canonical systems."
            if wrong.empty
            else f"and, undeclared, in {listed([f'{r.method} ({r.scene}, h = {r.h:g})' for r in wrong.itertuples()])}."
        )
    )
    if len(elsewhere):
        verdict.append(
            f"What is declared holds for canonical systems: on {listed(sorted(elsewhere['problem'].unique()))}, which is "
            f"none, the invariant also drifts in {listed(sorted(elsewhere['id'].unique()), 40)}."
        )
    if "angular-momentum_max" in ran:
        kept = ran[ran["angular-momentum_max"].notna()]
        good = kept[kept["id"].map(lambda i: BY_ID[i].quadratic == ROUND_OFF)]
        bad = kept[~kept["id"].map(lambda i: BY_ID[i].quadratic == ROUND_OFF)]
        if len(good) and len(bad):
            verdict.append(
                f"Angular momentum: at most {number(good['angular-momentum_max'].max())} in the methods declared to keep "
                f"it, at least {number(bad['angular-momentum_max'].min())} in the others "
                f"({listed(sorted(bad['id'].unique()))})."
            )
    return verdict


def _known(frame: pd.DataFrame, column: str) -> bool:
    return column in frame and frame[column].notna().any()


def _horizon(shown: pd.DataFrame) -> str:
    return (
        f" Errors of trajectories can be told to t = {number(shown['reference_horizon'].max())}; those here are at "
        f"t = {number(shown['global_error_time'].max())}."
    )


def _drift(r: pd.Series) -> str:
    if pd.isna(r.get("energy_drift")):
        return ""
    return f"{r['energy_drift']:.1e} [{r['energy_drift_low']:.1e}, {r['energy_drift_high']:.1e}]"


PAGE = Page(
    "invariants", "Invariants over long times", "what is kept, what oscillates and what drifts", ("rows",), _write
)
