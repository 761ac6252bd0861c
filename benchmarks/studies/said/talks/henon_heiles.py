r"""Figures of Henon-Heiles: box and chaotic orbits of Schemes I, IV, V and AVF, Poincare sections, energy errors.

Scheme I is symplectic with a fixed parameter lambda; Schemes IV and V choose lambda in each step so that H is kept; AVF
is the averaged vector field method.

Source: Y. Wang, Y. Bo, W. Cai, "A general symplectic integrator for canonical Hamiltonian systems" (talk), 'The
Henon-Heiles model'; M. Henon, C. Heiles, Astron. J. 69 (1964) 73-79 (the section q1 = 0).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks import style
from phasebench.benchmarks.store.arrays import unpack

from . import measure
from .measure import LAMBDAS, Figure

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.solution import Solution

#: Orbit -> half width of the drawn square in the (q1, q2) plane.
ORBITS = {"box": 0.26, "chaotic": 1.05}
STEP = 0.02
#: End of the runs.
END = 1000.0
#: Orbits are drawn up to this time; later they only cover the same region again.
DRAWN = 400.0
#: |H - H0| from which an orbit counts as having left the well, and is not drawn; the chaotic one starts near the
#: escape energy.
ESCAPED = 1.0
#: Curve label -> (method id, parameters).
SCHEME_I = {f"λ = {lam}": ("scheme-i", {"lam": lam}) for lam in LAMBDAS}
PRESERVING = {"AVF": ("avf", {}), "Scheme IV": ("scheme-iv", {}), "Scheme V": ("scheme-v", {})}


def _runs(methods: Mapping[str, tuple[str, dict]], t_end: float) -> Iterator[tuple[str, str, Problem, Solution]]:
    """Yield (orbit, curve label, problem, solution) of every method on both Henon-Heiles orbits, box and chaotic."""
    for orbit in ORBITS:
        start = measure.start(f"henon-heiles:{orbit}")
        for label, (id, parameters) in methods.items():
            yield orbit, label, start, measure.run(start, id, STEP, t_end, **parameters)


def _measure_orbits(methods: Mapping[str, tuple[str, dict]]) -> list[dict]:
    rows = []
    for orbit, label, start, s in _runs(methods, END):
        inside = np.abs(s.q).max(axis=1) < 10 * ORBITS[orbit]  # an escaping orbit is cut off outside the frame
        path = measure.thin_path(s.q[inside], until=round(DRAWN / STEP))
        error = measure.energy_error(start, s).max()
        rows.append(measure.row(orbit, label, *path.T, s, energy_error=error))
    return rows


def _measure_energies(methods: Mapping[str, tuple[str, dict]]) -> list[dict]:
    rows = []
    for orbit, label, start, s in _runs(methods, END):
        error = measure.energy_error(start, s)
        t, e = measure.binned_maxima(s.t, error)
        rows.append(measure.row(orbit, label, t, e, s, energy_error=error.max()))
    return rows


def _measure_sections() -> list[dict]:
    rows = []
    for orbit, label, start, s in _runs(SCHEME_I, 8000.0):
        crossings = measure.section(start, s)
        rows.append(measure.row(orbit, label, *crossings.T, s, crossings=len(crossings)))
    return rows


def _span(rows: pd.DataFrame) -> str:
    return f"to t = {rows['t_end'].max():g}, h = {rows['h'].iloc[0]:g}"


def _boundary(axes: Axes, orbit: str, reach: float) -> None:
    """The curve U(q) = H0, which no orbit of that energy crosses, in the square |q1|, |q2| <= ``reach``."""
    start = measure.start(f"henon-heiles:{orbit}")
    system = start.system
    q = np.stack([x.ravel() for x in np.meshgrid(*2 * [np.linspace(-reach, reach, 241)])], axis=1)
    U = system.observe(system.potential, q, 0 * q).reshape(241, 241)
    H0 = system.observe(system.H, [start.q0], [start.p0])[0]
    axes.contour(*(q[:, i].reshape(241, 241) for i in (0, 1)), U, levels=[H0], colors=style.VERMILION, linewidths=1.0)


def _grid(rows: pd.DataFrame, height: float) -> tuple[Drawing, list[tuple[Axes, Any]], np.ndarray]:
    """A figure with a line of panels for each orbit and a column for each curve; ``height`` is in inches."""
    figure, grid = style.panels(2, rows["curve"].nunique(), height, sharex="row", sharey="row")
    return figure, list(zip(grid.flat, rows.itertuples(), strict=True)), grid[:, 0]


def _draw_orbits(rows: pd.DataFrame, methods: str, height: float) -> tuple[Drawing, str]:
    figure, panels, left = _grid(rows, height)
    for axes, r in panels:
        reach = ORBITS[r.panel]
        axes.plot(unpack(r.x), unpack(r.y), color=style.BLUE, linewidth=0.25)
        _boundary(axes, r.panel, 1.2 * reach)
        axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", title=f"{r.panel}, {r.curve}")
        axes.set_xlabel("$q_1$")
    for axes in left:
        axes.set_ylabel("$q_2$")
    caption = (
        f"Hénon–Heiles, box (above) and chaotic orbits of {methods} {_span(rows)}, drawn to t = "
        f"{min(DRAWN, rows['t_end'].max()):g}; red: the curve U(q) = H0, which the exact flow does not cross."
        f"{measure.troubles(rows)}"
    )
    return figure, caption


@style.styled
def scheme_i_orbits(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """The box and chaotic Henon-Heiles orbits of Scheme I."""
    return _draw_orbits(rows, "Scheme I", 4.2)


@style.styled
def preserving_orbits(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """The box and chaotic Henon-Heiles orbits of energy-preserving methods."""
    return _draw_orbits(rows, "AVF, Schemes IV and V", 5.1)


@style.styled
def sections(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """The Poincare sections of Scheme I's orbits on Henon-Heiles."""
    figure, panels, left = _grid(rows, 4.2)
    for axes, r in panels:
        look = {"linestyle": "none", "marker": ".", "markersize": 2.4, "markeredgewidth": 0, "color": style.BLUE}
        axes.plot(unpack(r.x), unpack(r.y), **look)
        axes.set(title=f"{r.panel}, {r.curve}", xlabel="$q_2$")
    for axes in left:
        axes.set_ylabel("$p_2$")
    counts = "; ".join(
        f"{orbit} {', '.join(str(int(n)) for n in part['crossings'])}"
        for orbit, part in rows.groupby("panel", sort=False)
    )
    caption = (
        f"Hénon–Heiles, Poincaré section q_1 = 0, p_1 > 0 of Scheme I's orbits {_span(rows)}. Crossings for "
        f"{', '.join(rows['curve'].unique())}: {counts}.{measure.troubles(rows)}"
    )
    return figure, caption


