"""Energy and angular momentum over long times: the largest error and the drift with its interval."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.experiments.matrix import matrix
from phasebench.benchmarks.experiments.trade import sweep
from phasebench.benchmarks.measure.integrator import OURS
from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of, once
from phasebench.benchmarks.problems import problem
from phasebench.integrators.record import BOUNDED, DRIFT, ROUND_OFF
from phasebench.integrators.registry import BY_ID

#: A drift counts when what it adds over the whole time, at the end of its interval that is nearer to 0, and the error at
#: the end are both, with its sign, at least this share of the largest error.
SHARE = 0.5
#: An energy error up to this is of round-off: its drift says nothing of the method.
LEAST = 1e-12
#: Energy and angular momentum are kept if their error is at most this over the whole span.
KEPT = 1e-11
CLASSES = (ROUND_OFF, BOUNDED, DRIFT)
#: The logarithms of the errors that are told apart in the figure.
LIMITS = (-16, 0)


@once
def long_runs(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows of this project's methods on the long scenes, with their declared class."""
    part = rows[rows["purpose"] == sweep.DRIFT]
    if "kind" in part:
        part = part[part["kind"] == OURS]
    part = part[part["status"] != "skipped"].copy()
    wanted = (
        "energy_max",
        "energy_end",
        "energy_drift",
        "energy_drift_low",
        "energy_drift_high",
        "angular-momentum_max",
        "fallbacks",
    )
    for column in wanted:
        if column not in part:
            part[column] = np.nan
    return part.assign(declared=[BY_ID[i].energy if i in BY_ID else "" for i in part["id"]])


@once
def ended(rows: pd.DataFrame) -> pd.DataFrame:
    """The long runs that reached the end, each with whether its energy drifts and whether its system is canonical."""
    ran = long_runs(rows)
    ran = ran[ran["status"] == "ok"].copy()
    # Of an interval with 0 inside nothing is sure.
    ran["sure"] = ran["energy_drift_low"].clip(lower=0) + ran["energy_drift_high"].clip(upper=0)
    ran["share"] = ran["sure"].abs() * ran["t_end"] / ran["energy_max"]
    gone = ran["energy_end"] * np.sign(ran["sure"]) < SHARE * ran["energy_max"]
    ran["drifts"] = (ran["share"] > SHARE) & ~gone
    names = ran["problem"].astype(str).str.split(":").str[0]
    ran["canonical"] = names.map({n: problem(n).system.canonical for n in names.unique()}).astype(bool)
    ran["few nodes"] = [matrix.too_few_nodes(*pair) for pair in zip(ran["id"], names, strict=True)]
    return ran


@of("rows")
def energy(rows: pd.DataFrame) -> Verdict | None:
    """Whether the energy-preserving methods keep the energy."""
    ran = ended(rows)
    exact = ran[(ran["declared"] == ROUND_OFF) & ~(ran["fallbacks"] > 0) & ~ran["few nodes"].astype(bool)]
    if exact.empty:
        return None
    worst = exact.loc[exact["energy_max"].idxmax()]
    wrong = exact[~(exact["energy_max"] <= KEPT)]
    counts = f"{exact['id'].nunique()} energy-preserving methods"
    text = (
        f"The {counts} keep the energy to {number(worst['energy_max'])} at worst ({worst['method']}, {worst['scene']}) "
        f"over {len(exact)} long runs without a fallback"
    )
    text += f"; above {KEPT:g}: {listed(sorted(wrong['method'].unique()), 4)}." if len(wrong) else "."
    return Verdict(text, wrong.empty, f"The {counts} keep it to {number(worst['energy_max'])} at worst.")


@of("rows")
def drifting(rows: pd.DataFrame) -> Verdict | None:
    """Whether a method drifts that is declared not to."""
    ran = ended(rows)
    ran = ran[ran["canonical"]]
    if ran.empty:
        return None
    drift = ran[ran["drifts"] & (ran["energy_max"] > LEAST)]
    wrong, declared = drift[drift["declared"] != DRIFT], sorted(drift[drift["declared"] == DRIFT]["id"].unique())
    names = [f"{r.method} ({r.scene}, h = {r.h:g})" for r in wrong.itertuples()]
    return Verdict(
        f"On canonical systems the energy drifts in {listed(declared, 8)} as declared, and in "
        + (f"{listed(names, 3)}, undeclared." if names else "no method declared to have no drift."),
        wrong.empty,
        f"{wrong['id'].nunique()} methods drift undeclared on canonical systems.",
    )


