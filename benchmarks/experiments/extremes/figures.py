"""Figures on the limits of methods: stability, close encounters, stiffness, round-off, implicit solvers, resonances."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.page import Picture

from . import brouwer, brouwer_kepler, edge, encounters, stiff
from . import brouwer_controls as controls

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

#: Number of methods in the figure of stable intervals, and the end of its axis.
BARS, LAST = 26, 10.0
#: The runs in the figure of round-off: label and step size.
GROWING = (
    ("stormer-verlet", brouwer.PLAIN),
    ("stormer-verlet", brouwer.DECIMAL),
    ("stormer-verlet", brouwer.DECIMAL * brouwer.ASIDE),
    (f"scheme-i(lam={brouwer.THIRD})", brouwer.PLAIN),
    (f"scheme-i(lam={brouwer.BESIDE})", brouwer.PLAIN),
    ("gauss-2", brouwer.PLAIN),
    (controls.WHOLE, brouwer.DECIMAL),
    (brouwer.CONTROL, brouwer.PLAIN),
    (brouwer_kepler.LABEL, brouwer_kepler.H),
)


def curves(
    axes: Axes,
    table: pd.DataFrame,
    by: str,
    x: str,
    y: str,
    names: Iterable[str] | None = None,
    span: tuple[float | None, float | None] = (None, None),
) -> None:
    """Draw y over x on logarithmic axes, a curve for each name in the column ``by``, as many as there are line styles.

    ``names`` selects the names and their order; values of y beyond ``span`` (low, high) are drawn at its ends.
    """
    for look, name in zip(style.looks(), dict.fromkeys(table[by] if names is None else names), strict=False):
        rows = table[table[by] == name].sort_values(x)
        axes.loglog(rows[x], rows[y].clip(*span), label=name, **look)


def best(table: pd.DataFrame, by: str, value: str, worst: bool = False) -> list:
    """Return the names in the column ``by``, sorted by their least ``value`` (with ``worst`` by their largest)."""
    groups = table.groupby(by)[value]
    return list((groups.max() if worst else groups.min()).sort_values().index)


def legend_below(axes: Axes) -> None:
    """Add a legend of a panel's own curves below it, as wide as the panel's share of the figure."""
    make = partial(axes.legend, *axes.get_legend_handles_labels(), loc="upper center", bbox_to_anchor=(0.5, -0.2))
    style.fit_legend(make, 2, axes.figure.bbox.width / axes.get_subplotspec().get_gridspec().ncols)


def pieces(text: str | float) -> list[tuple[float, float]]:
    """Parse intervals stored as text, "a..b c..", into pairs (a, b); an open end is infinite."""
    parts = [] if not isinstance(text, str) else [part.partition("..")[::2] for part in text.split()]
    return [(float(a), float(b) if b else math.inf) for a, b in parts]


@style.styled
def intervals(linear: pd.DataFrame, folder: Path) -> Picture:
    """Draw the stable intervals of h omega, for the methods with the most gaps between them."""
    known = linear[linear["intervals"].notna() & np.isfinite(linear["limit"]) & ~linear["label"].str.contains("lam=")]
    shown = known.sort_values(["gaps", "limit"], ascending=False).head(BARS).sort_values("limit")
    figure, ((axes,),) = style.panels(1, 1, 4.4)
    for k, row in enumerate(shown.itertuples()):
        spans = [(a, min(b, LAST) - a) for a, b in pieces(row.intervals) if a < LAST]
        axes.broken_barh(spans, (k - 0.35, 0.7), color=style.BLUE if row.symplectic else style.ORANGE)
    axes.set_yticks(range(len(shown)), shown["label"])
    axes.set(xlabel="h ω", xlim=(0, LAST))
    caption = (
        "Stable steps on the harmonic oscillator of the methods with the most gaps between stable intervals; blue: "
        "symplectic, orange: not. The first gap of some is narrower than a line."
    )
    return Picture(style.save(figure, folder, "extremes-intervals.png"), "stable steps", caption)


@style.styled
def encounter_errors(table: pd.DataFrame, folder: Path) -> Picture:
    """Draw each integrator's error on Kepler orbits over 1 - e, e the eccentricity."""
    figure, (panels,) = style.panels(1, 2, 4.0, sharey=True)
    table = table.assign(near=1 - table["e"])
    for axes, fixed in zip(panels, (True, False), strict=True):
        part = table[(table["kind"] == "fixed") == fixed]
        curves(axes, part, "method", "near", "error", best(part, "method", "error", worst=True), (1e-16, 10))
        axes.axhline(encounters.HELD, color=style.GREY, linewidth=0.8)
        axes.invert_xaxis()
        axes.set(title="fixed steps" if fixed else "adaptive or transformed", xlabel="1 − e")
        legend_below(axes)
    panels[0].set_ylabel("relative error")
    caption = (
        f"Kepler, {encounters.ORBITS} orbits: the first error below {encounters.HELD:g}, else the least, on a ladder "
        "of steps or tolerances; what is lost altogether stands at the top. At most nine integrators a panel."
    )
    return Picture(style.save(figure, folder, "extremes-encounters.png"), "close encounters", caption)


