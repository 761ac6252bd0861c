r"""Perturbed Kepler: orbits, energy and angular momentum of Schemes I and III over lambda, of AVF, Schemes IV and V.

The angular momentum L = q1 p2 - q2 p1 is a quadratic invariant: every scheme whose map is symplectic for each fixed
lambda keeps it to round-off, also where lambda is chosen anew in each step (Schemes IV and V); AVF does not.

Source: Y. Wang, Y. Bo, W. Cai, "A general symplectic integrator for canonical Hamiltonian systems" (talk), 'The
perturbed Kepler problem', (29)-(30).
"""

from __future__ import annotations

import numpy as np

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.style import number

from . import measure
from .measure import LAMBDAS
from .record import Figure

SECTION = "perturbed kepler"
STEP = 0.01
PRESERVING = (("AVF", "avf"), ("Scheme IV", "scheme-iv"), ("Scheme V", "scheme-v"))
INVARIANTS = (("energy", "$|H - H_0|$"), ("angular-momentum", "$|L - L_0|$"))


def _kepler():
    return measure.start("perturbed-kepler")


def _end(quick: bool) -> float:
    return 100.0 if quick else 1000.0


def invariant_error(name: str, solution) -> np.ndarray:
    """The error of "energy" or of "angular-momentum" along a solution, array (n,)."""
    kepler = _kepler()
    expression = kepler.system.H if name == "energy" else kepler.invariants[name]
    return measure.error(kepler, expression, solution)


def precession(solution) -> float:
    """The angle in radians by which the apocentre turns in a revolution, on average (NaN below two apocentres)."""
    q = solution.q
    r = np.hypot(*q.T)
    far = 1 + np.flatnonzero((r[1:-1] > r[:-2]) & (r[1:-1] >= r[2:]))
    if len(far) < 2:
        return float("nan")
    # The vertex of the parabola through three distances places the apocentre between two rows.
    a, b, c = r[far - 1], r[far], r[far + 1]
    shift = 0.5 * (a - c) / (a - 2 * b + c)
    angle = np.unwrap(np.arctan2(q[:, 1], q[:, 0]))
    turned = angle[far] + shift * (angle[far + 1] - angle[far - 1]) / 2
    return float((turned[-1] - turned[0]) / (len(far) - 1) - 2 * np.pi)


def _reference_turn(t_end: float) -> str:
    """The caption's words about the turn of the exact flow, from a method of order 6."""
    s = measure.run(measure.start("perturbed-kepler"), "scheme-iii-suzuki-6", STEP / 2, t_end)
    return f"{number(precession(s), 4)} (Suzuki's composition of order 6, h = {number(s.h)})"


def _draw_orbit(axes, solution, title: str) -> None:
    axes.plot(*solution.q.T, color=style.BLUE, linewidth=0.25)
    axes.plot(0, 0, marker="+", color=style.VERMILION, markersize=6)
    axes.set(xlim=(-1.85, 1.85), ylim=(-1.85, 1.85), aspect="equal", title=title, xlabel="$q_1$")


@style.drawn
def scheme_i_orbits(quick: bool):
    """Orbits of Scheme I."""
    t_end = _end(quick)
    figure, (row,) = style.panels(1, len(LAMBDAS), 2.25, sharey=True)
    solutions = [measure.run(_kepler(), "scheme-i", STEP, t_end, lam=lam) for lam in LAMBDAS]
    for axes, lam, s in zip(row, LAMBDAS, solutions, strict=True):
        _draw_orbit(axes, s, f"$\\lambda$ = {lam}")
    row[0].set_ylabel("$q_2$")
    turns = [precession(s) for s in solutions]
    caption = (
        f"Perturbed Kepler, orbits of Scheme I to t = {t_end:g}, h = {STEP:g}. The apocentre turns in each revolution, "
        f"for lambda = {', '.join(map(str, LAMBDAS))}, by {', '.join(number(x, 4) for x in turns)} rad; by "
        f"{_reference_turn(t_end)} for the exact flow."
        f"{measure.troubles(solutions)}"
    )
    return figure, caption


def _invariant_panels(axes_by_name, labelled) -> list[np.ndarray]:
    """Curves of the labelled solutions in a panel for each invariant; returns the errors shown."""
    errors = []
    for axes, (name, label) in zip(axes_by_name, INVARIANTS, strict=True):
        for k, (title, s) in enumerate(labelled):
            t, e = measure.binned_maxima(s.t, invariant_error(name, s))
            axes.semilogy(t, measure.shown(e), label=title, **style.curve(k, len(t)))
            errors.append(e)
        axes.set(ylabel=label, xlim=(0, labelled[0][1].t[-1]))
    return errors


def _largest(name: str, solutions) -> str:
    return ", ".join(number(invariant_error(name, s).max(), 2) for s in solutions)