@of("rows")
def momentum(rows: pd.DataFrame) -> Verdict | None:
    """Whether the angular momentum is kept where it is declared to be."""
    ran = ended(rows)
    ran = ran[ran["angular-momentum_max"].notna()]
    keeps = np.array([BY_ID[i].quadratic == ROUND_OFF if i in BY_ID else False for i in ran["id"]], dtype=bool)
    good, bad = ran[keeps], ran[~keeps]
    if good.empty:
        return None
    wrong = good[~(good["angular-momentum_max"] <= KEPT)]
    text = (
        f"The angular momentum is kept to {number(good['angular-momentum_max'].max())} by the {good['id'].nunique()} "
    )
    text += "methods declared to keep it"
    if len(bad):
        text += f"; the {bad['id'].nunique()} others lose up to {number(bad['angular-momentum_max'].max())}"
    if len(wrong):
        text += f"; above {KEPT:g}: {listed(sorted(wrong['method'].unique()), 4)}"
    return Verdict(f"{text}.", wrong.empty, f"{wrong['id'].nunique()} methods lose the angular momentum undeclared.")


@of("rows")
def draw(rows: pd.DataFrame, folder) -> list[Picture] | None:
    """The largest energy errors at the largest step: a line for each scene, a column for each method."""
    ran = ended(rows)
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
        "Largest energy error over each long scene at its largest step, clipped to 1e-16 and 1; grey: the method does "
        "not do the scene, or did not reach its end."
    )
    return [Picture(style.save(figure, folder, "invariants.png"), "energy errors on the long scenes", caption)]


def _line(r, why: str) -> dict:
    drift = "" if pd.isna(r["energy_drift"]) else f"{r['energy_drift']:.1e}"
    line = {"why": why, "method": r["method"], "scene": r["scene"], "h": r["h"], "energy error": r["energy_max"]}
    return line | {"drift a unit of time": drift, "status": r["status"]}


@of("rows")
def table(rows: pd.DataFrame) -> Table | None:
    """The best of each class, the worst of those that keep the energy, what drifts, what stopped."""
    ran, runs = ended(rows), long_runs(rows)
    lines = []
    for declared in CLASSES[:2]:
        part = ran[(ran["declared"] == declared) & ran["canonical"]].sort_values("energy_max")
        # Of each scene the best: errors of different scenes are not compared.
        part = part[part["seconds"].notna()] if "seconds" in part else part
        for _, members in part.groupby("scene", sort=False):
            lines.append(_line(members.iloc[0], f"least, declared {declared}"))
    drift = ran[ran["drifts"] & (ran["energy_max"] > LEAST)].sort_values("energy_max", ascending=False)
    lines += [_line(r, "drifts") for _, r in drift.drop_duplicates("id").head(8).iterrows()]
    stopped = runs[runs["status"] != "ok"].drop_duplicates("method")
    lines += [_line(r, "stopped early") for _, r in stopped.head(6).iterrows()]
    if not lines:
        return None
    caption = (
        "The least errors of each declared behaviour on each scene, the largest drifts, the runs that stopped early."
    )
    return Table(pd.DataFrame(lines[:ROWS]), caption)


@of("rows")
def _whole(rows: pd.DataFrame) -> pd.DataFrame:
    ran = long_runs(rows).dropna(subset=["h"])
    ran = ran.loc[ran.groupby(["scene", "method"], sort=False)["h"].idxmax()]
    columns = {"scene": "scene", "method": "method", "declared": "declared", "h": "h", "energy_max": "energy error"}
    return ran[[*columns, "status"]].rename(columns=columns)


PAGE = Page(
    id="invariants",
    question="Which methods keep energy and angular momentum over long times, and which drift?",
    tables=("rows",),
    setting=(
        "max |H − H₀| over every step, and the secular slope of H − H₀ with its 95 % interval, oscillation removed.",
        "Pendulum, perturbed Kepler and Hénon–Heiles (box and chaotic) to t = 1000, Kepler over 100 orbits, "
        "Lotka–Volterra to t = 120, whose variables (u, v) are not canonical; steps of 0.005 to 0.12.",
        "Methods declare `round-off`, `bounded` (the error oscillates) or `drift`.",
    ),
    verdicts=(energy, drifting, momentum),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"A drift counts where its interval excludes 0, its nearer end adds SHARE = {SHARE} of the largest error over the "
        f"span, the error at the end has that share too, and the largest exceeds {LEAST:g}.",
        f"Kept means an error of at most {KEPT:g}; HBVM(k, s) with too few nodes for H's degree is left out.",
        "A drift slower than the oscillation's own error over 1000 units of time is not seen.",
        "What is declared holds for canonical systems; on Lotka–Volterra in (u, v) symplectic methods may drift.",
    ),
    command="pytest benchmarks/experiments/trade",
)
