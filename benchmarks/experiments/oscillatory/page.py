"""The Fermi-Pasta-Ulam problem over h omega: stability, resonances, and what they cost in H and in I."""

from __future__ import annotations

import math
from pathlib import Path

import pandas as pd

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed, number, table
from phasebench.benchmarks.page.page import Page

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


def _places(ratios) -> str:
    """Which of the ratios lie near integer multiples, by multiple; and how many lie elsewhere."""
    near = sorted({round(r) for r in ratios if round(r) >= 1 and abs(r - round(r)) <= NEAR})
    others = sum(1 for r in ratios if round(r) < 1 or abs(r - round(r)) > NEAR)
    text = f"near {listed([f'{k} pi' for k in near])}" if near else ""
    return " and ".join(
        filter(None, [text, f"at {others} step size{'s' if others > 1 else ''} elsewhere" if others else ""])
    )


def _verdict(frame: pd.DataFrame, summary: pd.DataFrame) -> list[str]:
    sentences = []
    whole = summary[summary["energy lost"] == 0]
    if len(whole):
        parts = [
            f"{r['method']} (greatest energy error {number(r['greatest energy error'])}, of I "
            f"{number(r['greatest error of I'])})"
            for r in whole.to_dict("records")
        ]
        sentences.append(
            f"To h omega = {number(frame[RATIO].max())} pi these keep the energy to within {number(LOST)} at every step size: "
            f"{listed(parts)}."
        )
    else:
        sentences.append("No method keeps the energy at every step size.")
    for r in summary[summary["energy lost"] > 0].to_dict("records"):
        part = frame[frame["method"] == r["method"]]
        lost = part[(part["status"] != "ok") | ~(part[ENERGY] < LOST)]
        above = part[part[RATIO] >= lost[RATIO].min()]
        if len(lost) == len(above):
            last = part[part[RATIO] < lost[RATIO].min()][RATIO].max()
            sentences.append(f"{r['method']} loses the energy at every step size above h omega = {number(last)} pi.")
        else:
            sentences.append(f"{r['method']} loses it {_places(lost[RATIO])}.")
    small = frame[frame[RATIO] == frame[RATIO].min()]
    if small[ENERGY].notna().any():
        best = small.loc[small[ENERGY].idxmin()]
        sentences.append(
            f"Least energy error at the smallest step, h omega = {number(best[RATIO])} pi: {best['method']}, "
            f"{number(best[ENERGY])}."
        )
    return sentences


def draw(frame: pd.DataFrame, directory: Path) -> str:
    """Errors of H and I against h omega / pi, a panel for each method; returns the file's name in ``directory``."""
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
    return style.save(figure, directory, "oscillatory-resonances.png")


def _write(data, figures):
    frame = data("oscillatory")
    if frame is None:
        return None
    frame = frame.assign(method=frame["method"].astype(str))
    summary = _summary(frame)
    omega = float((frame[RATIO] * math.pi / frame["h"]).median())
    refused = frame[frame["status"] == "invalid"]
    body = [
        f"The Fermi-Pasta-Ulam problem with stiff springs, omega = {number(omega)}, to t = {number(SPAN)}. The energy "
        f"counts as lost where the integration does not end, is refused, or the greatest error of H exceeds {number(LOST)}; "
        "medians are over the other step sizes. I is an adiabatic invariant: the exact flow does not keep it exactly.\n",
        f"![greatest errors of H and I against h omega / pi](figures/{draw(frame, figures)})\n",
        "Solid blue: the total energy H. Dashed orange: the oscillatory energy I. Triangles: no finite end, a step refused, "
        f"or an error of H above {number(LIMITS[1])}.\n",
        table(summary),
    ]
    if len(refused):
        at = listed(
            [f"{m} at {listed([number(x) for x in g[RATIO]])} pi" for m, g in refused.groupby("method", sort=False)]
        )
        body.append(f"Refused, as the kick is infinite there: h omega of {at}.\n")
    return _verdict(frame, summary), "\n".join(body)


PAGE = Page(
    "oscillatory",
    "Highly oscillatory systems",
    "which step sizes beyond the fast period an integrator survives, and where it resonates",
    ("oscillatory",),
    _write,
)
