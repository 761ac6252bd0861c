"""Figures of the page on limits of methods, and its table."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Data, Picture, Table, of
from phasebench.integrators.registry import BY_ID

from . import encounters, limits, maps, push, round_off
from .curves import best, curves, legend_below

#: Number of methods in the figure of stable intervals, and the end of its axis.
BARS, LAST = 26, 10.0
#: The runs in the figure of round-off: label and step size.
GROWING = (
    ("stormer-verlet", round_off.STEP),
    ("stormer-verlet", round_off.DECIMAL),
    ("stormer-verlet", round_off.DECIMAL * round_off.ASIDE),
    (f"scheme-i(lam={round_off.THIRD})", round_off.STEP),
    (f"scheme-i(lam={round_off.BESIDE})", round_off.STEP),
    ("gauss-2", round_off.STEP),
    (round_off.WHOLE, round_off.DECIMAL),
    (round_off.PLAIN, round_off.STEP),
    (round_off.KEPLER, round_off.H),
)
#: The orbits in the table, and their column headings.
SHOWN = {
    "pendulum": "pendulum",
    "Henon-Heiles, box": "H-H box",
    "Henon-Heiles, at escape": "H-H at escape",
    "Kepler, e = 0.6": "Kepler",
}


def draw(data: Data, folder: Path) -> list[Picture]:
    """The figures of all tables that have rows."""
    pictures = [figure(data, folder) for figure in FIGURES]
    return [picture for picture in pictures if picture is not None]


def pieces(text: str | float) -> list[tuple[float, float]]:
    """Intervals stored as text, "a..b c..", as pairs (a, b); an open end is infinite."""
    parts = [] if not isinstance(text, str) else [part.partition("..")[::2] for part in text.split()]
    return [(float(a), float(b) if b else math.inf) for a, b in parts]


@of(limits.LINEAR)
@style.styled
def intervals(rows: pd.DataFrame, folder: Path) -> Picture:
    """The stable intervals of h omega, for the methods with the most gaps between them."""
    known = rows[rows["intervals"].notna() & np.isfinite(rows["limit"]) & ~rows["label"].str.contains("lam=")]
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


@of(encounters.KEPLER)
@style.styled
def encounter_errors(rows: pd.DataFrame, folder: Path) -> Picture:
    """Each integrator's error on Kepler orbits over 1 - e, e the eccentricity."""
    figure, (panels,) = style.panels(1, 2, 4.0, sharey=True)
    rows = rows.assign(near=1 - rows["e"])
    for axes, fixed in zip(panels, (True, False), strict=True):
        part = rows[(rows["kind"] == encounters.FIXED_STEPS) == fixed]
        curves(axes, part, "method", "near", "error", best(part, worst=True), (1e-16, 10))
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


@of(maps.STIFFNESS)
@style.styled
def stiffness(rows: pd.DataFrame, folder: Path) -> Picture:
    """The largest change of the oscillatory energy of the Fermi-Pasta-Ulam problem over h omega."""
    omegas = sorted(rows["omega"].unique())
    omegas = omegas[1::2] or omegas
    figure, (panels,) = style.panels(1, len(omegas), 3.4, sharey=True)
    for axes, omega in zip(panels, omegas, strict=True):
        curves(axes, rows[rows["omega"] == omega], "method", "h omega", "I changes", span=(1e-12, 1e2))
        axes.axhline(maps.CLIFF, color=style.GREY, linewidth=0.8)
        axes.set(title=f"ω = {omega:g}", xlabel="h ω")
    panels[0].set_ylabel("largest change of I / I₀")
    style.legend_above(figure, panels[0], 4)
    caption = (
        f"FPU: the largest change of the oscillatory energy in {maps.STEPS} steps; grey: {maps.CLIFF:g}, the cliff."
    )
    return Picture(style.save(figure, folder, "extremes-stiffness.png"), "stiffness", caption)


