"""The report page on the Fermi-Pasta-Ulam problem over h omega: stability, resonances, errors of H and of I."""

from __future__ import annotations

import math
from pathlib import Path

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import Verdict, at_least

from .oscillatory import ERRORS, SPAN

RATIO = "h omega / pi"
ENERGY, OSCILLATORY = ERRORS
#: Energy error from which the energy counts as lost: half of the initial energy, 2.0012.
LOST = 1.0
#: Largest distance of h omega from an integer multiple of pi that counts as resonant, in multiples of pi.
NEAR = 0.1
#: Limits of the logarithmic error axis; larger errors are marks at the top.
LIMITS = (1e-6, 1e2)


def _energy_lost(frame: pd.DataFrame) -> pd.Series:
    """Mark each run that failed or has an energy error of `LOST` or more: a boolean series.

    ``frame`` is the table of runs, a row for each method and step size.
    """
    return (frame["status"] != "ok") | ~(frame[ENERGY] < LOST)


def _summary(frame: pd.DataFrame) -> pd.DataFrame:
    """Summarize the runs, a row for each method: at how many step sizes it loses the energy, at which, and its errors.

    The errors of H and of the oscillatory energy I are given as medians and as greatest values.  ``frame`` is the table
    of runs.
    """
    rows = []
    for name, part in frame.groupby("method", sort=False):
        lost = _energy_lost(part)
        kept, ok = part[~lost], part[part["status"] == "ok"]
        worst = ok.loc[ok[ENERGY].idxmax()] if len(ok) else None
        rows.append(
            {
                "method": name,
                "step sizes": len(part),
                "energy lost": int(lost.sum()),
                "first lost at hω/π": part.loc[lost, RATIO].min(),
                "where it is lost": _where(part, lost),
                "error of H at the smallest step": part.loc[part[RATIO].idxmin(), ENERGY],
                "median error of H": kept[ENERGY].median(),
                "greatest error of H": math.nan if worst is None else worst[ENERGY],
                "at hω/π": math.nan if worst is None else worst[RATIO],
                "median error of I": kept[OSCILLATORY].median(),
                "greatest error of I": ok[OSCILLATORY].max(),
            }
        )
    return pd.DataFrame(rows)


def _where(part: pd.DataFrame, lost: pd.Series) -> str:
    """Write at which h omega a method loses the energy: above a value, or near multiples of pi and at some others.

    The multiples of pi are named, the other steps counted.  ``part`` are the rows of the method, ``lost`` marks the
    runs that lose the energy; "" if none does.
    """
    ratios = part.loc[lost, RATIO]
    if ratios.empty:
        return ""
    below = part.loc[part[RATIO] < ratios.min(), RATIO]
    if lost[part[RATIO] >= ratios.min()].all():
        return f"above {number(below.max())} π" if len(below) else "at every step"
    resonant = [r for r in ratios if round(r) >= 1 and round(abs(r - round(r)), 9) <= NEAR]
    near = [f"near {join_list([f'{k} π' for k in sorted({round(r) for r in resonant})])}"] if resonant else []
    others = len(ratios) - len(resonant)
    return " and ".join(near + ([f"at {others} other step{'s' if others > 1 else ''}"] if others else []))


@of("oscillatory")
def survivors(frame: pd.DataFrame) -> Verdict:
    """Judge whether some method keeps the energy at every step size; ``frame`` is the table of runs."""
    summary = _summary(frame)
    worst = summary.loc[summary["energy lost"].idxmax()]
    return Verdict(
        "Some methods keep the energy at every step size",
        int((summary["energy lost"] == 0).sum()),
        at_least(1),
        f"of {len(summary)} methods",
        where=f"{worst['method']}, lost {worst['where it is lost']}" if worst["where it is lost"] else "",
    )


@of("oscillatory")
def answer(frame: pd.DataFrame) -> str:
    """Write the page's answer: which methods keep the energy with every step size, and from which one others lose it.

    ``frame`` is the table of runs, a row for each method and step size.
    """
    summary = _summary(frame)
    whole, others = summary[summary["energy lost"] == 0], summary[summary["energy lost"] > 0]
    names = join_list(list(whole["method"]), 2) if len(whole) else "No method"
    text = f"{names} keep{'s' if len(whole) < 2 else ''} the energy of a stiff Fermi–Pasta–Ulam chain at every step"
    text += f" up to hω = {number(frame[RATIO].max())}π"
    if others.empty:
        return f"{text}."
    return f"{text}; {len(others)} of {len(summary)} lose it, from hω = {number(others['first lost at hω/π'].min())}π."


@of("oscillatory")
def draw(frame: pd.DataFrame, directory: Path) -> list[Picture]:
    """Draw the errors of H and of the oscillatory energy I against h omega / pi, a panel for each method."""
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
        f"step refused, or an error of H above {number(LIMITS[1])}. Grey lines: hω is a multiple of π."
    )
    return [Picture(style.save(figure, directory, "oscillatory.png"), "errors of H and I against hω/π", caption)]


@of("oscillatory")
def table(frame: pd.DataFrame) -> Table:
    """Make the page's table, a row for each method: at how many step sizes it loses the energy, and its errors."""
    caption = (
        f"Greatest errors over a run. Lost: no finite end, a step refused, or an error of H of {number(LOST)} or more; "
        f"near a multiple of π: within {NEAR} π of it. Medians are over the step sizes at which the energy is not lost."
    )
    return Table(_summary(frame), caption)


@of("oscillatory")
def _full_table(frame: pd.DataFrame) -> pd.DataFrame:
    """Make the page's longer table: the runs that lose the energy, with h omega / pi, status and errors."""
    columns = ["method", RATIO, "status", ENERGY, OSCILLATORY]
    return frame[_energy_lost(frame)][columns]


PAGE = Page(
    id="oscillatory",
    question="Which integrators survive steps beyond the fast period, and where do they resonate?",
    tables=("oscillatory",),
    setting=(
        "H = Σ (p₀ᵢ² + p₁ᵢ²)/2 + (ω²/2) Σ q₁ᵢ² + slow part: Fermi–Pasta–Ulam with three stiff springs, ω = 50.",
        f"From the published initial state (H = 2.0012) to t = {number(SPAN)}; step sizes up to hω = 4.5 π.",
        "I = Σ (p₁ᵢ² + ω² q₁ᵢ²)/2, the energy of the stiff springs, is an adiabatic invariant: the exact flow changes it little.",
        "Trigonometric integrators, r-RESPA and IMEX, which treat the stiff part apart, beside Störmer–Verlet.",
    ),
    verdicts=(survivors,),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        f"The energy counts as lost from an error of {number(LOST)} on, half of the total; a loss counts as resonant "
        f"within {NEAR} π of a multiple of π.",
        "One ω and one initial state; narrow resonances between the step sizes that were tried are not seen.",
    ),
    command="pytest benchmarks/experiments/oscillatory",
)