@style.styled
def stiffness(table: pd.DataFrame, folder: Path) -> Picture:
    """Draw the largest change of the oscillatory energy of the Fermi-Pasta-Ulam problem over h omega."""
    omegas = sorted(table["omega"].unique())
    omegas = omegas[1::2] or omegas
    figure, (panels,) = style.panels(1, len(omegas), 3.4, sharey=True)
    for axes, omega in zip(panels, omegas, strict=True):
        curves(axes, table[table["omega"] == omega], "method", "h omega", "I changes", span=(1e-12, 1e2))
        axes.axhline(stiff.CLIFF, color=style.GREY, linewidth=0.8)
        axes.set(title=f"ω = {omega:g}", xlabel="h ω")
    panels[0].set_ylabel("largest change of I / I₀")
    style.legend_above(figure, panels[0], 4)
    caption = (
        f"FPU: the largest change of the oscillatory energy in {stiff.STEPS} steps; grey: {stiff.CLIFF:g}, the cliff."
    )
    return Picture(style.save(figure, folder, "extremes-stiffness.png"), "stiffness", caption)


@style.styled
def growth(table: pd.DataFrame, folder: Path) -> Picture:
    """Draw the rms round-off errors of energy and phase over the number of steps."""
    figure, (panels,) = style.panels(1, 2, 3.8)
    drawn = {run: _run_name(*run) for run in GROWING}
    runs = [drawn.get(run) for run in zip(table["label"], table["h"], strict=True)]
    table = table.assign(run=runs)[table["steps"] < brouwer.LONG].dropna(subset="run")
    for axes, name, law in zip(panels, ("energy", "phase"), (0.5, 1.5), strict=True):
        curves(axes, table, "run", "n", name, list(drawn.values()))
        n = np.array([table["n"].min(), table["n"].max()], float)
        axes.loglog(n, brouwer.EPS * brouwer.PLAIN * n**law, color=style.GREY, linestyle=":")
        axes.set(xlabel="steps", title=f"{name}: dotted, ε h n^{law:g}")
    panels[0].set_ylabel("rms error over the starts")
    style.legend_above(figure, panels[0], 2)
    caption = (
        f"Round-off of {brouwer.STARTS} starts, on the oscillator where nothing else is said: Brouwer's law and what "
        "is measured. Only where the frequency depends on the energy does the phase's grow as n^1.5; next to fractions "
        "of small denominators it drifts."
    )
    return Picture(style.save(figure, folder, "extremes-growth.png"), "growth of round-off", caption)


def _run_name(label: str, h: float) -> str:
    beside = h == brouwer.DECIMAL * brouwer.ASIDE
    return f"{label}, h = {h:.3g}{' (1 + 2^-40)' if beside else ''}"


