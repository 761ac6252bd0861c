"""The figures of the talks, drawn from their measured curves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.page import Data, Picture
from phasebench.benchmarks.store.arrays import unpack

from .curves import CARRIERS, COMPOSITIONS, NOISE, ORBITS, PRESERVING, SCHEMES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Zero errors are drawn at this value on logarithmic axes.
FLOOR = 1e-18


def _pendulum(rows: pd.DataFrame) -> Figure:
    figure, grid = style.panels(2, 2, 5.0, sharex=True, sharey=True)
    faces, eyes = (rows[rows["curve"].str.contains(word)] for word in ("face", "eye"))
    flow = {r.curve: (unpack(r.x), unpack(r.y)) for r in faces.itertuples() if r.panel == "exact flow"}
    for axes, title in zip(grid.flat, CARRIERS, strict=True):
        here = faces[faces["panel"] == title]
        for k, r in enumerate(here.itertuples()):
            colour = style.SKY if k % 2 else style.ORANGE
            axes.fill(unpack(r.x), unpack(r.y), facecolor=colour, edgecolor="black", linewidth=0.8, alpha=0.8)
            if title != "exact flow":
                closed = [np.append(x, x[0]) for x in flow[r.curve]]
                axes.plot(*closed, color=style.GREY, linestyle="--", linewidth=0.7)
        for r in eyes[eyes["panel"] == title].itertuples():
            axes.fill(unpack(r.x), unpack(r.y), color="black", linewidth=0)
        axes.set_title(f"{title}\nareas {', '.join(f'{a:.3f}' for a in here['area'])}")
        axes.set_aspect("equal")
    for k in (0, 1):
        grid[1, k].set_xlabel("$q$ (rad)")
        grid[k, 0].set_ylabel("$p$")
    return figure


def _lotka(rows: pd.DataFrame) -> Figure:
    figure, grid = style.panels(2, 2, 5.2)
    exact = rows["curve"] == "exact flow"
    for axes, title in zip(grid.flat, rows["panel"].unique(), strict=False):
        for r in rows[exact & (rows["panel"] == title)].itertuples():
            axes.plot(unpack(r.x), unpack(r.y), color=style.GREY, linewidth=1.2)
        for k, r in enumerate(rows[~exact & (rows["panel"] == title)].itertuples()):
            u, v = unpack(r.x), unpack(r.y)
            colour, _, marker = style.CURVES[k]
            axes.plot(u, v, color=colour, marker=marker, linewidth=0.4, markersize=2.4, label=r.curve)
            axes.plot(u[0], v[0], color="black", marker="*", markersize=8, linestyle="none")
        axes.set(xlim=(0, None), ylim=(0, None), title=title, xlabel="$u$ (predators)", ylabel="$v$ (prey)")
        axes.legend(loc="upper right")
    return figure


def _sections(rows: pd.DataFrame) -> Figure:
    figure, grid = style.panels(2, rows["curve"].nunique(), 4.2, sharex="row", sharey="row")
    look = {"linestyle": "none", "marker": ".", "markersize": 2.4, "markeredgewidth": 0, "color": style.BLUE}
    for axes, r in zip(grid.flat, rows.itertuples(), strict=True):
        axes.plot(unpack(r.x), unpack(r.y), **look)
        axes.set(title=f"{r.panel}, {r.curve}", xlabel="$q_2$")
    for axes in grid[:, 0]:
        axes.set_ylabel("$p_2$")
    return figure


def _errors(rows: pd.DataFrame, panels: Iterable[tuple[str, str, str]]) -> Figure:
    """Errors over t, below each other: panels are (name of the panel, title, label of the axis)."""
    figure, grid = style.panels(2, 1, 4.4, sharex=True)
    for axes, (panel, title, label) in zip(grid[:, 0], panels, strict=True):
        for k, r in enumerate(rows[rows["panel"] == panel].itertuples()):
            t, e = unpack(r.x), unpack(r.y)
            axes.semilogy(t, np.maximum(e, FLOOR), label=r.curve, **style.curve(k, len(t)))
        axes.set(ylabel=label, title=title, xlim=(0, rows["t_end"].max()))
        style.decades(axes)
    grid[-1, 0].set_xlabel("$t$")
    figure.align_ylabels()
    style.legend_above(figure, grid[0, 0], len(PRESERVING))
    return figure


def orders(rows: pd.DataFrame) -> pd.Series:
    """The order of the scheme of each curve of refinement differences."""
    known = {title: order for title, (_, order) in (SCHEMES | COMPOSITIONS).items()}
    return rows["panel"].map(known).fillna(rows["curve"].map(known))


def _differences(axes: Axes, rows: pd.DataFrame) -> tuple[np.ndarray, list[np.ndarray]]:
    """Draw a curve for each of ``rows``; return (step sizes, refinement differences of each curve)."""
    for k, r in enumerate(rows.itertuples()):
        axes.loglog(unpack(r.x), np.maximum(unpack(r.y), FLOOR), label=r.curve, **style.curve(k))
    axes.set(xlabel="$h$")
    axes.grid(color="0.9", linewidth=0.5)
    return unpack(rows["x"].iloc[0]), [*map(unpack, rows["y"])]


def _schemes(rows: pd.DataFrame) -> Figure:
    figure, (panels,) = style.panels(1, 3, 3.0, sharey=True)
    drawn = []
    for axes, (title, (_, order)) in zip(panels, SCHEMES.items(), strict=True):
        drawn.append((axes, *_differences(axes, rows[rows["panel"] == title]), order))
        axes.set_title(f"{title}; grey: slope {order}")
    panels[0].set_ylabel(r"$\|y_h - y_{2h}\|_\infty$")
    style.legend_above(figure, panels[0], 4)
    for line in drawn:
        style.slope(*line)
    return figure


def _compositions(rows: pd.DataFrame) -> Figure:
    figure, ((axes,),) = style.panels(1, 1, 3.6)
    h, differences = _differences(axes, rows)
    for order, line in ((4, "-"), (6, "--")):
        group = [e[:5] for e, of in zip(differences, orders(rows), strict=True) if of == order]
        style.slope(axes, h[:5], [np.where(e > NOISE, e, 0) for e in group], order, line)
    axes.set_ylabel(r"$\|y_h - y_{2h}\|_\infty$")
    figure.legend(loc="outside right upper", handlelength=3.4)
    return figure


ENERGIES = [(orbit, f"{orbit} orbit", "$|H - H_0|$") for orbit in ORBITS]
INVARIANTS = (("energy", "", "$|H - H_0|$"), ("angular-momentum", "", "$|L - L_0|$"))
PIECES = "h = {h:g}; each curve joins the maxima of 200 equal pieces of time."
CHAOTIC = "Refinement difference max |y_h - y_2h| over q and p at t = 1 on the chaotic Hénon–Heiles orbit, of"
#: Figure -> (what draws it, title, caption, with {columns} of its first row).
FIGURES = {
    "pendulum-area": (
        _pendulum, "Area preservation on the pendulum",
        "A set carried by the pendulum's flow and by three methods with h = π/4, shown at t = 0, h, ..., 4h, with its "
        "areas (dashed: the flow, by the classical Runge–Kutta method at h/400).",
    ),
    "lotka-volterra-methods": (
        _lotka, "Numerical flow of four methods",
        "Numerical flow of Lotka–Volterra, 120 steps of h = 0.12 to t = {t_end:g}, from the stars; grey: the exact "
        "flow (classical Runge–Kutta method, h = {h:g}).",
    ),
    "henon-heiles-scheme-i-sections": (
        _sections, "Poincaré sections of Scheme I",
        "Hénon–Heiles, Poincaré section q_1 = 0, p_1 > 0 of Scheme I's orbits to t = {t_end:g}, h = {h:g}.",
    ),
    "henon-heiles-preserving-energy": (
        lambda rows: _errors(rows, ENERGIES), "Energy error of AVF, Schemes IV and V",
        f"Hénon–Heiles, energy error to t = {{t_end:g}}, {PIECES}",
    ),
    "perturbed-kepler-preserving-invariants": (
        lambda rows: _errors(rows, INVARIANTS), "Energy and angular momentum of AVF, Schemes IV and V",
        f"Perturbed Kepler, errors of energy H (above) and angular momentum L to t = {{t_end:g}}, {PIECES}",
    ),
    "convergence-schemes-i-iii": (
        _schemes, "Convergence of Schemes I, II and III",
        f"{CHAOTIC} Schemes I, II and III: not the error against the exact solution, but it falls with the same order. "
        f"Slopes are fitted over the three smallest steps with differences above {NOISE:g}.",
    ),
    "convergence-compositions": (
        _compositions, "Convergence of the higher-order compositions",
        f"{CHAOTIC} compositions of Scheme III (λ = 1/3) and of Scheme V.",
    ),
}  # fmt: skip


def pictures(ids: Sequence[str], data: Data, folder: Path) -> list[Picture] | None:
    """Draw the figures with these ids; one whose curves were not measured is left out."""
    curves, drawn = data("talk_curves"), []
    for id in ids if curves is not None else ():
        rows = curves[curves["figure"] == id]
        if len(rows):
            draw, title, caption = FIGURES[id]
            with style.settings():
                file = style.save(draw(rows), folder, f"{id}.png")
            drawn.append(Picture(file, title, caption.format_map(rows.iloc[0])))
    return drawn or None
