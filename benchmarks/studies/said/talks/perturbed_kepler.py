r"""Figures of perturbed Kepler: orbits, energy and angular momentum errors of Schemes I, III, IV, V and AVF.

Schemes I and III are symplectic with a fixed parameter lambda; Schemes IV and V choose lambda in each step so that H is
kept; AVF is the averaged vector field method.

The angular momentum L = q1 p2 - q2 p1 is a quadratic invariant: every scheme whose map is symplectic for each fixed
lambda preserves it to round-off, even if lambda is chosen anew in each step (Schemes IV and V); AVF does not.

Source: Y. Wang, Y. Bo, W. Cai, "A general symplectic integrator for canonical Hamiltonian systems" (talk), 'The
perturbed Kepler problem', (29)-(30).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks import style
from phasebench.benchmarks.store.arrays import unpack
from phasebench.benchmarks.style import number

from . import measure
from .measure import LAMBDAS, Figure

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure as Drawing

    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.solution import Solution

STEP = 0.01
#: End of the runs.
END = 1000.0
#: Orbits are drawn up to this time, in which the apocentre turns once; later they only fill the ring.
DRAWN = 400.0
#: Curve label -> (method id, parameters).
PRESERVING = {"AVF": ("avf", {}), "Scheme IV": ("scheme-iv", {}), "Scheme V": ("scheme-v", {})}
SCHEMES = {"Scheme I": "scheme-i", "Scheme III": "scheme-iii"}
INVARIANTS = {"energy": "$|H - H_0|$", "angular-momentum": "$|L - L_0|$"}
#: The method that stands for the exact flow.
EXACT = "scheme-iii-suzuki-6"


def _kepler() -> Problem:
    return measure.start("perturbed-kepler")


def invariant_error(name: str, solution: Solution) -> np.ndarray:
    """The error |F - F0| of F = "energy" or "angular-momentum" along a perturbed Kepler solution: array (n,)."""
    kepler = _kepler()
    expression = kepler.system.H if name == "energy" else kepler.invariants[name]
    return measure.error(kepler, expression, solution)


def precession(solution: Solution) -> float:
    """The angle in radians by which the apocentre turns per revolution, on average."""
    q = solution.q
    r = np.hypot(*q.T)
    far = 1 + np.flatnonzero((r[1:-1] > r[:-2]) & (r[1:-1] >= r[2:]))
    if len(far) < 2:
        return float("nan")
    # The parabola through three distances locates the apocentre between rows.
    a, b, c = r[far - 1], r[far], r[far + 1]
    shift = 0.5 * (a - c) / (a - 2 * b + c)
    angle = np.unwrap(np.arctan2(q[:, 1], q[:, 0]))
    turned = angle[far] + shift * (angle[far + 1] - angle[far - 1]) / 2
    return float((turned[-1] - turned[0]) / (len(far) - 1) - 2 * np.pi)


def _over_lambda(id: str) -> dict:
    return {f"λ = {lam}": (id, {"lam": lam}) for lam in LAMBDAS}


def _run(chosen: tuple[str, dict], t_end: float) -> Solution:
    id, parameters = chosen
    return measure.run(_kepler(), id, STEP, t_end, **parameters)


def _measure_orbits(methods: Mapping[str, tuple[str, dict]]) -> list[dict]:
    rows = []
    for label, chosen in methods.items():
        s = _run(chosen, END)
        path = measure.thin_path(s.q, until=round(DRAWN / STEP))
        rows.append(measure.row("", label, *path.T, s, turn=precession(s)))
    s = measure.run(_kepler(), EXACT, STEP / 2, END)
    return [*rows, measure.row("", "exact flow", [], [], s, turn=precession(s))]


def _measure_invariants(methods: Mapping[str, tuple[str, dict]], column: str = "") -> list[dict]:
    rows = []
    for label, chosen in methods.items():
        s = _run(chosen, END)
        for name in INVARIANTS:
            error = invariant_error(name, s)
            t, e = measure.binned_maxima(s.t, error)
            rows.append(measure.row(f"{column} {name}".strip(), label, t, e, s, largest=error.max()))
    return rows


def _measure_schemes() -> list[dict]:
    return [row for title, id in SCHEMES.items() for row in _measure_invariants(_over_lambda(id), column=title)]


def _measure_parameter() -> list[dict]:
    rows = []
    for label in ("Scheme IV", "Scheme V"):
        s = _run(PRESERVING[label], 20.0)
        if not rows:
            rows.append(measure.row("distance", label, s.t, np.hypot(*s.q.T), s))
        low, middle, high = (f(s.parameter) for f in (np.nanmin, np.nanmedian, np.nanmax))
        rows.append(measure.row("lambda", label, s.t[1:], s.parameter, s, low=low, median=middle, high=high))
    return rows


def _span(rows: pd.DataFrame) -> str:
    return f"to t = {rows['t_end'].max():g}, h = {STEP:g}"


def _draw_orbits(rows: pd.DataFrame, methods: str, height: float) -> tuple[Drawing, str]:
    exact = rows[rows["curve"] == "exact flow"].iloc[0]
    shown = rows[rows["curve"] != "exact flow"]
    figure, (panels,) = style.panels(1, len(shown), height, sharey=True)
    for axes, r in zip(panels, shown.itertuples(), strict=True):
        axes.plot(unpack(r.x), unpack(r.y), color=style.BLUE, linewidth=0.25)
        axes.plot(0, 0, marker="+", color=style.VERMILION, markersize=6)
        axes.set(xlim=(-1.85, 1.85), ylim=(-1.85, 1.85), aspect="equal", title=r.curve, xlabel="$q_1$")
    panels[0].set_ylabel("$q_2$")
    turns = ", ".join(f"{number(r.turn, 4)} ({r.curve})" for r in shown.itertuples())
    caption = (
        f"Perturbed Kepler, orbits of {methods} {_span(shown)}, drawn to t = {min(DRAWN, shown['t_end'].max()):g}. The "
        f"apocentre turns in each revolution by {turns} rad; by {number(exact['turn'], 4)} for the exact flow "
        f"(Suzuki's composition of order 6, h = {number(exact['h'])}).{measure.troubles(shown)}"
    )
    return figure, caption


@style.styled
def scheme_i_orbits(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """Perturbed Kepler orbits of Scheme I, symplectic with a fixed parameter lambda."""
    return _draw_orbits(rows, "Scheme I", 2.25)


@style.styled
def preserving_orbits(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """Perturbed Kepler orbits of energy-preserving methods."""
    return _draw_orbits(rows, "AVF, Schemes IV and V", 2.75)


def _invariant_panels(axes_by_name: np.ndarray, rows: pd.DataFrame, column: str = "") -> list[np.ndarray]:
    """Error curves into one column of panels, a panel for each invariant; return the errors of each curve."""
    errors = []
    for axes, (name, label) in zip(axes_by_name, INVARIANTS.items(), strict=True):
        for k, r in enumerate(rows[rows["panel"] == f"{column} {name}".strip()].itertuples()):
            t, e = unpack(r.x), unpack(r.y)
            axes.semilogy(t, measure.for_log_axis(e), label=r.curve, **style.curve(k, len(t)))
            errors.append(e)
        axes.set(ylabel=label, xlim=(0, rows["t_end"].max()))
    return errors


def _invariants_caption(rows: pd.DataFrame, errors: list[np.ndarray]) -> str:
    return (
        f"Perturbed Kepler, errors of energy H (above) and angular momentum L {_span(rows)}; each curve joins the "
        f"maxima of 200 equal pieces of time.{measure.floor_note(errors)}"
        f"{measure.troubles(rows[rows['panel'].str.contains('energy')])}"
    )


@style.styled
def scheme_i_and_iii(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """Errors of energy and angular momentum of Schemes I and III on perturbed Kepler."""
    figure, grid = style.panels(2, 2, 4.6, sharex=True, sharey="row")
    errors = []
    for column, name in enumerate(SCHEMES):
        errors += _invariant_panels(grid[:, column], rows, name)
        grid[0, column].set_title(name)
        grid[1, column].set_xlabel("$t$")
    for left, right in grid:
        style.decades(left)
        right.set_ylabel("")
    figure.align_ylabels()
    style.legend_above(figure, grid[0, 0], len(LAMBDAS))
    return figure, _invariants_caption(rows, errors)


@style.styled
def preserving_invariants(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """Errors of energy and angular momentum of energy-preserving methods on perturbed Kepler."""
    figure, grid = style.panels(2, 1, 4.4, sharex=True)
    errors = _invariant_panels(grid[:, 0], rows)
    for axes in grid[:, 0]:
        style.decades(axes)
    grid[1, 0].set_xlabel("$t$")
    figure.align_ylabels()
    style.legend_above(figure, grid[0, 0], len(PRESERVING))
    return figure, _invariants_caption(rows, errors)


@style.styled
def chosen_parameter(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """The parameter lambda that Schemes IV and V choose in each step of a perturbed Kepler orbit to keep H."""
    figure, grid = style.panels(3, 1, 4.8, sharex=True)
    distance = rows[rows["panel"] == "distance"].iloc[0]
    grid[0, 0].plot(unpack(distance["x"]), unpack(distance["y"]), color="black")
    grid[0, 0].set_ylabel("$|q|$")
    chosen = rows[rows["panel"] == "lambda"]
    for axes, r, colour in zip(grid[1:, 0], chosen.itertuples(), (style.BLUE, style.VERMILION), strict=True):
        look = {"color": colour, "linestyle": "none", "marker": ".", "markersize": 2.2}
        axes.plot(unpack(r.x), unpack(r.y), **look)
        axes.axhline(0.5, color=style.GREY, linewidth=0.8, zorder=0)
        axes.set(ylabel="$\\lambda$", title=r.curve)
    grid[0, 0].set(title=f"distance ({distance['curve']})", xlim=(0, distance["t_end"]))
    grid[-1, 0].set_xlabel("$t$")
    figure.align_ylabels()
    ranges = "; ".join(
        f"{r.curve} {number(r.low, 4)} to {number(r.high, 4)}, median {number(r.median, 6)}"
        for r in chosen.itertuples()
    )
    caption = (
        f"Perturbed Kepler, the parameter λ that Schemes IV and V choose in each step to keep the energy, h = "
        f"{STEP:g}; grey: λ = 1/2. Range to t = {distance['t_end']:g}: {ranges}.{measure.troubles(chosen)}"
    )
    return figure, caption


FIGURES = (
    Figure(
        "perturbed-kepler-scheme-i-orbits",
        "Orbits of Scheme I",
        partial(_measure_orbits, _over_lambda("scheme-i")),
        scheme_i_orbits,
    ),
    Figure(
        "perturbed-kepler-scheme-i-iii-invariants",
        "Energy and angular momentum of Schemes I and III",
        _measure_schemes,
        scheme_i_and_iii,
    ),
    Figure(
        "perturbed-kepler-preserving-orbits",
        "Orbits of AVF, Schemes IV and V",
        partial(_measure_orbits, PRESERVING),
        preserving_orbits,
    ),
    Figure(
        "perturbed-kepler-preserving-invariants",
        "Energy and angular momentum of AVF, Schemes IV and V",
        partial(_measure_invariants, PRESERVING),
        preserving_invariants,
    ),
    Figure("perturbed-kepler-parameter", "The parameter of Schemes IV and V", _measure_parameter, chosen_parameter),
)
