r"""Stiffness, implicit solvers at their edge, two frequencies, stability functions: maps over steps and parameters.

**Stiffness**: the oscillatory energy I of the stiff springs is an adiabatic invariant: over the time of a run it
changes by O(1/omega).

**Solvers**: equations of implicit methods are solved by fixed-point iteration; by Newton's method where the iteration
no longer contracts; a root is missed if Schemes IV and V, which choose a parameter in each step so that H is kept, find
none; the energy is lost on a spurious solution, or another orbit.

**Two frequencies**:

.. math::
    H = \tfrac12(p_1^2 + p_2^2) + \tfrac12(\omega_1^2 q_1^2 + \omega_2^2 q_2^2) + \kappa\,\omega_1\omega_2 q_1 q_2,

kappa < 1, is a stable linear system.  A step of it is a 4 x 4 matrix, unstable where its spectral radius is above 1.

**Stability functions** of Runge-Kutta methods, R(z) = det(I - z A + z 1 b^T) / det(I - z A).

Source: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), XIII.2 and XIII.4.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import mpmath
import numpy as np
import pandas as pd
import sympy as sp

from phasebench.benchmarks import style
from phasebench.benchmarks.measure import linear_stability
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Runs, over
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.fpu import oscillatory_energies
from phasebench.benchmarks.problems.kepler import pericentre
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.coefficients.tableaus import runge_kutta
from phasebench.integrators.driver import OK, integrate
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import BY_ID
from phasebench.integrators.systems.hamiltonian import Hamiltonian

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.prepared import PreparedRun
    from phasebench.integrators.solution import Solution

STIFFNESS, SOLVERS = "extremes_stiffness", "extremes_solvers"
RESONANCES, REGIONS = "extremes_resonances", "extremes_regions"
#: Stiffness: omega, h omega, methods; steps and rows of a run, the seconds after which it is stopped; a method's cliff
#: is the largest h omega up to which I changes by less than `CLIFF`.
OMEGAS = (50.0, 1e3, 1e4, 1e6)
STEPS_TIMES_OMEGA = tuple(float(f"{10 ** (k / 2):.3g}") for k in range(-6, 7))
STIFF = (
    *("stormer-verlet", "pefrl", "blanes-moan-s6", "rk4", "implicit-midpoint", "gauss-2", "imex", "deuflhard"),
    *("mollified-impulse", "hairer-lubich", "grimm-hochbruck"),
)
STEPS, SEEN, SECONDS, CLIFF = 10_000, 500, 2.0, 0.2
#: Solvers: outcomes with colours; steps of a run, the seconds after which it is stopped; fallbacks or Newton solves
#: count if they occur in more than the share `OFTEN` of the steps.
FIXED_POINT, NEWTON, MISSED, LOST = "fixed point", "Newton", "roots missed", "energy lost"
SHORT, BRIEFLY, OFTEN = 200, 1.0, 0.01
COLOURS = {
    FIXED_POINT: style.SKY, NEWTON: style.GREEN, MISSED: style.YELLOW, LOST: style.ORANGE, "no-root": style.PURPLE,
    "not-converged": style.VERMILION, "collision": style.BLACK,
}  # fmt: skip
LAMBDAS = tuple(float(x) for x in np.linspace(-10, 11, 22))
ECCENTRICITIES = tuple(float(x) for x in np.round(np.linspace(0, 0.98, 15), 3))
H_PENDULUM = tuple(float(f"{x:.3g}") for x in np.geomspace(0.02, 6, 19))
H_KEPLER = tuple(float(f"{x:.3g}") for x in np.geomspace(0.003, 3, 19))
#: (method, problem, the parameter that is varied besides h)
MAPS = (
    *((id, "pendulum", "lam") for id in ("scheme-i", "scheme-ii")),
    *((id, "kepler", "e") for id in ("implicit-midpoint", "scheme-iv", "scheme-v")),
)
#: Two frequencies: methods; the coupling kappa; ratios omega_2 / omega_1; the largest h omega_2, the number of them.
COUPLED = ("stormer-verlet", "deuflhard", "mollified-impulse", "hairer-lubich")
COUPLING = sp.Rational(1, 5)
RATIOS = tuple(sp.Rational(round(16 * 2 ** (k / 5)), 16) for k in range(16))
LAST, POINTS = 10.0, 120
#: Stability functions: explicit methods, whose records have the tableau; implicit ones with its kind and stages.
EXPLICIT = ("explicit-euler", "rk4", "dop853")
IMPLICIT = {"gauss-2": ("gauss", 2), "radau-iia-2": ("radau-iia", 2), "radau-iia-3": ("radau-iia", 3)}


def stiffness(method: str) -> list[dict]:
    """The largest relative changes of I and H: a row for each omega and h omega."""
    rows = []
    for omega in OMEGAS:
        made = problem_of("fpu", omega=omega)
        observed = {"I changes": sum(oscillatory_energies(made)), "H changes": made.system.H}
        for z in STEPS_TIMES_OMEGA:
            s = integrate(made, method, h=z / omega, steps=STEPS, save_every=STEPS // SEEN, timeout=SECONDS)
            row = {"omega": omega, "h omega": z, "status": s.status}
            for name, e in observed.items():
                with np.errstate(all="ignore"):
                    values = made.system.observe(e, s.q, s.p)
                    change = np.abs(values / values[0] - 1).max()
                row[name] = float(change) if s.status == OK and np.isfinite(change) else np.inf
            rows.append(row)
    return rows


def solvers(method: str, problem: str, over: str) -> list[dict]:
    """The outcomes of short runs over h and lambda (``over`` is "lam") or the eccentricity ("e")."""
    made, rows = problem_of(problem), []
    values, steps = (LAMBDAS, H_PENDULUM) if over == "lam" else (ECCENTRICITIES, H_KEPLER)
    for value in values:
        orbit = None if over == "lam" else pericentre(value, ())
        options = {"parameters": {"lam": value}} if orbit is None else {"q0": orbit.q, "p0": orbit.p}
        for h in steps:
            s = integrate(made, method, h=h, steps=SHORT, timeout=BRIEFLY, **options)
            rows.append({"value": value, "h": h, "outcome": outcome(made, s)})
    return rows


def outcome(made: Problem, s: Solution) -> str:
    """How a run's equations were solved, or the status of a run that ended early."""
    H = made.system.observe(made.system.H, s.q, s.p)
    with np.errstate(all="ignore"):
        if not np.abs(H - H[0]).max() <= max(abs(H[0]), 0.1):
            return LOST
    if s.status != OK:
        return s.status
    taken = max(1, s.counts["steps"])
    if s.counts.get("fallbacks", 0) > OFTEN * taken:
        return MISSED
    return NEWTON if s.counts.get("newton", 0) > OFTEN * taken else FIXED_POINT


