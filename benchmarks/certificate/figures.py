"""A certificate's figures: the order's ladder with its window, the energy error over time, stability."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.page import Picture

from .verdicts import Tables

#: Errors are drawn no smaller.
LEAST = 1e-16


@style.drawn
def order(tables: Tables, folder: Path) -> Picture | None:
    """The error over the step on every system; the window of the fit is drawn thick."""
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
    return Picture(style.save(figure, folder, "order.png"), "error against step", caption)


@style.drawn
def energy(tables: Tables, folder: Path) -> Picture | None:
    """The energy error along the long runs."""
    rows = [r for r in tables.of("long") if r["status"] == "ok"]
    if not rows:
        return None
    figure, axes = style.panels(len(rows), 1, 1.2 + 1.2 * len(rows), sharex=False)
    for axis, row, k in zip(axes[:, 0], rows, range(len(rows)), strict=True):
        t, error = np.array(row["curve"]).T
        axis.plot(t, error, color=style.CURVES[k][0], linewidth=0.8)
        axis.set_ylabel(row["on"])
    axes[-1, 0].set_xlabel("time")
    text = ", ".join(f"{r['on']} h = {r['h']:g}" for r in rows)
    return Picture(style.save(figure, folder, "energy.png"), "energy error", f"H - H(0) along each run: {text}.")


@style.drawn
def stability(tables: Tables, folder: Path) -> Picture | None:
    """By how much a step of the harmonic oscillator multiplies."""
    rows = [r for r in tables.of("stability") if r.get("radius")]
    if not rows:
        return None
    z, radius = np.array(rows[0]["radius"]).T
    figure, ((axes,),) = style.panels(1, 1, 2.4)
    axes.plot(z, np.minimum(radius, 4), color=style.BLUE)
    axes.axhline(1, color=style.GREY, linewidth=0.8)
    axes.set(xlabel="h omega", ylabel="spectral radius")
    caption = "The spectral radius of a step of the harmonic oscillator (cut at 4); above 1 it is unstable."
    return Picture(style.save(figure, folder, "stability.png"), "linear stability", caption)


@style.drawn
def place(tables: Tables, folder: Path) -> Picture | None:
    """The error over the evaluations on each scene, beside the fewest of the trade's integrators."""
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
    return Picture(style.save(figure, folder, "place.png"), "its place on fronts of the trade", caption)