@of(round_off.CURVES)
@style.styled
def growth(rows: pd.DataFrame, folder: Path) -> Picture:
    """The rms round-off errors of energy and phase over the number of steps."""
    figure, (panels,) = style.panels(1, 2, 3.8)
    beside = round_off.DECIMAL * round_off.ASIDE
    drawn = {(label, h): f"{label}, h = {h:.3g}{' (1 + 2^-40)' if h == beside else ''}" for label, h in GROWING}
    runs = [drawn.get(run) for run in zip(rows["label"], rows["h"], strict=True)]
    rows = rows.assign(run=runs)[rows["steps"] < round_off.LONG].dropna(subset="run")
    for axes, name, law in zip(panels, ("energy", "phase"), (round_off.ENERGY, round_off.PHASE), strict=True):
        curves(axes, rows, "run", "n", name, list(drawn.values()))
        n = np.array([rows["n"].min(), rows["n"].max()], float)
        axes.loglog(n, round_off.EPS * round_off.STEP * n**law, color=style.GREY, linestyle=":")
        axes.set(xlabel="steps", title=f"{name}: dotted, ε h n^{law:g}")
    panels[0].set_ylabel("rms error over the starts")
    style.legend_above(figure, panels[0], 2)
    caption = (
        f"Round-off of {round_off.STARTS} starts, on the oscillator where nothing else is said: Brouwer's law and what "
        "is measured. Only where the frequency depends on the energy does the phase's grow as n^1.5; next to fractions "
        "of small denominators it drifts."
    )
    return Picture(style.save(figure, folder, "extremes-growth.png"), "growth of round-off", caption)


@of(maps.SOLVERS)
@style.styled
def solvers(rows: pd.DataFrame, folder: Path) -> Picture:
    """How implicit equations were solved, or not, over h and a method's lambda or the eccentricity e."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    known = [maps.FIXED_POINT, maps.NEWTON, maps.MISSED, maps.LOST, "no-root", "not-converged", "collision"]
    known += [x for x in dict.fromkeys(rows["outcome"]) if x not in known]
    colours = [style.SKY, style.GREEN, style.YELLOW, style.ORANGE, style.PURPLE, style.VERMILION, style.BLACK]
    colours += [style.GREY] * (len(known) - len(colours))
    look = {"cmap": ListedColormap(colours), "vmin": -0.5, "vmax": len(known) - 0.5}
    parts = rows.groupby(["method", "over"], sort=False)
    figure, (panels,) = style.panels(1, len(parts), 2.8)
    for axes, ((id, over), part) in zip(panels, parts, strict=True):
        grid = part.assign(code=part["outcome"].map(known.index)).pivot(index="value", columns="h", values="code")
        axes.pcolormesh(grid.columns, grid.index, grid.to_numpy(), **look)
        axes.set(xscale="log", xlabel="h", title=id, ylabel="λ" if over == "lam" else over)
    used = [k for k in known if k in set(rows["outcome"])]
    handles = [Patch(color=colours[known.index(k)], label=k) for k in used]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(used))
    caption = f"How {maps.SHORT} steps go: the pendulum over (h, λ), Kepler over (h, e)."
    return Picture(style.save(figure, folder, "extremes-solvers.png"), "solvers at the edge", caption)


@of(push.SWEPT)
@style.styled
def lambdas(rows: pd.DataFrame, folder: Path) -> Picture:
    """The largest surviving step of Schemes I to III over their parameter lambda, a panel for each orbit."""
    orbits = list(dict.fromkeys(rows["orbit"]))
    figure, (panels,) = style.panels(1, len(orbits), 2.8, sharey=True)
    for axes, orbit in zip(panels, orbits, strict=True):
        part = rows[rows["orbit"] == orbit]
        curves(axes, part.replace({"largest h": {0: np.nan, np.inf: np.nan}}), "method", "lam", "largest h")
        axes.set_xscale("symlog", linthresh=1)
        axes.set(yscale="log", xlabel="λ", title=orbit)
    panels[0].set_ylabel("largest h")
    style.legend_above(figure, panels[0], 3)
    caption = "The largest step of Schemes I to III that survives, over λ from −1000 to 1000."
    return Picture(style.save(figure, folder, "extremes-lambda.png"), "largest steps over lambda", caption)


@of(maps.RESONANCES)
@style.styled
def resonances(rows: pd.DataFrame, folder: Path) -> Picture:
    """A step's growth factor over the two frequencies of coupled oscillators."""
    methods = list(dict.fromkeys(rows["method"]))
    figure, (panels,) = style.panels(1, len(methods), 2.3, sharey=True)
    for axes, id in zip(panels, methods, strict=True):
        part = rows[rows["method"] == id].sort_values(["ratio", "h omega 2"])
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