def coupled(ratio: sp.Rational) -> Hamiltonian:
    """Two coupled oscillators with frequencies 1 and ``ratio``."""
    q1, q2, p1, p2 = sp.symbols("q1 q2 p1 p2", real=True)
    H = (p1**2 + p2**2) / 2 + (q1**2 + ratio**2 * q2**2) / 2 + COUPLING * ratio * q1 * q2
    return Hamiltonian(q=[q1, q2], p=[p1, p2], H=H, frequencies=[1, ratio])


def radius(run: PreparedRun, h: float) -> float:
    """The spectral radius of the matrix of one step of length h on a linear system."""
    columns = [np.concatenate(run(h, 1, unit[:2], unit[2:])[:2]) for unit in np.eye(4)]
    return linear_stability.radius(np.array(columns).T)


def resonances(method: str) -> list[dict]:
    """The spectral radius of a step: a row for each ratio of the frequencies and each h."""
    rows = []
    for ratio in RATIOS:
        run, w = prepare(coupled(ratio), BY_ID[method], q0=(1, 0), p0=(0, 0)), float(ratio)
        for z in np.linspace(LAST / POINTS, LAST, POINTS):
            row = {"ratio": w, "h omega 1": float(z / w), "h omega 2": float(z)}
            rows.append(row | {"radius": radius(run, z / w)})
    return rows


def stability_functions(regions: bool) -> list[dict]:
    """The coefficients of the numerator and the denominator of R(z), the highest power first: a row for each method."""
    rows = []
    for id in (*EXPLICIT, *IMPLICIT):
        A, b = _tableau(id)
        # det(I - z B) = z^s chi_B(1 / z): the characteristic polynomial with its coefficients reversed.
        both = {"above": np.poly(A - np.outer(np.ones(len(b)), b))[::-1], "below": np.poly(A)[::-1]}
        rows.append({"method": id} | {name: " ".join(repr(float(c)) for c in poly) for name, poly in both.items()})
    return rows


def _tableau(id: str) -> tuple[np.ndarray, np.ndarray]:
    """The matrix A (s, s) and the weights b (s,) of a method."""
    if id in IMPLICIT:
        with mpmath.workdps(30):
            A, _, b, _ = runge_kutta(*IMPLICIT[id])
            return np.array(A.tolist(), float), np.array(list(b), float)
    *rows, weights = BY_ID[id].data
    return np.array(rows, float), np.array(weights, float)


@picture(
    STIFFNESS, "extremes-stiffness", "stiffness",
    f"FPU: the largest change of the oscillatory energy in {STEPS} steps; grey: {CLIFF:g}, the cliff.",
)  # fmt: skip
def draw_stiffness(rows: pd.DataFrame) -> style.Figure:
    """The largest change of the oscillatory energy of the Fermi-Pasta-Ulam problem over h omega."""
    omegas = sorted(rows["omega"].unique())
    parts = [(f"ω = {w:g}", rows[rows["omega"] == w]) for w in omegas[1::2] or omegas]
    of_method = style.curves("method", "h omega", "I changes", most=9, span=(1e-12, 1e2), level=CLIFF)
    return style.row(parts, of_method, 3.4, "h ω", "largest change of I / I₀", legend=4, grid=False, sharey=True)


