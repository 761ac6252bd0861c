"""Semi-discretized wave equations: energy, mass and charge, and what a step costs."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of

ROUND_OFF = "round-off"


def _ran(frame: pd.DataFrame) -> pd.DataFrame:
    ran = frame[frame["status"] == "ok"].copy()
    for column in ("energy is kept", "invariant is kept"):
        ran[column] = ran[column].astype(bool)
    return ran


def _judge(frame: pd.DataFrame, what: str, declared: str, name: str) -> Verdict | None:
    """Whether those that declare to keep something do; the mass, q.q + p.p, is none of the declared form."""
    ran = _ran(frame)
    if ran.empty:
        return None
    says = ran[ran[declared] == ROUND_OFF]
    keeps, loses = says[says[f"{what} is kept"]], says[~says[f"{what} is kept"]]
    others = ran[(ran[declared] != ROUND_OFF) & ~ran[f"{what} is kept"]]
    text = f"The {name} is kept to round-off in {len(keeps)} of {len(says)} runs whose method declares it"
    text += f" (at most {number(keeps[f'{what} error'].max())})" if len(keeps) else ""
    text += f", not by {listed(sorted(loses['method'].unique()), 4)}" if len(loses) else ""
    text += f"; the other methods' error is at least {number(others[f'{what} error'].min())}" if len(others) else ""
    return Verdict(f"{text}.", loses.empty, f"The {name} is kept in {len(keeps)} of {len(says)} runs that declare it.")


@of("pde")
def energy(frame: pd.DataFrame) -> Verdict | None:
    """Whether the energy is kept on steps with a root."""
    return _judge(frame, "energy", "energy class", "energy (on steps with a root)")


@of("pde")
def charge(frame: pd.DataFrame) -> Verdict | None:
    """Whether the charge of the Klein-Gordon equation is kept."""
    return _judge(frame[frame["invariant"] == "charge"], "invariant", "quadratic class", "charge, of the form q·Dp,")


@of("pde")
def roots(frame: pd.DataFrame) -> Verdict | None:
    """On how many steps there is no root."""
    ran = _ran(frame)
    if ran.empty:
        return None
    missed = ran[ran["fallbacks"] > 0]
    parts = [f"{r.method} on {r.problem} at h = {number(r.h)}: {int(r.fallbacks)}" for r in missed.itertuples()]
    text = f"Steps without a root: {listed(parts, 4)}." if parts else "No step of any run is without a root."
    return Verdict(text, missed.empty, f"{int(ran['fallbacks'].sum())} steps have no root; the next ones win H back.")


@of("pde")
def draw(frame: pd.DataFrame, folder) -> list[Picture] | None:
    """Energy error against time."""
    ran = _ran(frame)
    if ran.empty:
        return None
    problems, methods = (list(dict.fromkeys(ran[c])) for c in ("problem", "method"))
    with style.settings():
        figure, (panels,) = style.panels(1, len(problems), 3.2, sharey=True)
        for axes, name in zip(panels, problems, strict=True):
            for k, method in enumerate(methods):
                part = ran[(ran["problem"] == name) & (ran["method"] == method)]
                look = style.curve(k) if k < len(style.CURVES) else {"color": style.GREY, "marker": "*"}
                axes.loglog(part["seconds"], part["energy error"].clip(lower=1e-17), label=method, **look)
            axes.set(title=name, xlabel="warm integration (s)")
            axes.grid(color="0.93", linewidth=0.5)
            style.plain_ticks(axes.xaxis)
        panels[0].set_ylabel("energy error")
        style.legend_above(figure, panels[0], 4)
    caption = (
        "Largest energy error, on steps with a root, against warm seconds; the two marks of a curve are two steps."
    )
    return [Picture(style.save(figure, folder, "waves.png"), "energy error against time", caption)]


COLUMNS = {
    "problem": "problem",
    "method": "method",
    "h": "h",
    "energy error": "energy error",
    "invariant": "invariant",
    "invariant error": "its error",
    "evaluations per step": "evaluations a step",
    "fallbacks": "no root",
    "seconds": "seconds",
    "status": "status",
}


@of("pde")
def table(frame: pd.DataFrame) -> Table:
    """The smaller step of each method on each problem."""
    least = frame.loc[frame.groupby(["problem", "method"], sort=False)["h"].idxmin()]
    caption = "Every method on every problem, at its smallest step."
    return Table(least[list(COLUMNS)].rename(columns=COLUMNS).head(ROWS), caption)


@of("pde")
def _whole(frame: pd.DataFrame) -> pd.DataFrame:
    return frame[list(COLUMNS)].rename(columns=COLUMNS)


PAGE = Page(
    id="waves",
    question="Do energy, mass and charge of wave equations stay when many degrees of freedom are integrated?",
    tables=("pde",),
    setting=(
        "Nonlinear Schrödinger: i u_t + u_xx + 2|u|²u = 0 (plane wave, soliton), d = 64; Klein–Gordon, d = 128.",
        "Central differences in space leave a canonical system; that system is what is integrated.",
        "Mass Σ|u|² is of the form q·q + p·p: Scheme I keeps it at λ = 1/2 alone. Charge is of the form q·Dp.",
        "Errors are absolute, over every step; seconds are the warm integration without output.",
    ),
    verdicts=(energy, charge, roots),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        "Kept is judged by the measurement, in units of round-off of the terms' size (`is kept` in the table).",
        "What is kept in every cell of space-time is told by the page on [local laws](multisymplectic.md).",
    ),
    command="pytest benchmarks/experiments/waves",
)
