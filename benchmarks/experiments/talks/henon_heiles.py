r"""Henon-Heiles: box and chaotic orbits of Scheme I over lambda and of AVF, Schemes IV and V; sections; energy errors.

Source: Y. Wang, Y. Bo, W. Cai, "A general symplectic integrator for canonical Hamiltonian systems" (talk), 'The
Henon-Heiles model'; M. Henon, C. Heiles, Astron. J. 69 (1964) 73-79 (the section q1 = 0).
"""

from __future__ import annotations

import numpy as np

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.style import number

from . import measure
from .measure import LAMBDAS
from .record import Figure

SECTION = "henon-heiles"
ORBITS = ("box", "chaotic")
STEP = 0.02
#: |H - H0| of an orbit that has left the well (the chaotic one starts at the escape energy): not drawn.
ESCAPED = 1.0
ENERGY_METHODS = (("AVF", "avf"), ("Scheme IV", "scheme-iv"), ("Scheme V", "scheme-v"))
SCHEME_I = tuple((f"$\\lambda$ = {lam}", "scheme-i", {"lam": lam}) for lam in LAMBDAS)
PRESERVING = tuple((title, id, {}) for title, id in ENERGY_METHODS)


def _runs(orbit: str, methods, t_end: float):
    start = measure.start(f"henon-heiles:{orbit}")
    return start, [measure.run(start, id, STEP, t_end, **parameters) for _, id, parameters in methods]


def _largest(methods, solutions, start) -> str:
    """The largest energy error of each run, in words."""
    labels = [title.replace("$\\lambda$", "lambda") for title, _, _ in methods]
    pairs = zip(labels, solutions, strict=True)
    return ", ".join(f"{number(measure.energy_error(start, s).max(), 2)} ({label})" for label, s in pairs)


def _boundary(axes, start, reach) -> None:
    """The curve U(q) = H0, which no orbit of that energy crosses."""
    system = start.system
    q = np.stack([x.ravel() for x in np.meshgrid(*2 * [np.linspace(-reach, reach, 241)])], axis=1)
    U = system.observe(system.potential, q, 0 * q).reshape(241, 241)
    H0 = system.observe(system.H, [start.q0], [start.p0])[0]
    axes.contour(*(q[:, i].reshape(241, 241) for i in (0, 1)), U, levels=[H0], colors=style.VERMILION, linewidths=1.0)


def _orbits(methods, quick: bool, height: float):
    """Orbits in the plane (q1, q2): a row for each orbit, a column for each method."""
    t_end = 100.0 if quick else 1000.0
    figure, grid = style.panels(2, len(methods), height, sharex="row", sharey="row")
    parts, every = [], []
    for row, orbit in zip(grid, ORBITS, strict=True):
        start, solutions = _runs(orbit, methods, t_end)
        reach = 0.26 if orbit == "box" else 1.05
        for axes, (title, _, _), s in zip(row, methods, solutions, strict=True):
            inside = np.abs(s.q).max(axis=1) < 10 * reach  # an orbit that escapes ends at the frame
            axes.plot(*s.q[inside].T, color=style.BLUE, linewidth=0.25)
            _boundary(axes, start, 1.2 * reach)
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", title=f"{orbit}, {title}")
            axes.set_xlabel("$q_1$")
        row[0].set_ylabel("$q_2$")
        every += solutions
        parts.append(f"{orbit}: {_largest(methods, solutions, start)}")
    return figure, t_end, "; ".join(parts), every


@style.drawn
def scheme_i_orbits(quick: bool):
    """Box and chaotic orbits of Scheme I."""
    figure, t_end, largest, solutions = _orbits(SCHEME_I, quick, 4.2)
    caption = (
        f"Henon-Heiles, box (above) and chaotic orbits of Scheme I to t = {t_end:g}, h = {STEP:g}; red: the curve "
        f"U(q) = H0 of the exact flow. Largest |H - H0|, {largest}.{measure.troubles(solutions)}"
    )
    return figure, caption