def _draw_energies(rows: pd.DataFrame, methods: str) -> tuple[Drawing, str]:
    """|H - H0| over t, a panel for each orbit, a curve for each of ``rows``."""
    figure, grid = style.panels(2, 1, 4.4, sharex=True)
    errors = []
    for axes, orbit in zip(grid[:, 0], ORBITS, strict=True):
        for k, r in enumerate(rows[rows["panel"] == orbit].itertuples()):
            t, e = unpack(r.x), unpack(r.y)
            e = np.where(e < ESCAPED, e, np.nan)
            axes.semilogy(t, measure.for_log_axis(e), label=r.curve, **style.curve(k, len(t)))
            errors.append(e)
        style.decades(axes)
        axes.set(ylabel="$|H - H_0|$", title=f"{orbit} orbit", xlim=(0, rows["t_end"].max()))
    grid[-1, 0].set_xlabel("$t$")
    figure.align_ylabels()
    style.legend_above(figure, grid[0, 0], rows["curve"].nunique())
    caption = (
        f"Hénon–Heiles, energy error of {methods} {_span(rows)}; each curve joins the maxima of 200 equal pieces of "
        f"time.{measure.floor_note(errors)}{measure.troubles(rows)}"
    )
    return figure, caption


@style.styled
def scheme_i_energy(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """The energy error of Scheme I on Henon-Heiles over time."""
    return _draw_energies(rows, "Scheme I")


@style.styled
def preserving_energy(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """The energy errors of energy-preserving methods over time on Henon-Heiles."""
    return _draw_energies(rows, "AVF, Schemes IV and V")


FIGURES = (
    Figure(
        "henon-heiles-scheme-i-orbits",
        "Orbits of Scheme I",
        partial(_measure_orbits, SCHEME_I),
        scheme_i_orbits,
    ),
    Figure("henon-heiles-scheme-i-sections", "Poincaré sections of Scheme I", _measure_sections, sections),
    Figure(
        "henon-heiles-scheme-i-energy",
        "Energy error of Scheme I",
        partial(_measure_energies, SCHEME_I),
        scheme_i_energy,
    ),
    Figure(
        "henon-heiles-preserving-orbits",
        "Orbits of AVF, Schemes IV and V",
        partial(_measure_orbits, PRESERVING),
        preserving_orbits,
    ),
    Figure(
        "henon-heiles-preserving-energy",
        "Energy error of AVF, Schemes IV and V",
        partial(_measure_energies, PRESERVING),
        preserving_energy,
    ),
)
