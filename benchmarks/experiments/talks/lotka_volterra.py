r"""Lotka-Volterra, u' = u (v - 2), v' = v (1 - u): vector field, exact flow, and the four methods' numerical flow.

Every solution lies on a level curve of :math:`I = \ln u - u + 2\ln v - v`.  The flow keeps the measure
:math:`\iint du\,dv/(uv)`, the area in the plane (ln u, ln v), where the system is canonical.

Source: talk on symplectic integration, 'Numerical experiments' (h = 0.12 and the starting points); E. Hairer,
C. Lubich, G. Wanner, Geometric Numerical Integration (2006), I.1.1 and VI.2.
"""

from __future__ import annotations

import numpy as np

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.style import number

from . import measure
from .record import Figure

SECTION = "lotka-volterra"
STEP = 0.12
#: (title, method, orbits): the talk's starting points; its symplectic Euler is implicit in u and explicit in v.
RUNS = (
    ("explicit Euler", "explicit-euler", ("2-2",)),
    ("implicit Euler", "implicit-euler", ("4-8",)),
    ("symplectic Euler", "symplectic-euler-q", ("4-2", "6-2")),
    ("implicit midpoint", "implicit-midpoint", ("4-2", "2-2")),
)


def _level_curves(axes, levels, span) -> None:
    system = measure.start("lotka-volterra").system
    u, v = np.meshgrid(np.linspace(0.02, span[0], 220), np.linspace(0.02, span[1], 220))
    invariant = system.observe(system.H, u.reshape(-1, 1), v.reshape(-1, 1)).reshape(u.shape)
    axes.contour(u, v, invariant, levels=sorted(levels), colors=style.GREY, linewidths=0.8, linestyles="solid")


def _invariant(u: float, v: float) -> float:
    system = measure.start("lotka-volterra").system
    return float(system.observe(system.H, [[u]], [[v]])[0])


@style.drawn
def exact_flow(quick: bool):
    """The vector field, and a disc carried along level curves."""
    system = measure.start("lotka-volterra").system
    span = (5.2, 6.2)
    figure, ((left, right),) = style.panels(1, 2, 3.5, sharex=True, sharey=True)
    levels = [_invariant(u, 2.0) for u in (1.5, 2.0, 2.75, 3.5, 4.25)]
    for axes in (left, right):
        _level_curves(axes, levels, span)
        axes.plot(1, 2, "k+", markersize=6)
        axes.set(xlim=(0, span[0]), ylim=(0, span[1]), xlabel="$u$ (predators)")
    left.set_ylabel("$v$ (prey)")
    u, v = (x.reshape(-1, 1) for x in np.meshgrid(np.linspace(0.2, 5.0, 17), np.linspace(0.2, 6.0, 19)))
    du, dv = system.observe(system.dq[0], u, v), system.observe(system.dp[0], u, v)
    speed = np.hypot(du, dv)
    left.quiver(
        u[:, 0], v[:, 0], du / speed, dv / speed, color=style.BLUE, scale=26, width=0.0032, pivot="mid", angles="xy"
    )
    left.set_title("vector field")
    snapshots, spacing, substeps = 4, 0.9, 300
    disc = measure.circle((3.0, 2.0), 0.4, 128 if quick else 256)
    sets = measure.carry(measure.start("lotka-volterra"), "rk4", disc, spacing / substeps, snapshots, substeps)
    for k, points in enumerate(sets):
        right.fill(
            *points.T, facecolor=style.ORANGE if k == 0 else style.SKY, edgecolor="black", linewidth=0.8, alpha=0.85
        )
        inward = np.array([1.0, 2.0]) - points
        nearest = np.argmin(np.hypot(*inward.T))
        offset = 10 * inward[nearest] / np.hypot(*inward[nearest])
        right.annotate(
            f"{k * spacing:g}",
            points[nearest],
            offset,
            textcoords="offset points",
            ha="center",
            va="center",
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.4},
        )
    right.set_title("exact flow of a disc, at the times shown")
    plain = np.abs([measure.enclosed_area(s) for s in sets])
    measured = np.abs([measure.enclosed_area(np.log(s)) for s in sets])
    caption = (
        "Lotka-Volterra: the vector field's direction (left) and a disc carried by the flow to "
        f"t = {snapshots * spacing:g} (right; classical Runge-Kutta method, h = {number(spacing / substeps)}), over "
        f"level curves of I = ln u - u + 2 ln v - v. The disc's area goes from {number(plain[0], 6)} to "
        f"{number(plain[-1], 6)}; its measure du dv/(uv), {number(measured[0], 10)}, changes by at most "
        f"{number(np.abs(measured - measured[0]).max(), 2)}."
    )
    return figure, caption


@style.drawn
def numerical_flow(quick: bool):
    """The four methods from the talk's starting points."""
    steps = 60 if quick else 120
    figure, grid = style.panels(2, 2, 5.2)
    parts, solutions = [], []
    for axes, (title, id, orbits) in zip(grid.flat, RUNS, strict=True):
        starts = [measure.start(f"lotka-volterra:{orbit}") for orbit in orbits]
        runs = [measure.run(start, id, STEP, steps * STEP) for start in starts]
        for k, (start, s) in enumerate(zip(starts, runs, strict=True)):
            exact = measure.run(start, "rk4", STEP / 50, steps * STEP)
            axes.plot(exact.q, exact.p, color=style.GREY, linewidth=1.2)
            colour, _, marker = style.CURVES[k]
            name = start.start.about
            axes.plot(s.q, s.p, color=colour, marker=marker, linewidth=0.4, markersize=2.4, label=name)
            axes.plot(s.q[0], s.p[0], color="black", marker="*", markersize=8, linestyle="none")
            values = start.system.observe(start.system.H, s.q, s.p)
            change, largest = values[-1] - values[0], np.abs(values - values[0]).max()
            parts.append(f"{title} {name} {number(change)} at the end, {number(largest)} at most")
        solutions += runs
        axes.set(xlim=(0, None), ylim=(0, None), title=title, xlabel="$u$ (predators)", ylabel="$v$ (prey)")
        axes.legend(loc="upper right")
    caption = (
        f"Numerical flow of Lotka-Volterra, {steps} steps of h = {STEP:g} to t = {number(steps * STEP)}, from the "
        f"stars; grey: the exact flow (classical Runge-Kutta method, h = {number(STEP / 50)}). Change of the invariant "
        f"I: {'; '.join(parts)}.{measure.troubles(solutions)}"
    )
    return figure, caption


FIGURES = (
    Figure("lotka-volterra-flow", "Lotka-Volterra: vector field and exact flow", SECTION, exact_flow),
    Figure("lotka-volterra-methods", "Lotka-Volterra: numerical flow of four methods", SECTION, numerical_flow),
)
