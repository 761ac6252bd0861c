"""Energy and angular momentum over long times: largest errors, and drifts with their intervals."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.long_runs import NOISE, SHARE, completed_runs, long_runs
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Data, Table, of
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Study, rows_of
from phasebench.benchmarks.page.verdict import NONE, at_most
from phasebench.integrators.record import BOUNDED, DRIFT, ROUND_OFF
from phasebench.integrators.registry import METHODS

TABLE, ANGULAR = "rows", "angular-momentum_max"
#: Energy and angular momentum are kept if their error is at most this over the whole span.
KEPT = 1e-11
CLASSES = (ROUND_OFF, BOUNDED, DRIFT)
#: log10 of the smallest and the largest error on the figure's colour scale.
LIMITS = (-16, 0)
#: Lines of the table with drifts, and with runs that stopped early.
DRIFTS, STOPPED = 8, 6


#: The completed long runs, a function of data.
COMPLETED = of(TABLE)(completed_runs)
#: Runs in which an energy-preserving method had a solution in every step, and as many nodes as H wants.
PRESERVING = f"declared == '{ROUND_OFF}' and not fallbacks > 0 and not `few nodes`"
#: Runs of methods declared to keep quadratic invariants, with a measured angular momentum.
MOMENTUM = f"`{ANGULAR}` == `{ANGULAR}` and id in {[m.id for m in METHODS if m.quadratic == ROUND_OFF]}"
#: Runs on canonical systems whose energy drifts, with an error above round-off.
DRIFTING = f"canonical and drifts and energy_max > {NOISE}"


def drifting(ran: pd.DataFrame) -> pd.Series:
    """True for a method that drifts: a value for each, at its first run that does."""
    found = ran.eval(DRIFTING)
    first = ran.loc[found.sort_values(ascending=False, kind="stable").index].drop_duplicates("id")
    return found[first.index]


def _answer(data: Data) -> str | None:
    ran, parts = rows_of(data, COMPLETED), []
    if ran is None:
        return None
    for name, column, rows in (("energy", "energy_max", PRESERVING), ("angular momentum", ANGULAR, MOMENTUM)):
        if len(runs := ran.query(rows)):
            parts.append(f"{runs['id'].nunique()} methods keep the {name} to {number(runs[column].max(), 2)}")
    drift = sorted(ran.query(DRIFTING)["id"].unique())
    parts.append(f"the energy of {join_list(drift, 3)} drifts (canonical systems)" if drift else "no energy drifts")
    return f"Long-term, {'; '.join(parts)}."


@picture(
    COMPLETED, "invariants", "energy errors on the long scenes",
    "Largest energy error on each long scene at its largest step, between 1e-16 and 1; grey: the method cannot "
    "integrate the scene, or did not reach its end.",
)  # fmt: skip
def _draw(ran: pd.DataFrame) -> style.Figure:
    first = ran.loc[ran.groupby(["scene", "method"], sort=False)["h"].idxmax()]
    middle = first.groupby(["method", "declared"])["energy_max"].median().reset_index()
    middle["rank"] = middle["declared"].map({c: k for k, c in enumerate(CLASSES)})
    middle = middle.sort_values(["rank", "energy_max"])
    wide = first.pivot_table(index="scene", columns="method", values="energy_max", sort=False)[list(middle["method"])]
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
    named = [((a + b) / 2, c) for a, b, c in zip([0, *ends[:-1]], ends, CLASSES, strict=True) if b > a]
    axes.set_xticks([x for x, _ in named], [c for _, c in named])
    axes.tick_params(length=0)
    axes.set_xlabel(f"{len(middle)} methods, by the declared behaviour of the energy, then by error")
    figure.colorbar(mesh, ax=axes, pad=0.01, label=r"$\log_{10} \max |H - H_0|$")
    return figure


@of(TABLE)
def _table(rows: pd.DataFrame) -> Table | None:
    ran, runs = completed_runs(rows), long_runs(rows)
    parts = []
    for declared in CLASSES[:2]:
        part = ran[(ran["declared"] == declared) & ran["canonical"]]
        part = part[part["seconds"].notna()] if "seconds" in part else part
        # The best of each scene: errors of different scenes cannot be compared.
        best = part.sort_values("energy_max", kind="stable").drop_duplicates("scene")
        parts.append(best.assign(why=f"least, declared {declared}"))
    drift = ran[ran["drifts"] & (ran["energy_max"] > NOISE)]
    drift = drift.sort_values("energy_drift", key=np.abs, ascending=False, kind="stable").drop_duplicates("id")
    stopped = runs[runs["status"] != "ok"].drop_duplicates("method")
    parts += [drift.head(DRIFTS).assign(why="drifts"), stopped.head(STOPPED).assign(why="stopped early")]
    shown = pd.concat(parts).head(ROWS)
    slope = ["" if pd.isna(x) else f"{x:.1e}" for x in shown["energy_drift"]]
    shown = shown.assign(**{"energy error": shown["energy_max"], "drift a unit of time": slope})
    columns = ["why", "method", "scene", "h", "energy error", "drift a unit of time", "status"]
    caption = (
        "The smallest energy error of each declared behaviour on each scene, the largest drifts, also on "
        "Lotka–Volterra, and runs that stopped early; `status`: why."
    )
    return Table(shown[columns], caption) if len(shown) else None


@of(TABLE)
def _whole(rows: pd.DataFrame) -> pd.DataFrame:
    ran = long_runs(rows).dropna(subset=["h"])
    ran = ran.loc[ran.groupby(["scene", "method"], sort=False)["h"].idxmax()]
    return ran.rename(columns={"energy_max": "energy error"})[
        ["scene", "method", "declared", "h", "energy error", "status"]
    ]


STUDY = Study(
    id="invariants",
    place=150,
    question="Which methods keep energy and angular momentum over long times, and which drift?",
    answer=_answer,
    setting=(
        "max |H − H₀| over all steps, and the slope of H − H₀ over time with its 95 % interval, oscillation removed.",
        "Pendulum, perturbed Kepler and Hénon–Heiles (box and chaotic) to t = 1000, Kepler over 100 orbits, "
        "Lotka–Volterra to t = 120, whose variables (u, v) are not canonical; steps of 0.005 to 0.12.",
        "A method declares that its energy error is of `round-off`, `bounded` (it oscillates) or a `drift`.",
    ),
    runs=(),
    claims={
        "energy": Claim(
            "The energy error of energy-preserving methods is of round-off",
            COMPLETED, lambda ran: ran["energy_max"].fillna(np.inf), at_most(KEPT), rows=PRESERVING,
            where="{method} on {scene}", fault=True,
        ),
        "drifting": Claim(
            "On canonical systems no method drifts that is declared not to",
            COMPLETED, drifting, NONE, rows=f"canonical and declared != '{DRIFT}'", unit="methods",
            where="{method} on {scene}, h = {h:g}", names=3, fault=True,
        ),
        "momentum": Claim(
            "Where it is declared to be kept, the angular momentum's error is of round-off",
            COMPLETED, f"`{ANGULAR}`", at_most(KEPT), rows=MOMENTUM, where="{method} on {scene}", fault=True,
        ),
    },
    figure=_draw,
    shown=_table,
    whole=_whole,
    limits=(
        "A drift counts if its interval excludes 0, if over the span the nearer end of the interval, and the error at "
        f"the end, each come to {SHARE:.0%} of the largest error, and if that exceeds {NOISE:g}.",
        f"Energy and angular momentum are kept if their error is at most {KEPT:g}. HBVM(k, s) with too few nodes for "
        "H's degree, and runs in which a step had no solution, are left out.",
        "A drift slower than the error of the removed oscillation is not seen in 1000 units of time.",
        "What is declared holds for canonical systems; on Lotka–Volterra in (u, v) symplectic methods may drift.",
    ),
    reads=(TABLE,),
    command="pytest benchmarks -k trade",
)  # fmt: skip