@style.drawn
def scheme_i_and_iii(quick: bool):
    """Energy and angular momentum error of Schemes I and III."""
    t_end = _end(quick)
    figure, grid = style.panels(2, 2, 4.6, sharex=True, sharey="row")
    errors, parts, every = [], [], []
    for column, (name, id) in enumerate((("Scheme I", "scheme-i"), ("Scheme III", "scheme-iii"))):
        solutions = [measure.run(_kepler(), id, STEP, t_end, lam=lam) for lam in LAMBDAS]
        labelled = [(f"$\\lambda$ = {lam}", s) for lam, s in zip(LAMBDAS, solutions, strict=True)]
        errors += _invariant_panels(grid[:, column], labelled)
        grid[0, column].set_title(name)
        grid[1, column].set_xlabel("$t$")
        every += solutions
        parts.append(f"{name}: {_largest('energy', solutions)} of H, {_largest('angular-momentum', solutions)} of L")
    for left, right in grid:
        style.decades(left)
        right.set_ylabel("")
    figure.align_ylabels()
    style.legend_above(figure, grid[0, 0], len(LAMBDAS))
    caption = (
        f"Perturbed Kepler, errors of energy H (above) and angular momentum L to t = {t_end:g}, h = {STEP:g}; each "
        f"curve joins the maxima of 200 equal pieces of time. Largest errors for lambda = "
        f"{', '.join(map(str, LAMBDAS))}, {'; '.join(parts)}.{measure.floor_note(errors)}{measure.troubles(every)}"
    )
    return figure, caption


@style.drawn
def preserving_orbits(quick: bool):
    """Orbits of AVF, Schemes IV and V."""
    t_end = _end(quick)
    figure, (row,) = style.panels(1, len(PRESERVING), 2.75, sharey=True)
    solutions = [measure.run(_kepler(), id, STEP, t_end) for _, id in PRESERVING]
    for axes, (title, _), s in zip(row, PRESERVING, solutions, strict=True):
        _draw_orbit(axes, s, title)
    row[0].set_ylabel("$q_2$")
    turns = [f"{number(precession(s), 4)} ({title})" for (title, _), s in zip(PRESERVING, solutions, strict=True)]
    caption = (
        f"Perturbed Kepler, orbits of AVF, Schemes IV and V to t = {t_end:g}, h = {STEP:g}. The apocentre turns in "
        f"each revolution by {', '.join(turns)} rad; by {_reference_turn(t_end)} for the exact flow."
        f"{measure.troubles(solutions)}"
    )
    return figure, caption


@style.drawn
def preserving_invariants(quick: bool):
    """Energy and angular momentum error of AVF, Schemes IV and V."""
    t_end = _end(quick)
    figure, grid = style.panels(2, 1, 4.4, sharex=True)
    solutions = [measure.run(_kepler(), id, STEP, t_end) for _, id in PRESERVING]
    labelled = [(title, s) for (title, _), s in zip(PRESERVING, solutions, strict=True)]
    errors = _invariant_panels(grid[:, 0], labelled)
    for axes in grid[:, 0]:
        style.decades(axes)
    grid[1, 0].set_xlabel("$t$")
    figure.align_ylabels()
    style.legend_above(figure, grid[0, 0], len(PRESERVING))
    caption = (
        f"Perturbed Kepler, errors of energy H (above) and angular momentum L to t = {t_end:g}, h = {STEP:g}; each "
        f"curve joins the maxima of 200 equal pieces of time. Largest errors of {', '.join(t for t, _ in PRESERVING)}: "
        f"{_largest('energy', solutions)} of H, {_largest('angular-momentum', solutions)} of L."
        f"{measure.floor_note(errors)}{measure.troubles(solutions)}"
    )
    return figure, caption


@style.drawn
def chosen_parameter(quick: bool):
    """lambda of Schemes IV and V along the orbit."""
    t_end = 8.0 if quick else 20.0
    figure, grid = style.panels(3, 1, 4.8, sharex=True)
    solutions = [measure.run(_kepler(), id, STEP, t_end) for _, id in PRESERVING[1:]]
    grid[0, 0].plot(solutions[0].t, np.hypot(*solutions[0].q.T), color="black")
    grid[0, 0].set_ylabel("$|q|$")
    parts = []
    for axes, (title, _), s, colour in zip(
        grid[1:, 0], PRESERVING[1:], solutions, (style.BLUE, style.VERMILION), strict=True
    ):
        axes.plot(s.t[1:], s.parameter, color=colour, linestyle="none", marker=".", markersize=2.2)
        axes.axhline(0.5, color=style.GREY, linewidth=0.8, zorder=0)
        axes.set(ylabel="$\\lambda$", title=title)
        low, high = np.nanmin(s.parameter), np.nanmax(s.parameter)
        parts.append(f"{title} {number(low, 4)} to {number(high, 4)}, median {number(np.nanmedian(s.parameter), 6)}")
    grid[0, 0].set(title="distance (Scheme IV)", xlim=(0, t_end))
    grid[-1, 0].set_xlabel("$t$")
    figure.align_ylabels()
    caption = (
        f"Perturbed Kepler, the parameter lambda that Schemes IV and V choose in each step to keep the energy, h = "
        f"{STEP:g}; grey: lambda = 1/2. Range to t = {t_end:g}: {'; '.join(parts)}.{measure.troubles(solutions)}"
    )
    return figure, caption


FIGURES = (
    Figure("perturbed-kepler-scheme-i-orbits", "Perturbed Kepler: orbits of Scheme I", SECTION, scheme_i_orbits),
    Figure(
        "perturbed-kepler-scheme-i-iii-invariants",
        "Perturbed Kepler: H and L of Schemes I and III",
        SECTION,
        scheme_i_and_iii,
    ),
    Figure(
        "perturbed-kepler-preserving-orbits", "Perturbed Kepler: orbits of AVF, IV and V", SECTION, preserving_orbits
    ),
    Figure(
        "perturbed-kepler-preserving-invariants",
        "Perturbed Kepler: H and L of AVF, IV and V",
        SECTION,
        preserving_invariants,
    ),
    Figure("perturbed-kepler-parameter", "Perturbed Kepler: lambda of Schemes IV and V", SECTION, chosen_parameter),
)
