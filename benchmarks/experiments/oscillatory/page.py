"""The Fermi-Pasta-Ulam problem over h omega: stability, resonances, and what they cost in H and in I."""

from __future__ import annotations

import math
from pathlib import Path

import pandas as pd

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import Page, Picture, Table, Verdict, of

from .oscillatory import ERRORS, SPAN

RATIO = "h omega / pi"
ENERGY, OSCILLATORY = ERRORS
#: The total energy of the published initial state is 2.0012: an error of half of it is no error but a loss.
LOST = 1.0
#: How far from an integer multiple of pi a step is called resonant, in multiples of pi.
NEAR = 0.1
#: The part of the logarithmic axis that is drawn; worse is a mark at the top.
LIMITS = (1e-6, 1e2)


def _summary(frame: pd.DataFrame) -> pd.DataFrame:
    """A row for each method: how many steps it survives, and its median and greatest errors there."""
    rows = []
    for name, part in frame.groupby("method", sort=False):
        kept = part[(part["status"] == "ok") & (part[ENERGY] < LOST)]
        lost = part.drop(kept.index)
        ok = part[part["status"] == "ok"]
        worst = ok.loc[ok[ENERGY].idxmax()] if len(ok) else None
        rows.append(
            {
                "method": name,
                "step sizes": len(part),
                "energy lost": len(lost),
                "first lost at h omega / pi": lost[RATIO].min(),
                "median energy error": kept[ENERGY].median(),
                "greatest energy error": math.nan if worst is None else worst[ENERGY],
                "at h omega / pi": math.nan if worst is None else worst[RATIO],
                "median error of I": kept[OSCILLATORY].median(),
                "greatest error of I": ok[OSCILLATORY].max(),
            }
        )
    return pd.DataFrame(rows)


def _places(lost: pd.DataFrame) -> str:
    """Near which integer multiples the steps lie, and how many lie elsewhere."""
    resonant = [r for r in lost[RATIO] if round(r) >= 1 and round(abs(r - round(r)), 9) <= NEAR]
    near = sorted({round(r) for r in resonant})
    others = len(lost) - len(resonant)
    text = f"near {listed([f'{k} π' for k in near])}" if near else ""
    return " and ".join(
        filter(None, [text, f"at {others} step size{'s' if others > 1 else ''} elsewhere" if others else ""])
    )


@of("oscillatory")
def survivors(frame: pd.DataFrame) -> Verdict:
    """Who keeps the energy at every step size."""
    summary = _summary(frame)
    whole = summary[summary["energy lost"] == 0]
    parts = [
        f"{r['method']} (energy error at most {number(r['greatest energy error'])})" for r in whole.to_dict("records")
    ]
    range_ = f"up to hω = {number(frame[RATIO].max())} π"
    return Verdict(
        f"At every step size {range_} the energy is kept to within {number(LOST)} by "
        + (f"{listed(parts, 4)}." if parts else "no method."),
        len(whole) > 0,
        f"{len(whole)} of {len(summary)} methods survive every step size {range_}.",
    )


@of("oscillatory")
def resonances(frame: pd.DataFrame) -> Verdict | None:
    """Where the others lose it."""
    summary = _summary(frame)
    parts = []
    for r in summary[summary["energy lost"] > 0].to_dict("records"):
        part = frame[frame["method"] == r["method"]]
        lost = part[(part["status"] != "ok") | ~(part[ENERGY] < LOST)]
        above = part[part[RATIO] >= lost[RATIO].min()]
        everywhere = len(lost) == len(above)
        where = f"above {number(part[part[RATIO] < lost[RATIO].min()][RATIO].max())} π" if everywhere else _places(lost)
        parts.append(f"{r['method']} {where}")
    if not parts:
        return None
    text = f"The others lose it: {'; '.join(parts)}."
    return Verdict(text, True, text)


@of("oscillatory")
def smallest(frame: pd.DataFrame) -> Verdict | None:
    """Who is best where every method works."""
    small = frame[frame[RATIO] == frame[RATIO].min()]
    if not small[ENERGY].notna().any():
        return None
    best = small.loc[small[ENERGY].idxmin()]
    text = f"Least energy error at the smallest step, hω = {number(best[RATIO])} π: {best['method']}, {number(best[ENERGY])}."
    return Verdict(text, True, text)


