r"""Figures of Lotka-Volterra, u' = u (v - 2), v' = v (1 - u): vector field, exact flow, numerical flow of four methods.

Every solution lies on a level curve of :math:`I = \ln u - u + 2\ln v - v`.  The flow keeps the measure
:math:`\iint du\,dv/(uv)`, the area in the plane (ln u, ln v), where the system is canonical.

Source: talk on symplectic integration, 'Numerical experiments' (h = 0.12 and the starting points); E. Hairer,
C. Lubich, G. Wanner, Geometric Numerical Integration (2006), I.1.1 and VI.2.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks import style
from phasebench.benchmarks.store.arrays import unpack
from phasebench.benchmarks.style import number

from . import measure
from .measure import Figure

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

STEP = 0.12
#: Number of images of the disc, time between them, steps between them.
SNAPSHOTS, SPACING, SUBSTEPS = 4, 0.9, 300
#: The exact flow is computed by the classical Runge-Kutta method with the step divided by this.
FINER = 50
#: (title, method id, orbits from the talk's starting points); its symplectic Euler is implicit in u, explicit in v.
RUNS = (
    ("explicit Euler", "explicit-euler", ("2-2",)),
    ("implicit Euler", "implicit-euler", ("4-8",)),
    ("symplectic Euler", "symplectic-euler-q", ("4-2", "6-2")),
    ("implicit midpoint", "implicit-midpoint", ("4-2", "2-2")),
)


def _level_curves(axes: Axes, levels: Iterable[float], span: tuple[float, float]) -> None:
    system = measure.start("lotka-volterra").system
    u, v = np.meshgrid(np.linspace(0.02, span[0], 220), np.linspace(0.02, span[1], 220))
    invariant = system.observe(system.H, u.reshape(-1, 1), v.reshape(-1, 1)).reshape(u.shape)
    axes.contour(u, v, invariant, levels=sorted(levels), colors=style.GREY, linewidths=0.8, linestyles="solid")


def _invariant(u: float, v: float) -> float:
    system = measure.start("lotka-volterra").system
    return float(system.observe(system.H, [[u]], [[v]])[0])


def _measure_flow() -> list[dict]:
    disc = measure.circle((3.0, 2.0), 0.4, 256)
    sets = measure.carry(measure.start("lotka-volterra"), "rk4", disc, SPACING / SUBSTEPS, SNAPSHOTS, SUBSTEPS)
    return [
        measure.row(
            "disc",
            f"{k * SPACING:g}",
            *points.T,
            area=abs(measure.enclosed_area(points)),
            measure=abs(measure.enclosed_area(np.log(points))),
        )
        for k, points in enumerate(sets)
    ]


def _measure_methods() -> list[dict]:
    t_end = 120 * STEP
    rows = []
    for title, id, orbits in RUNS:
        for orbit in orbits:
            start = measure.start(f"lotka-volterra:{orbit}")
            exact = measure.run(start, "rk4", STEP / FINER, t_end)
            path = measure.thin_path(np.hstack([exact.q, exact.p]), n=400)
            rows.append(measure.row(title, "exact flow", *path.T, exact))
            s = measure.run(start, id, STEP, t_end)
            values = start.system.observe(start.system.H, s.q, s.p) - _invariant(*s.q[0], *s.p[0])
            change = {"end": values[-1], "energy_error": np.abs(values).max()}
            rows.append(measure.row(title, start.start.about, s.q, s.p, s, **change))
    return rows


def _disc(axes: Axes, k: int, name: str, points: np.ndarray) -> None:
    """The k-th image of a disc under the flow, boundary ``points`` (n, 2), with the text ``name`` beside it."""
    colour = style.ORANGE if k == 0 else style.SKY
    axes.fill(*points.T, facecolor=colour, edgecolor="black", linewidth=0.8, alpha=0.85)
    inward = np.array([1.0, 2.0]) - points
    nearest = np.argmin(np.hypot(*inward.T))
    offset = 10 * inward[nearest] / np.hypot(*inward[nearest])
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.4}
    middle = {"ha": "center", "va": "center", "bbox": box}
    axes.annotate(name, points[nearest], offset, textcoords="offset points", **middle)


@style.styled
def exact_flow(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """The Lotka-Volterra field, and images of a disc under its flow, with level curves."""
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
    for k, r in enumerate(rows.itertuples()):
        _disc(right, k, f"{float(r.curve):g}", np.stack([unpack(r.x), unpack(r.y)], axis=1))
    right.set_title("exact flow of a disc, at the times shown")
    first, last = rows.iloc[0], rows.iloc[-1]
    caption = (
        "Lotka–Volterra: the vector field's direction (left) and a disc carried by the flow to "
        f"t = {float(last['curve']):g} (right; classical Runge–Kutta method, h = {number(SPACING / SUBSTEPS)}), over "
        f"level curves of I = ln u - u + 2 ln v - v. The disc's area goes from {number(first['area'], 6)} to "
        f"{number(last['area'], 6)}; its measure du dv/(uv), {number(first['measure'], 10)}, changes by at most "
        f"{number(np.abs(rows['measure'] - first['measure']).max(), 2)}."
    )
    return figure, caption


@style.styled
def numerical_flow(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """Lotka-Volterra orbits of four methods from the talk's starting points."""
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
    runs = rows[~exact]
    caption = (
        f"Numerical flow of Lotka–Volterra, {int(runs['steps'].max())} steps of h = {STEP:g} to t = "
        f"{number(runs['t_end'].max())}, from the stars; grey: the exact flow (classical Runge–Kutta method, h = "
        f"{number(STEP / FINER)}).{measure.troubles(runs)}"
    )
    return figure, caption


FIGURES = (
    Figure("lotka-volterra-flow", "Vector field and exact flow", _measure_flow, exact_flow),
    Figure("lotka-volterra-methods", "Numerical flow of four methods", _measure_methods, numerical_flow),
)
