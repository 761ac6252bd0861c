r"""Figures of the pendulum, H = p^2 / 2 - cos q: phase portrait, and areas of sets under the flow and under methods.

The flow is symplectic (Poincare 1899) and, with one degree of freedom, preserves areas.  So does a symplectic method at
any step; explicit Euler multiplies an area element by :math:`1 + h^2\cos q` in each step.

Source: talk on symplectic integration, 'The Pendulum Problem', 'Area Preservation'; E. Hairer, C. Lubich, G. Wanner,
Geometric Numerical Integration (2006), I.1.3, figures VI.2.2 and VI.3.1.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks import style
from phasebench.benchmarks.store.arrays import unpack
from phasebench.benchmarks.style import number

from . import measure
from .measure import Figure

if TYPE_CHECKING:
    import pandas as pd
    import sympy as sp
    from matplotlib.figure import Figure as Drawing

SNAPSHOTS = 4
STEP = np.pi / 4

#: (panel title, method id, steps per snapshot); the exact flow is the classical Runge-Kutta method with small steps.
CARRIERS = (
    ("exact flow", "rk4", 400),
    ("symplectic Euler", "symplectic-euler-p", 1),
    ("implicit midpoint", "implicit-midpoint", 1),
    ("explicit Euler", "explicit-euler", 1),
)


def _grid(
    q: tuple[float, float], p: tuple[float, float], n: int
) -> tuple[np.ndarray, np.ndarray, Callable[[sp.Expr], np.ndarray]]:
    """A grid of n by n points of the pendulum's phase plane; ``q`` and ``p`` are its ranges (low, high)."""
    Q, P = np.meshgrid(np.linspace(*q, n), np.linspace(*p, n))
    system = measure.start("pendulum").system
    return Q, P, lambda e: system.observe(e, Q.reshape(-1, 1), P.reshape(-1, 1)).reshape(Q.shape)


@style.styled
def phase_portrait(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """The pendulum's phase portrait, level curves of H and the vector field."""
    system = measure.start("pendulum").system
    span, height = (-1.5 * np.pi, 3.5 * np.pi), (-2.8, 2.8)
    figure, ((axes,),) = style.panels(1, 1, 2.75)
    Q, P, value = _grid(span, height, 160)
    saddle = float(system.observe(system.H, [[np.pi]], [[0.0]])[0])
    levels = np.array([-0.8, -0.4, 0.0, 0.5, 1.5, 2.2, 3.0])
    axes.contour(Q, P, value(system.H), levels=levels, colors=style.BLUE, linewidths=0.9, linestyles="solid")
    axes.contour(Q, P, value(system.H), levels=[saddle], colors=style.VERMILION, linewidths=1.4, linestyles="dashed")
    Q, P, value = _grid(span, height, 23)
    dq, dp = value(system.dq[0]), value(system.dp[0])
    speed = np.hypot(dq, dp)
    axes.quiver(Q, P, dq / speed, dp / speed, color=style.GREY, scale=45, width=0.0016, pivot="mid", angles="xy")
    axes.set(xlim=span, ylim=height, aspect="equal", xlabel="$q$ (rad)", ylabel="$p$")
    axes.set_xticks(np.pi * np.arange(-1, 4), ["$-\\pi$", "0", "$\\pi$", "$2\\pi$", "$3\\pi$"])
    caption = (
        f"Phase portrait of the pendulum: level curves of H = p^2/2 - cos q at H = {', '.join(map(number, levels))} "
        f"(solid) and the separatrix H = {number(saddle)} through the saddle (dashed); arrows: direction of the vector "
        "field."
    )
    return figure, caption


def cat_images(id: str, substeps: int, vertices: int) -> np.ndarray:
    """The outline of a cat's face and its images under a method on the pendulum: (SNAPSHOTS + 1, vertices, 2)."""
    face = measure.cat((0.0, 1.35), 0.42, vertices)
    return measure.carry(measure.start("pendulum"), id, face, STEP / substeps, SNAPSHOTS, substeps)


def _measure_area() -> list[dict]:
    rows = []
    for title, id, substeps in CARRIERS:
        carry = {"h": STEP / substeps, "snapshots": SNAPSHOTS, "substeps": substeps}
        for k, face in enumerate(cat_images(id, substeps, 512)):
            rows.append(measure.row(title, f"face {k}", *face.T, area=measure.enclosed_area(face)))
        for side, x in (("left", -0.16), ("right", 0.16)):
            eyes = measure.carry(measure.start("pendulum"), id, measure.circle((x, 1.45), 0.07, 24), **carry)
            rows += [measure.row(title, f"{side} eye {k}", *eye.T) for k, eye in enumerate(eyes)]
    return rows


@style.styled
def area(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """A cat's face and its images under the pendulum's flow, symplectic methods and explicit Euler."""
    figure, grid = style.panels(2, 2, 5.0, sharex=True, sharey=True)
    faces, eyes = (rows[rows["curve"].str.contains(word)] for word in ("face", "eye"))
    flow = {r.curve: (unpack(r.x), unpack(r.y)) for r in faces.itertuples() if r.panel == "exact flow"}
    for axes, title in zip(grid.flat, rows["panel"].unique(), strict=False):
        here = faces[faces["panel"] == title]
        for k, r in enumerate(here.itertuples()):
            colour = style.SKY if k % 2 else style.ORANGE
            points = unpack(r.x), unpack(r.y)
            axes.fill(*points, facecolor=colour, edgecolor="black", linewidth=0.8, alpha=0.8)
            if title != "exact flow":
                closed = [np.append(x, x[0]) for x in flow[r.curve]]
                axes.plot(*closed, color=style.GREY, linestyle="--", linewidth=0.7)
        for r in eyes[eyes["panel"] == title].itertuples():
            axes.fill(unpack(r.x), unpack(r.y), color="black", linewidth=0)
        areas = here["area"].to_numpy()
        axes.set_title(f"{title}\nareas {', '.join(f'{a:.3f}' for a in areas)}")
        axes.set_aspect("equal")
    for axes in grid[-1]:
        axes.set_xlabel("$q$ (rad)")
    for axes in grid[:, 0]:
        axes.set_ylabel("$p$")
    vertices = len(flow["face 0"][0])
    caption = (
        "A set carried by the pendulum's flow and by three methods with h = π/4, shown at t = 0, h, ..., "
        f"{SNAPSHOTS}h, with its areas (dashed: the flow, by the classical Runge–Kutta method at h/{CARRIERS[0][2]}). "
        f"The boundary is interpolated through {vertices} points."
    )
    return figure, caption


FIGURES = (
    Figure("pendulum-phase-portrait", "Phase portrait of the pendulum", None, phase_portrait),
    Figure("pendulum-area", "Area preservation on the pendulum", _measure_area, area),
)