@style.drawn
def preserving_orbits(quick: bool):
    """Box and chaotic orbits of AVF, Schemes IV and V."""
    figure, t_end, largest, solutions = _orbits(PRESERVING, quick, 5.1)
    caption = (
        f"Henon-Heiles, box (above) and chaotic orbits of AVF, Schemes IV and V to t = {t_end:g}, h = {STEP:g}; red: "
        f"the curve U(q) = H0. Largest |H - H0|, {largest}.{measure.troubles(solutions)}"
    )
    return figure, caption


@style.drawn
def sections(quick: bool):
    """The Poincare section of Scheme I's orbits."""
    t_end = 500.0 if quick else 8000.0
    figure, grid = style.panels(2, len(SCHEME_I), 4.2, sharex="row", sharey="row")
    parts, every = [], []
    for row, orbit in zip(grid, ORBITS, strict=True):
        start, solutions = _runs(orbit, SCHEME_I, t_end)
        counts = []
        for axes, (title, _, _), s in zip(row, SCHEME_I, solutions, strict=True):
            points = measure.section(start, s)
            counts.append(len(points))
            axes.plot(*points.T, linestyle="none", marker=".", markersize=2.4, markeredgewidth=0, color=style.BLUE)
            axes.set(title=f"{orbit}, {title}", xlabel="$q_2$")
        row[0].set_ylabel("$p_2$")
        every += solutions
        parts.append(f"{orbit} {', '.join(map(str, counts))}")
    caption = (
        f"Henon-Heiles, Poincare section q_1 = 0, p_1 > 0 of Scheme I's orbits to t = {t_end:g}, h = {STEP:g}. "
        f"Crossings for lambda = {', '.join(map(str, LAMBDAS))}: {'; '.join(parts)}.{measure.troubles(every)}"
    )
    return figure, caption


def _energies(methods, quick: bool):
    """|H - H0| against t: a panel for each orbit, a curve for each method."""
    t_end = 100.0 if quick else 1000.0
    figure, grid = style.panels(2, 1, 4.4, sharex=True)
    parts, every, errors = [], [], []
    for axes, orbit in zip(grid[:, 0], ORBITS, strict=True):
        start, solutions = _runs(orbit, methods, t_end)
        for k, ((title, _, _), s) in enumerate(zip(methods, solutions, strict=True)):
            t, e = measure.binned_maxima(s.t, measure.energy_error(start, s))
            e = np.where(e < ESCAPED, e, np.nan)
            axes.semilogy(t, measure.shown(e), label=title, **style.curve(k, len(t)))
            errors.append(e)
        style.decades(axes)
        axes.set(ylabel="$|H - H_0|$", title=f"{orbit} orbit", xlim=(0, t_end))
        every += solutions
        parts.append(f"{orbit}: {_largest(methods, solutions, start)}")
    grid[-1, 0].set_xlabel("$t$")
    figure.align_ylabels()
    style.legend_above(figure, grid[0, 0], len(methods))
    tail = (
        f"to t = {t_end:g}, h = {STEP:g}; each curve joins the maxima of 200 equal pieces of time. Largest |H - H0|, "
        f"{'; '.join(parts)}.{measure.floor_note(errors)}{measure.troubles(every)}"
    )
    return figure, tail


@style.drawn
def scheme_i_energy(quick: bool):
    """Energy error of Scheme I."""
    figure, tail = _energies(SCHEME_I, quick)
    return figure, f"Henon-Heiles, energy error of Scheme I {tail}"


@style.drawn
def preserving_energy(quick: bool):
    """Energy error of AVF, Schemes IV and V."""
    figure, tail = _energies(PRESERVING, quick)
    return figure, f"Henon-Heiles, energy error of AVF, Schemes IV and V {tail}"


FIGURES = (
    Figure("henon-heiles-scheme-i-orbits", "Henon-Heiles: orbits of Scheme I", SECTION, scheme_i_orbits),
    Figure("henon-heiles-scheme-i-sections", "Henon-Heiles: Poincare sections of Scheme I", SECTION, sections),
    Figure("henon-heiles-scheme-i-energy", "Henon-Heiles: energy error of Scheme I", SECTION, scheme_i_energy),
    Figure("henon-heiles-preserving-orbits", "Henon-Heiles: orbits of AVF, IV and V", SECTION, preserving_orbits),
    Figure("henon-heiles-preserving-energy", "Henon-Heiles: energy error of AVF, IV and V", SECTION, preserving_energy),
)
