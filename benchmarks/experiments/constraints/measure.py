r"""Methods for constraints beside ordinary ones on the index-reduced equations, and RATTLE iterated to a tolerance.

- **Manifold**: the largest constraint and hidden constraint over `SPAN`, the largest error of the energy, the error of
  the end state, the evaluations of a step.
- **Drift**: the slope of the energy over a million steps of `rattle`, with its interval; on a molecule, too (`butane`).
- **Tolerance**: the same of a plain RATTLE whose multipliers are iterated until the constraints are within a tolerance,
  as packages of molecular dynamics do.  One iteration for :math:`\tfrac12(|q|^2 - 1) = 0` moves q by
  :math:`-\frac{|q|^2 - 1}{2\,q\cdot q_0}\,q_0`; the momentum is projected with the last q.

Source: H. C. Andersen, J. Comput. Phys. 52 (1983) 24-34; J.-P. Ryckaert, G. Ciccotti, H. J. C. Berendsen, J. Comput.
Phys. 23 (1977) 327-341.
"""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np

from phasebench.benchmarks.measure.drift import drift
from phasebench.benchmarks.measure.global_error import end_error
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import BY_ID

from . import butane

MANIFOLD, DRIFT, TOLERANCE = "constraints_manifold", "constraints_drift", "constraints_tolerance"
SPHERE, CARTESIAN = "spherical-pendulum", "double-pendulum-cartesian:regular"
PROBLEMS = (SPHERE, CARTESIAN)
#: The molecule of long runs, and its step: 4 fs.
MOLECULE, MOLECULE_STEP = "butane", 0.02
#: Those for constraints, and ordinary ones on the index-reduced equations.
BOUND = (
    "rattle",
    "shake",
    "rattle-yoshida-4",
    "lobatto-iiia-iiib-constrained-2",
    "lobatto-iiia-iiib-constrained-4",
    "lobatto-iiia-iiib-constrained-6",
)
ORDINARY = ("rk4", "gauss-4")
#: Step and time span.
H, SPAN = 0.02, 100.0
#: Step, number of steps, stored rows of the long runs.
STEP, STEPS, SAMPLES = 0.05, 1_000_000, 2000
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
CODE = (__name__,)


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each method on each problem, for the long runs, for each tolerance; none if ``quick``."""
    if quick:
        return []
    runs = [
        _cell(MANIFOLD, {"method": id, "problem": name}, manifold, (id, name), BY_ID[id], ProblemKey(name))
        for name in PROBLEMS
        for id in (*BOUND, *ORDINARY)
    ]
    long = [
        _cell(DRIFT, {"problem": name}, long_run, (name,), BY_ID["rattle"], *needs)
        for name, needs in ((SPHERE, (ProblemKey(SPHERE),)), (MOLECULE, ()))
    ]
    loose = [_cell(TOLERANCE, {"tolerance": tol}, loose_run, (tol,), ProblemKey(SPHERE)) for tol in TOLERANCES]
    return runs + long + loose


def _cell(table: str, key: dict, measure: Callable, arguments: tuple, *needed) -> Cell:
    return Cell("constraints", (table,), key, measure, arguments, content(table, *arguments, *needed, code=CODE))


def manifold(id: str, name: str) -> Rows:
    """What a method keeps on a problem over `SPAN`: a row."""
    problem = problem_of(name)
    steps = round(SPAN / H)
    s = integrate(problem, id, h=H, steps=steps, save_every=1)
    drifts = {k: float(np.abs(v - v[0]).max()) for k, v in s.invariants().items()}
    energy = s.energy()
    row = {
        "method": id,
        "problem": name,
        "bound": id in BOUND,
        "status": s.status,
        "h": H,
        "constraint": max(v for k, v in drifts.items() if k.startswith("constraint")),
        "hidden constraint": max(v for k, v in drifts.items() if k.startswith("hidden")),
        "energy": float(np.abs(energy - energy[0]).max()),
        "evaluations": s.counts["gradient"] / steps,
    }
    error = end_error(problem, s, SPAN)
    return {MANIFOLD: [row | {"error": error["global_error"], "uncertainty": error["reference"]["uncertainty"]}]}


def _slope(t: np.ndarray, energy: np.ndarray, h: float = STEP) -> dict[str, float]:
    found = drift(t, energy - energy[0])
    return {
        "slope": found.value,
        "low": found.low,
        "high": found.high,
        "oscillation": float(np.abs(energy - energy[0]).max()),
        "steps": STEPS,
        "h": h,
    }


def long_run(name: str) -> Rows:
    """The energy's drift over `STEPS` steps of `rattle` on a problem or on the molecule: a row."""
    size = {"steps": STEPS, "save_every": STEPS // SAMPLES}
    if name == MOLECULE:
        q, p = butane.start()
        s = integrate(butane.system(), "rattle", h=MOLECULE_STEP, q0=q, p0=p, **size)
    else:
        s = integrate(problem_of(name), "rattle", h=STEP, **size)
    row = {"method": "rattle", "problem": name, "status": s.status}
    return {DRIFT: [row | _slope(s.t, s.energy(), s.h)]}


def loose_run(tol: float) -> Rows:
    """The energy's drift over as many steps of a RATTLE iterated to a tolerance: a row."""
    problem = problem_of(SPHERE)
    energy, iterations = loose_rattle(np.array(problem.q0), np.array(problem.p0), STEP, STEPS, STEPS // SAMPLES, tol)
    t = STEP * (STEPS // SAMPLES) * np.arange(len(energy))
    return {TOLERANCE: [{"tolerance": tol, "problem": SPHERE, "iterations": iterations / STEPS} | _slope(t, energy)]}


@numba.njit
def loose_rattle(q, p, h, steps, every, tol):
    """(energies of the stored rows, iterations) of RATTLE on the unit sphere, iterated until ||q|^2 - 1| <= tol."""
    energies = np.empty(steps // every + 1)
    energies[0] = 0.5 * (p @ p) + q[2]
    iterations = 0
    for n in range(1, steps + 1):
        p = p.copy()
        p[2] -= 0.5 * h
        new = q + h * p
        while True:
            excess = new @ new - 1.0
            iterations += 1
            if abs(excess) <= tol:
                break
            new = new - excess / (2.0 * (new @ q)) * q
        p = (new - q) / h
        q = new
        p[2] -= 0.5 * h
        p = p - (q @ p) / (q @ q) * q
        if n % every == 0:
            energies[n // every] = 0.5 * (p @ p) + q[2]
    return energies, iterations