@picture(
    SOLVERS, "extremes-solvers", "solvers at the edge",
    f"How {SHORT} steps go: the pendulum over (h, λ), Kepler over (h, e).",
)  # fmt: skip
def draw_solvers(rows: pd.DataFrame) -> style.Figure:
    """How implicit equations were solved, or not, over h and a method's lambda or the eccentricity e."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    colours = COLOURS | {x: style.GREY for x in rows["outcome"] if x not in COLOURS}
    known = [*colours]
    look = {"cmap": ListedColormap([*colours.values()]), "vmin": -0.5, "vmax": len(known) - 0.5}
    parts = rows.groupby(["method", "over"], sort=False)
    figure, (row,) = style.panels(1, len(parts), 2.8)
    for axes, ((id, varied), part) in zip(row, parts, strict=True):
        grid = part.assign(code=part["outcome"].map(known.index)).pivot(index="value", columns="h", values="code")
        axes.pcolormesh(grid.columns, grid.index, grid.to_numpy(), **look)
        axes.set(xscale="log", xlabel="h", title=id, ylabel="λ" if varied == "lam" else varied)
    handles = [Patch(color=colours[k], label=k) for k in known if (rows["outcome"] == k).any()]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    return figure


@picture(
    RESONANCES, "extremes-resonances", "two frequencies",
    "Two coupled oscillators: black where a step multiplies, white where it is stable; Stormer-Verlet ends at "
    "h ω = 2, a split coupling resonates about h (ω₁ + ω₂) = 2πk, filters take the resonances away.",
)  # fmt: skip
def draw_resonances(rows: pd.DataFrame) -> style.Figure:
    """A step's growth factor over the two frequencies of coupled oscillators."""
    parts = rows.groupby("method", sort=False)
    figure, (row,) = style.panels(1, len(parts), 2.3, sharey=True)
    for axes, (id, part) in zip(row, parts, strict=True):
        own = part.sort_values(["ratio", "h omega 2"])
        columns = (own[c].to_numpy() for c in ("h omega 1", "h omega 2", "radius"))
        x, y, size = (c.reshape(own["ratio"].nunique(), -1) for c in columns)
        grows = np.log10(np.clip(size - 1, 1e-12, 1e2))
        for first, second in ((x, y), (y, x)):  # the two frequencies may be exchanged
            axes.pcolormesh(first, second, grows, cmap="Greys", vmin=-9, vmax=0, shading="nearest")
        axes.set(title=id, xlabel="h ω₁", aspect="equal")
    row[0].set_ylabel("h ω₂")
    return figure


@picture(
    REGIONS, "extremes-regions", "stability regions",
    "Boundaries |R(z)| = 1 of Runge-Kutta methods: stable within the curve of an explicit method, outside "
    "that of a Radau method, left of the axis for Gauss; the upper half plane.",
)  # fmt: skip
def draw_regions(rows: pd.DataFrame) -> style.Figure:
    """The boundaries |R(z)| = 1 of the stability regions of Runge-Kutta methods in the complex plane."""
    x, y = np.meshgrid(np.linspace(-7.5, 12, 391), np.linspace(0, 8, 161))
    figure, ((axes,),) = style.panels(1, 1, 3.0)
    for look, row in zip(style.looks(), rows.itertuples(), strict=False):
        above, below = (np.polyval([*map(float, str(c).split())], x + 1j * y) for c in (row.above, row.below))
        colour, line = look["color"], look["linestyle"]
        axes.contour(x, y, np.abs(above / below), levels=[1.0], colors=[colour], linestyles=[line])
        axes.plot([], [], color=colour, linestyle=line, label=row.method)
    axes.axvline(0, color=style.GREY, linewidth=0.6)
    axes.set(xlabel="Re z", ylabel="Im z", aspect="equal")
    style.legend_above(figure, axes, 3)
    return figure


RUNS = (
    Runs(STIFFNESS, stiffness, over(method=STIFF),
         needs=lambda method: (BY_ID[method], *(ProblemKey("fpu", (("omega", w),)) for w in OMEGAS))),
    Runs(SOLVERS, solvers, [{"method": id, "problem": on, "over": of} for id, on, of in MAPS],
         needs=lambda method, problem, **_: (BY_ID[method], ProblemKey(problem))),
    Runs(RESONANCES, resonances, over(method=COUPLED), needs=lambda method: (BY_ID[method], *map(str, RATIOS))),
    Runs(REGIONS, stability_functions, [{"regions": True}], needs=[BY_ID[id] for id in (*EXPLICIT, *IMPLICIT)]),
)  # fmt: skip
