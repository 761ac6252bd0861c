"""The report page on energy and angular momentum over long times: largest errors, and drifts with their intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.long_runs import NOISE, SHARE, completed_runs, long_runs
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import FAIL, NONE, Count, Verdict, at_most
from phasebench.integrators.record import BOUNDED, DRIFT, ROUND_OFF
from phasebench.integrators.registry import BY_ID

if TYPE_CHECKING:
    from pathlib import Path

#: Energy and angular momentum are kept if their error is at most this over the whole span.
KEPT = 1e-11
CLASSES = (ROUND_OFF, BOUNDED, DRIFT)
#: log10 of the smallest and the largest error on the figure's colour scale.
LIMITS = (-16, 0)


def _energy_preserving(rows: pd.DataFrame) -> pd.DataFrame:
    """Select the completed long runs of energy-preserving methods in which every step had a solution.

    Methods HBVM(k, s) with too few nodes for the degree of H are left out.
    """
    ran = completed_runs(rows)
    return ran[(ran["declared"] == ROUND_OFF) & ~(ran["fallbacks"] > 0) & ~ran["few nodes"].astype(bool)]


def _largest(runs: pd.DataFrame, column: str) -> tuple[float, str]:
    """Return the largest error in a column of ``runs``, and the text "method on scene" of its run.

    A scene is an orbit with a time span.  A missing error counts as infinite.
    """
    errors = runs[column].fillna(np.inf)
    worst = runs.loc[errors.idxmax()]
    return float(errors.max()), f"{worst['method']} on {worst['scene']}"


@of("rows")
def energy(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether the energy error of energy-preserving methods is of round-off (at most `KEPT`).

    ``rows`` is the table of runs; None if it has no run of such a method.
    """
    exact = _energy_preserving(rows)
    if exact.empty:
        return None
    error, where = _largest(exact, "energy_max")
    return Verdict(
        "The energy error of energy-preserving methods is of round-off", error, at_most(KEPT), "", where, FAIL
    )


def _drifting(rows: pd.DataFrame) -> pd.DataFrame:
    """Select the completed runs on canonical systems whose energy drifts and whose energy error exceeds round-off."""
    ran = completed_runs(rows)
    return ran[ran["canonical"] & ran["drifts"] & (ran["energy_max"] > NOISE)]


@of("rows")
def drifting(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether the energy drifts only with methods that are declared to have a drift, on canonical systems.

    ``rows`` is the table of runs; None if it has no completed run on a canonical system.
    """
    ran = completed_runs(rows)
    others = ran[ran["canonical"] & (ran["declared"] != DRIFT)]
    if not ran["canonical"].any():
        return None
    drift = _drifting(rows)
    wrong = drift[drift["declared"] != DRIFT]
    names = [f"{r.method} on {r.scene}, h = {r.h:g}" for r in wrong.itertuples()]
    return Verdict(
        "On canonical systems no method drifts that is declared not to",
        Count(wrong["id"].nunique(), others["id"].nunique()),
        NONE,
        "methods",
        where=join_list(names, 3) if names else "",
        otherwise=FAIL,
    )


def _momentum_preserving(rows: pd.DataFrame) -> pd.DataFrame:
    """Select the completed runs with a measured angular momentum, of methods declared to keep quadratic invariants."""
    ran = completed_runs(rows)
    ran = ran[ran["angular-momentum_max"].notna()]
    keeps = [i in BY_ID and BY_ID[i].quadratic == ROUND_OFF for i in ran["id"]]
    return ran[np.array(keeps, dtype=bool)]


@of("rows")
def momentum(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether methods declared to keep quadratic invariants keep the angular momentum to `KEPT`.

    ``rows`` is the table of runs; None if it has no run of such a method with a measured angular momentum.
    """
    runs = _momentum_preserving(rows)
    if runs.empty:
        return None
    error, where = _largest(runs, "angular-momentum_max")
    return Verdict(
        "Where it is declared to be kept, the angular momentum's error is of round-off",
        error,
        at_most(KEPT),
        where=where,
        otherwise=FAIL,
    )


@of("rows")
def answer(rows: pd.DataFrame) -> str | None:
    """Write the page's answer, a sentence: how well energy and angular momentum are kept, and which methods drift.

    None if no long run is completed.
    """
    if completed_runs(rows).empty:
        return None
    parts = []
    for name, column, runs in (
        ("the energy", "energy_max", _energy_preserving(rows)),
        ("the angular momentum", "angular-momentum_max", _momentum_preserving(rows)),
    ):
        if len(runs):
            parts.append(f"{runs['id'].nunique()} methods keep {name} to {number(runs[column].max(), 2)}")
    drift = sorted(_drifting(rows)["id"].unique())
    parts.append(f"the energy of {join_list(drift, 3)} drifts (canonical systems)" if drift else "no energy drifts")
    text = "; ".join(parts)
    return f"Long-term, {text}."


@of("rows")
def draw(rows: pd.DataFrame, folder: Path) -> list[Picture] | None:
    """Draw the largest energy errors as a colour map: a line for each scene, a column for each method.

    A scene is an orbit with a time span.  Each error is that of the method's largest step.  None if no long run is
    completed.
    """
    ran = completed_runs(rows)
    if ran.empty:
        return None
    first = ran.loc[ran.groupby(["scene", "method"], sort=False)["h"].idxmax()]
    middle = first.groupby(["method", "declared"])["energy_max"].median().reset_index()
    middle["rank"] = middle["declared"].map({c: k for k, c in enumerate(CLASSES)})
    middle = middle.sort_values(["rank", "energy_max"])
    wide = first.pivot_table(index="scene", columns="method", values="energy_max", sort=False)[list(middle["method"])]
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 2.6)
        with np.errstate(divide="ignore"):
            shown = np.log10(wide.to_numpy(dtype=float)).clip(*LIMITS)
        mesh = axes.pcolormesh(shown, cmap="viridis", vmin=LIMITS[0], vmax=LIMITS[1])
        axes.set_facecolor("0.85")
        axes.set_yticks(np.arange(len(wide)) + 0.5, wide.index)
        axes.invert_yaxis()
        ends = np.cumsum([int((middle["declared"] == c).sum()) for c in CLASSES])
        for x in ends[:-1]:
            axes.axvline(x, color="white", linewidth=1.5)
        begins = [0, *ends[:-1]]
        named = [((a + b) / 2, c) for a, b, c in zip(begins, ends, CLASSES, strict=True) if b > a]
        axes.set_xticks([x for x, _ in named], [c for _, c in named])
        axes.tick_params(length=0)
        axes.set_xlabel(f"{len(middle)} methods, by the declared behaviour of the energy, then by error")
        bar = figure.colorbar(mesh, ax=axes, pad=0.01)
        bar.set_label(r"$\log_{10} \max |H - H_0|$")
    caption = (
        "Largest energy error on each long scene at its largest step, between 1e-16 and 1; grey: the method cannot "
        "integrate the scene, or did not reach its end."
    )
    return [Picture(style.save(figure, folder, "invariants.png"), "energy errors on the long scenes", caption)]


