"""Figures of a certificate: error against step, energy error over time, linear stability, error against evaluations."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.benchmarks import style
from phasebench.benchmarks.judge.evidence import Tables

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Drawing(NamedTuple):
    """A figure with the name of its file, its title and its caption."""

    figure: Figure
    file: str
    title: str
    caption: str


#: Smaller errors are drawn at this value.
LEAST = 1e-16


@style.styled
def order(tables: Tables) -> Drawing | None:
    """Draw the error against the step on every system; the points to which the order is fitted are thick."""
    rows = tables.of("order")
    if not rows:
        return None
    figure, ((axes,),) = style.panels(1, 1, 3.4)
    for k, row in enumerate(rows):
        h, error = np.array(row["h"]), np.array(row["error"])
        look = style.curve(k)
        seen = np.isfinite(error) & (error > 0)
        axes.loglog(h[seen], error[seen], label=row["on"], **look)
        window = seen & (h <= row["first"]) & (h >= row["last"])
        axes.loglog(h[window], error[window], color=look["color"], linewidth=4, alpha=0.35)
    noise = max(r["noise"] for r in rows)
    if noise > 1e-30:
        axes.axhline(noise, color=style.GREY, linewidth=0.8, linestyle=":")
    axes.set(xlabel="step h", ylabel="relative error")
    axes.legend()
    caption = "Relative error after the same time against the step, on each system; thick: the window of the order"
    caption += ", dotted: below it errors are taken for round-off." if noise > 1e-30 else "."
    return Drawing(figure, "order.png", "error against step", caption)


@style.styled
def energy(tables: Tables) -> Drawing | None:
    """Draw the energy error along the long runs; return None if there are none."""
    rows = [r for r in tables.of("long") if r["status"] == "ok"]
    if not rows:
        return None
    figure, axes = style.panels(len(rows), 1, 1.2 + 1.2 * len(rows), sharex=False)
    for axis, row, k in zip(axes[:, 0], rows, range(len(rows)), strict=True):
        t, error = np.array(row["curve"]).T
        axis.plot(t, error, color=style.CURVES[k][0], linewidth=0.8)
        axis.set_ylabel(row["on"])
    axes[-1, 0].set_xlabel("time")
    figure.supylabel("H - H(0)", fontsize=style.RC["axes.labelsize"])
    text = ", ".join(f"{r['on']} h = {r['h']:g}" for r in rows)
    return Drawing(figure, "energy.png", "energy error", f"H - H(0) along each run: {text}.")


@style.styled
def stability(tables: Tables) -> Drawing | None:
    """Draw the spectral radius of a step of the harmonic oscillator over h omega; return None if none was measured."""
    rows = [r for r in tables.of("stability") if r.get("radius")]
    if not rows:
        return None
    z, radius = np.array(rows[0]["radius"]).T
    figure, ((axes,),) = style.panels(1, 1, 2.4)
    axes.plot(z, np.minimum(radius, 4), color=style.BLUE)
    axes.axhline(1, color=style.GREY, linewidth=0.8)
    axes.set(xlabel="h omega", ylabel="spectral radius")
    caption = "The spectral radius of a step of the harmonic oscillator (cut at 4); above 1 it is unstable."
    return Drawing(figure, "stability.png", "linear stability", caption)


@style.styled
def place(tables: Tables) -> Drawing | None:
    """Draw error against gradient evaluations on each scene (problem and span); None if they were not compared."""
    rows = [r for r in tables.of("place") if r["curve"]]
    if not rows:
        return None
    figure, (panels,) = style.panels(1, len(rows), 3.0, sharey=True)
    for k, (axes, row) in enumerate(zip(panels, rows, strict=True)):
        evaluations, error = np.array(row["curve"]).T
        axes.loglog(evaluations, np.maximum(error, LEAST), label="this integrator", **style.curve(0))
        best = [(r["its evaluations"], r["error"]) for r in row["errors"]]
        axes.loglog(*zip(*best, strict=True), color="black", linewidth=4, alpha=0.2, label="the cheapest stored")
        axes.set(xlabel="evaluations of the gradient", title=row["on"])
        if not k:
            axes.set_ylabel("error at the end")
            axes.legend()
    about = ", ".join(f"{r['about']} ({r['on']})" for r in rows)
    caption = f"The error against the evaluations: {about}; grey: the fewest evaluations of the trade's integrators."
    return Drawing(figure, "place.png", "its place on fronts of the trade", caption)


#: Name -> the function that draws it, or returns None where nothing was measured for it.
DRAWINGS = {"order": order, "energy": energy, "stability": stability, "place": place}
