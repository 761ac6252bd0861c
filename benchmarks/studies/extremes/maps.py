r"""Stiffness, implicit solvers at their edge, two frequencies, stability functions: maps over steps and parameters.

**Stiffness**: the Fermi-Pasta-Ulam problem with omega from 50 to 10^6, at h omega from 10^-3 to 10^3.  The oscillatory
energy I of the stiff springs is an adiabatic invariant: over the time of a run it changes by O(1/omega).

**Solvers**: how the equations of implicit methods are solved over the step h and the parameter lambda, on the pendulum,
or the eccentricity of Kepler's orbit: by fixed-point iteration; by Newton's method where the iteration no longer
contracts; root missed (Schemes IV and V, which choose a parameter in each step so that H is kept, find none); energy
lost (a spurious solution, or another orbit); or the status with which the run ended.

**Two frequencies**:

.. math::
    H = \tfrac12(p_1^2 + p_2^2) + \tfrac12(\omega_1^2 q_1^2 + \omega_2^2 q_2^2) + \kappa\,\omega_1\omega_2 q_1 q_2,

kappa < 1, is a stable linear system.  A step of it is a 4 x 4 matrix, unstable where its spectral radius is above 1:
beyond a method's limit and, for methods that split the coupling off, in strips about
:math:`h(\omega_1 + \omega_2) = 2\pi k`.

**Stability functions** of Runge-Kutta methods, R(z) = det(I - z A + z 1 b^T) / det(I - z A).

Source: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), XIII.2 and XIII.4.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import mpmath
import numpy as np
import sympy as sp

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

STIFFNESS, SOLVERS, RESONANCES, REGIONS = (
    f"extremes_{name}" for name in ("stiffness", "solvers", "resonances", "regions")
)
#: Stiffness: omega, h omega, methods; steps and rows of a run, the seconds after which it is stopped; a method's cliff
#: is the largest h omega up to which I changes by less than `CLIFF`.
OMEGAS = (50.0, 1e3, 1e4, 1e6)
STEPS_TIMES_OMEGA = tuple(float(f"{10 ** (k / 2):.3g}") for k in range(-6, 7))
STIFF = (
    *("stormer-verlet", "pefrl", "blanes-moan-s6", "rk4", "implicit-midpoint", "gauss-2", "imex", "deuflhard"),
    *("mollified-impulse", "hairer-lubich", "grimm-hochbruck"),
)
STEPS, SEEN, SECONDS, CLIFF = 10_000, 500, 2.0, 0.2
#: Solvers: outcomes; steps of a run, the seconds after which it is stopped; fallbacks or Newton solves count if they
#: occur in more than the share `OFTEN` of the steps.
FIXED_POINT, NEWTON, MISSED, LOST = "fixed point", "Newton", "roots missed", "energy lost"
SHORT, BRIEFLY, OFTEN = 200, 1.0, 0.01
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
            with np.errstate(all="ignore"):
                series = {name: made.system.observe(e, s.q, s.p) for name, e in observed.items()}
            changes = {name: _change(x) if s.status == OK else np.inf for name, x in series.items()}
            rows.append({"omega": omega, "h omega": z, "status": s.status} | changes)
    return rows


def _change(values: np.ndarray) -> float:
    change = np.abs(values / values[0] - 1)
    return float(change.max()) if np.isfinite(change).all() else np.inf


def solvers(method: str, problem: str, over: str) -> list[dict]:
    """The outcomes of short runs over h and lambda (``over`` is "lam") or the eccentricity ("e")."""
    made, rows = problem_of(problem), []
    for value in LAMBDAS if over == "lam" else ECCENTRICITIES:
        if over == "lam":
            options = {"parameters": {"lam": value}}
        else:
            orbit = pericentre(value, ())
            options = {"q0": orbit.q, "p0": orbit.p}
        for h in H_PENDULUM if over == "lam" else H_KEPLER:
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


class CoupledOscillators:
    """Two coupled oscillators with frequencies 1 and ``ratio``, as a problem with ``system``, ``q0`` and ``p0``."""

    def __init__(self, ratio: sp.Rational) -> None:
        q1, q2, p1, p2 = sp.symbols("q1 q2 p1 p2", real=True)
        H = (p1**2 + p2**2) / 2 + (q1**2 + ratio**2 * q2**2) / 2 + COUPLING * ratio * q1 * q2
        self.system = Hamiltonian(q=[q1, q2], p=[p1, p2], H=H, frequencies=[1, ratio])
        self.q0, self.p0 = (1.0, 0.0), (0.0, 0.0)


def radius(run: PreparedRun, h: float) -> float:
    """The spectral radius of the matrix of one step of length h on a linear system."""
    columns = [np.concatenate(run(h, 1, unit[:2], unit[2:])[:2]) for unit in np.eye(4)]
    return float(np.abs(np.linalg.eigvals(np.array(columns).T)).max())


def resonances(method: str) -> list[dict]:
    """The spectral radius of a step: a row for each ratio of the frequencies and each h."""
    rows = []
    for ratio in RATIOS:
        run, w = prepare(CoupledOscillators(ratio), BY_ID[method]), float(ratio)
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
    A = np.zeros((len(weights), len(weights)))
    for i, row in enumerate(rows):
        row = row if isinstance(row, (tuple, list)) else (row,)
        A[i, : len(row)] = [float(x) for x in row]
    return A, np.array([float(x) for x in weights])


RUNS = (
    Runs(STIFFNESS, stiffness, over(method=STIFF),
         needs=lambda method: (BY_ID[method], *(ProblemKey("fpu", (("omega", w),)) for w in OMEGAS))),
    Runs(SOLVERS, solvers, [{"method": id, "problem": on, "over": of} for id, on, of in MAPS],
         needs=lambda method, problem, **_: (BY_ID[method], ProblemKey(problem))),
    Runs(RESONANCES, resonances, over(method=COUPLED), needs=lambda method: (BY_ID[method], *map(str, RATIOS))),
    Runs(REGIONS, stability_functions, [{"regions": True}], needs=[BY_ID[id] for id in (*EXPLICIT, *IMPLICIT)]),
)  # fmt: skip