@of("oscillatory")
def draw(frame: pd.DataFrame, directory: Path) -> list[Picture]:
    """Errors of H and I against h omega / pi, a panel for each method."""
    names = list(dict.fromkeys(frame["method"]))
    columns = 3
    with style.settings():
        figure, axes = style.panels(-(-len(names) // columns), columns, 6.4, sharex=True, sharey=True)
        for i, ax in enumerate(axes.flat):
            if i >= len(names):
                ax.set_axis_off()
                continue
            part = frame[frame["method"] == names[i]].sort_values(RATIO)
            for j, name in enumerate((OSCILLATORY, ENERGY)):
                look = {"color": (style.ORANGE, style.BLUE)[j], "linestyle": ("--", "-")[j], "zorder": 2 + j}
                ax.semilogy(part[RATIO], part[name], linewidth=1.0, **look)
            out = part[(part["status"] != "ok") | (part[ENERGY] > LIMITS[1])]
            top = [LIMITS[1] / 2] * len(out)
            ax.plot(out[RATIO], top, "v", color=style.VERMILION, markersize=3, zorder=4)
            for k in range(1, 1 + int(frame[RATIO].max())):
                ax.axvline(k, color="0.85", linewidth=0.6, zorder=0)
            ax.set_title(names[i])
            ax.set_ylim(*LIMITS)
            ax.grid(axis="y", color="0.93", linewidth=0.5)
        for ax in axes[-1]:
            ax.set_xlabel(r"$h\omega/\pi$")
        for ax in axes[:, 0]:
            ax.set_ylabel("greatest error")
        for text, y, colour in (("error of H", 0.17, style.BLUE), ("error of I", 0.06, style.ORANGE)):
            last = axes.flat[len(names) - 1]
            last.text(0.96, y, text, color=colour, transform=last.transAxes, ha="right")
    caption = (
        "Greatest errors of H (solid) and of the oscillatory energy I (dashed) against hω/π; triangles: no finite end, a "
        f"step refused, or an error of H above {number(LIMITS[1])}. Grey lines: hω a multiple of π."
    )
    return [Picture(style.save(figure, directory, "oscillatory.png"), "errors of H and I against hω/π", caption)]


@of("oscillatory")
def table(frame: pd.DataFrame) -> Table:
    """A row for each method."""
    caption = (
        f"Lost: no finite end, a step refused, or an error of H above {number(LOST)}; medians are over the other steps."
    )
    return Table(_summary(frame), caption)


@of("oscillatory")
def _whole(frame: pd.DataFrame) -> pd.DataFrame:
    """The step sizes at which the energy is lost."""
    columns = ["method", RATIO, "status", ENERGY, OSCILLATORY]
    return frame[(frame["status"] != "ok") | ~(frame[ENERGY] < LOST)][columns]


PAGE = Page(
    id="oscillatory",
    question="Which integrators survive steps beyond the fast period, and where do they resonate?",
    tables=("oscillatory",),
    setting=(
        "H = Σ (p₀ᵢ² + p₁ᵢ²)/2 + (ω²/2) Σ q₁ᵢ² + slow part: Fermi–Pasta–Ulam with three stiff springs, ω = 50.",
        f"From the published initial state (H = 2.0012) to t = {number(SPAN)}; step sizes up to hω = 4.5 π.",
        "I = Σ (p₁ᵢ² + ω² q₁ᵢ²)/2, the oscillatory energy, is an adiabatic invariant: the exact flow moves it a little.",
        "Trigonometric integrators, r-RESPA, IMEX, and Störmer–Verlet beside them.",
    ),
    verdicts=(survivors, resonances, smallest),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"The energy counts as lost from an error of {number(LOST)} on, half of the total; resonant means within {NEAR} π "
        "of a multiple of π.",
        "One ω and one initial state; narrow resonances may lie between the step sizes that were tried.",
    ),
    command="pytest benchmarks/experiments/oscillatory",
)