@style.styled
def solvers(table: pd.DataFrame, folder: Path) -> Picture:
    """Draw maps of how implicit equations were solved, or not, over h and a method's lambda or the eccentricity e."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    known = [edge.FIXED_POINT, edge.NEWTON, edge.MISSED, edge.LOST, "no-root", "not-converged", "collision"]
    known += [x for x in dict.fromkeys(table["outcome"]) if x not in known]
    colours = [style.SKY, style.GREEN, style.YELLOW, style.ORANGE, style.PURPLE, style.VERMILION, style.BLACK]
    colours += [style.GREY] * (len(known) - len(colours))
    maps = list(dict.fromkeys(zip(table["method"], table["over"], strict=True)))
    figure, (panels,) = style.panels(1, len(maps), 2.8)
    for axes, (id, over) in zip(panels, maps, strict=True):
        part = table[(table["method"] == id) & (table["over"] == over)]
        grid = part.assign(code=part["outcome"].map(known.index)).pivot(index="value", columns="h", values="code")
        axes.pcolormesh(
            grid.columns, grid.index, grid.to_numpy(), cmap=ListedColormap(colours), vmin=-0.5, vmax=len(known) - 0.5
        )
        axes.set(xscale="log", xlabel="h", title=id, ylabel="λ" if over == "lam" else over)
    used = [k for k in known if k in set(table["outcome"])]
    handles = [Patch(color=colours[known.index(k)], label=k) for k in used]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(used))
    caption = f"How {edge.STEPS} steps go: the pendulum over (h, λ), Kepler over (h, e)."
    return Picture(style.save(figure, folder, "extremes-solvers.png"), "solvers at the edge", caption)


@style.styled
def resonances(table: pd.DataFrame, folder: Path) -> Picture:
    """Draw maps of a step's growth factor over the two frequencies of coupled oscillators."""
    methods = list(dict.fromkeys(table["method"]))
    figure, (panels,) = style.panels(1, len(methods), 2.3, sharey=True)
    for axes, id in zip(panels, methods, strict=True):
        part = table[table["method"] == id].sort_values(["ratio", "h omega 2"])
        shape = (part["ratio"].nunique(), -1)
        x, y, radius = (part[c].to_numpy().reshape(shape) for c in ("h omega 1", "h omega 2", "radius"))
        grows = np.log10(np.clip(radius - 1, 1e-12, 1e2))
        for first, second in ((x, y), (y, x)):  # the two frequencies may be exchanged
            axes.pcolormesh(first, second, grows, cmap="Greys", vmin=-9, vmax=0, shading="nearest")
        axes.set(title=id, xlabel="h ω₁", aspect="equal")
    panels[0].set_ylabel("h ω₂")
    caption = (
        "Two coupled oscillators: black where a step multiplies, white where it is stable; Stormer-Verlet ends at "
        "h ω = 2, a split coupling resonates about h (ω₁ + ω₂) = 2πk, filters take the resonances away."
    )
    return Picture(style.save(figure, folder, "extremes-resonances.png"), "two frequencies", caption)


@style.styled
def regions(table: pd.DataFrame, folder: Path) -> Picture:
    """Draw the boundaries |R(z)| = 1 of the stability regions of Runge-Kutta methods in the complex plane."""
    x, y = np.meshgrid(np.linspace(-7.5, 12, 391), np.linspace(0, 8, 161))
    z = x + 1j * y
    figure, ((axes,),) = style.panels(1, 1, 3.0)
    for look, row in zip(style.looks(), table.itertuples(), strict=False):
        above, below = ([float(c) for c in text.split()] for text in (str(row.above), str(row.below)))
        size = np.abs(np.polyval(above, z) / np.polyval(below, z))
        lines = axes.contour(x, y, size, levels=[1.0], colors=[look["color"]], linestyles=[look["linestyle"]])
        del lines
        axes.plot([], [], color=look["color"], linestyle=look["linestyle"], label=row.method)
    axes.axvline(0, color=style.GREY, linewidth=0.6)
    axes.set(xlabel="Re z", ylabel="Im z", aspect="equal")
    style.legend_above(figure, axes, 3)
    caption = (
        "Boundaries |R(z)| = 1 of Runge-Kutta methods: stable within the curve of an explicit method, outside "
        "that of a Radau method, left of the axis for Gauss; the upper half plane."
    )
    return Picture(style.save(figure, folder, "extremes-regions.png"), "stability regions", caption)


@style.styled
def lambdas(table: pd.DataFrame, folder: Path) -> Picture:
    """Draw the largest surviving step of Schemes I to III over their parameter lambda, a panel for each orbit."""
    orbits = list(dict.fromkeys(table["orbit"]))
    figure, (panels,) = style.panels(1, len(orbits), 2.8, sharey=True)
    for axes, orbit in zip(panels, orbits, strict=True):
        part = table[table["orbit"] == orbit]
        curves(axes, part.replace({"largest h": {0: np.nan, np.inf: np.nan}}), "method", "lam", "largest h")
        axes.set_xscale("symlog", linthresh=1)
        axes.set(yscale="log", xlabel="λ", title=orbit)
    panels[0].set_ylabel("largest h")
    style.legend_above(figure, panels[0], 3)
    caption = "The largest step of Schemes I to III that survives, over λ from −1000 to 1000."
    return Picture(style.save(figure, folder, "extremes-lambda.png"), "largest steps over lambda", caption)