@of(maps.REGIONS)
@style.styled
def regions(rows: pd.DataFrame, folder: Path) -> Picture:
    """The boundaries |R(z)| = 1 of the stability regions of Runge-Kutta methods in the complex plane."""
    x, y = np.meshgrid(np.linspace(-7.5, 12, 391), np.linspace(0, 8, 161))
    z = x + 1j * y
    figure, ((axes,),) = style.panels(1, 1, 3.0)
    for look, row in zip(style.looks(), rows.itertuples(), strict=False):
        above, below = ([float(c) for c in text.split()] for text in (str(row.above), str(row.below)))
        size = np.abs(np.polyval(above, z) / np.polyval(below, z))
        axes.contour(x, y, size, levels=[1.0], colors=[look["color"]], linestyles=[look["linestyle"]])
        axes.plot([], [], color=look["color"], linestyle=look["linestyle"], label=row.method)
    axes.axvline(0, color=style.GREY, linewidth=0.6)
    axes.set(xlabel="Re z", ylabel="Im z", aspect="equal")
    style.legend_above(figure, axes, 3)
    caption = (
        "Boundaries |R(z)| = 1 of Runge-Kutta methods: stable within the curve of an explicit method, outside "
        "that of a Radau method, left of the axis for Gauss; the upper half plane."
    )
    return Picture(style.save(figure, folder, "extremes-regions.png"), "stability regions", caption)


FIGURES = (intervals, encounter_errors, stiffness, growth, solvers, lambdas, resonances, regions)


def reach(rows: pd.DataFrame) -> pd.Series:
    """The largest eccentricity up to which an integrator's error on Kepler's orbits is small; 0 if none, by method."""
    ordered = rows.sort_values("e")
    held = ordered["held"].astype(bool).groupby(ordered["method"]).cummin()
    return ordered["e"].where(held, 0.0).groupby(ordered["method"]).max().reindex(rows["method"].unique())


def _text(values: pd.Series, endless: str, digits: int) -> str:
    """The first of the values as text, ``endless`` if it is infinite; "" if there is none."""
    if values.empty or pd.isna(values.iloc[0]):
        return ""
    return endless if values.iloc[0] == np.inf else number(float(values.iloc[0]), digits)


@of(limits.LINEAR, push.TABLE, encounters.KEPLER, round_off.CHOSEN)
def table(linear: pd.DataFrame, steps: pd.DataFrame, met: pd.DataFrame, grown: pd.DataFrame) -> Table:
    """How far each representative method goes in every test, and how it fails."""
    worst, out = reach(met), []
    for id in (*push.REPRESENTATIVE, *encounters.step_changing_methods()):
        row = {"method": id, "limit of h ω": _text(linear.loc[linear["method"] == id, "limit"], "none", 5)}
        own = steps[steps["method"] == id]
        row |= {head: _text(own.loc[own["orbit"] == orbit, "largest h"], "any", 2) for orbit, head in SHOWN.items()}
        row["largest e"] = f"{worst[id]:.10g}" if id in worst else ""
        same = grown[(grown["label"] == BY_ID[id].label) & (grown["h"] == round_off.STEP)]
        power = same["energy exponent"].dropna()
        row["round-off"] = f"{power.iloc[0]:.2f}" if len(power) else ""
        fails = Counter(x for x in own["fails"] if isinstance(x, str) and x)
        out.append(row | {"how it fails": ", ".join(name for name, _ in fails.most_common(2))})
    caption = (
        f"How far each method goes: the stability limit of h ω; the largest h that survives {push.STEPS} steps on four "
        f"orbits (H-H: Hénon–Heiles); the largest e of Kepler's orbit held to {encounters.HELD:g} over "
        f"{encounters.ORBITS} periods (0: not even {encounters.ECCENTRICITIES[0]:g}; empty: not run); the power of n "
        f"in the energy's round-off at h = {round_off.STEP:.3g}; the commonest failures."
    )
    return Table(pd.DataFrame(out).head(ROWS), caption)