def _line(r: pd.Series, why: str) -> dict:
    """Make a line of the page's table from a run ``r`` (a row of the runs); ``why`` is the reason why it is shown."""
    drift = "" if pd.isna(r["energy_drift"]) else f"{r['energy_drift']:.1e}"
    line = {"why": why, "method": r["method"], "scene": r["scene"], "h": r["h"], "energy error": r["energy_max"]}
    return line | {"drift a unit of time": drift, "status": r["status"]}


@of("rows")
def table(rows: pd.DataFrame) -> Table | None:
    """Make the page's table, a run in each row: smallest energy errors, largest drifts, and runs that stopped early.

    The smallest errors are given for each scene (an orbit with a time span) and each declared behaviour of the energy
    (of round-off, or bounded).  ``rows`` is the table of runs; None if the table would be empty.
    """
    ran, runs = completed_runs(rows), long_runs(rows)
    lines = []
    for declared in CLASSES[:2]:
        part = ran[(ran["declared"] == declared) & ran["canonical"]].sort_values("energy_max", kind="stable")
        # The best of each scene: errors of different scenes cannot be compared.
        part = part[part["seconds"].notna()] if "seconds" in part else part
        for _, members in part.groupby("scene", sort=False):
            lines.append(_line(members.iloc[0], f"least, declared {declared}"))
    drift = ran[ran["drifts"] & (ran["energy_max"] > NOISE)]
    drift = drift.sort_values("energy_drift", key=np.abs, ascending=False, kind="stable")
    lines += [_line(r, "drifts") for _, r in drift.drop_duplicates("id").head(8).iterrows()]
    stopped = runs[runs["status"] != "ok"].drop_duplicates("method")
    lines += [_line(r, "stopped early") for _, r in stopped.head(6).iterrows()]
    if not lines:
        return None
    caption = "The smallest energy error of each declared behaviour on each scene, the largest drifts, also on Lotka–Volterra, and runs that stopped early; `status`: why."
    return Table(pd.DataFrame(lines[:ROWS]), caption)


@of("rows")
def _full_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Make the page's longer table: for each method and long scene, the energy error and status at the largest step.

    A scene is an orbit with a time span.
    """
    ran = long_runs(rows).dropna(subset=["h"])
    ran = ran.loc[ran.groupby(["scene", "method"], sort=False)["h"].idxmax()]
    columns = {"scene": "scene", "method": "method", "declared": "declared", "h": "h", "energy_max": "energy error"}
    return ran[[*columns, "status"]].rename(columns=columns)


PAGE = Page(
    id="invariants",
    question="Which methods keep energy and angular momentum over long times, and which drift?",
    tables=("rows",),
    setting=(
        "max |H − H₀| over all steps, and the slope of H − H₀ over time with its 95 % interval, oscillation removed.",
        "Pendulum, perturbed Kepler and Hénon–Heiles (box and chaotic) to t = 1000, Kepler over 100 orbits, "
        "Lotka–Volterra to t = 120, whose variables (u, v) are not canonical; steps of 0.005 to 0.12.",
        "A method declares that its energy error is of `round-off`, `bounded` (it oscillates) or a `drift`.",
    ),
    verdicts=(energy, drifting, momentum),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        f"A drift counts if its interval excludes 0, if over the span the nearer end of the interval, and the error at the end, "
        f"each come to {SHARE:.0%} of the largest error, and if that exceeds {NOISE:g}.",
        f"Energy and angular momentum are kept if their error is at most {KEPT:g}. HBVM(k, s) with too few nodes for H's degree, and runs "
        "in which a step had no solution, are left out.",
        "A drift slower than the error of the removed oscillation is not seen in 1000 units of time.",
        "What is declared holds for canonical systems; on Lotka–Volterra in (u, v) symplectic methods may drift.",
    ),
    command="pytest benchmarks/experiments/trade",
)
