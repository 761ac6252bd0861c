r"""Methods for constraints beside ordinary ones on the index-reduced equations, and RATTLE iterated to a tolerance.

Three tables are measured:

- **Manifold**: the largest constraint and hidden constraint (its time derivative) over `SPAN`, the largest error of the
  energy, the error of the end state, the evaluations per step.
- **Drift**: the slope of the energy over a million steps of `rattle`, with its interval, on a sphere and on a molecule.
- **Tolerance**: the slope for a plain RATTLE whose multipliers are iterated to a tolerance of the constraints,
  as packages of molecular dynamics do.  One iteration for :math:`\tfrac12(|q|^2 - 1) = 0` moves q by
  :math:`-\frac{|q|^2 - 1}{2\,q\cdot q_0}\,q_0`, where q_0 is the q before the step; the momentum is projected with the
  last q.

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
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content, states
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import BY_ID

MANIFOLD, DRIFT, TOLERANCE = "constraints_manifold", "constraints_drift", "constraints_tolerance"
SPHERE, CARTESIAN = "spherical-pendulum", "double-pendulum-cartesian:regular"
PROBLEMS = (SPHERE, CARTESIAN)
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
#: Problem of a long run -> its step; 0.02 is 4 fs of the molecule.
LONG = {SPHERE: 0.05, "butane": 0.02}
#: Number of steps and of stored rows of the long runs.
STEPS, SAMPLES = 1_000_000, 2000
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
CODE = (__name__,)


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements to make (`Cell`): one for each method on each problem, each long run, each tolerance.

    The list is empty if ``quick``.
    """
    if quick:
        return []
    runs = [
        _cell(
            MANIFOLD, {"method": id, "problem": name}, manifold, (id, name), BY_ID[id], ProblemKey(name), states(name)
        )
        for name in PROBLEMS
        for id in (*BOUND, *ORDINARY)
    ]
    long = [_cell(DRIFT, {"problem": n}, long_run, (n,), BY_ID["rattle"], ProblemKey(n)) for n in LONG]
    loose = [_cell(TOLERANCE, {"tolerance": tol}, loose_run, (tol,), ProblemKey(SPHERE)) for tol in TOLERANCES]
    return runs + long + loose


def _cell(table: str, key: dict, measure: Callable, arguments: tuple, *needed: object) -> Cell:
    return Cell("constraints", (table,), key, measure, arguments, content(table, *arguments, *needed, code=CODE))


def manifold(id: str, name: str) -> Rows:
    """Integrate the problem ``name`` over `SPAN` with the method ``id``: one row, by table name.

    It has the errors in constraints, energy and end state, and the evaluations per step.
    """
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


def _slope(t: np.ndarray, energy: np.ndarray, h: float) -> dict[str, float]:
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
    """Measure the energy's drift over `STEPS` steps of `rattle` on the problem ``name``: one row, by table name."""
    s = integrate(problem_of(name), "rattle", h=LONG[name], steps=STEPS, save_every=STEPS // SAMPLES)
    row = {"method": "rattle", "problem": name, "status": s.status}
    return {DRIFT: [row | _slope(s.t, s.energy(), s.h)]}


def loose_run(tol: float) -> Rows:
    """Measure the energy's drift over `STEPS` steps of a RATTLE iterated to a tolerance: one row, by table name.

    ``tol`` is the tolerance of the constraint; the problem is the spherical pendulum.
    """
    problem, h = problem_of(SPHERE), LONG[SPHERE]
    energy, iterations = loose_rattle(np.array(problem.q0), np.array(problem.p0), h, STEPS, STEPS // SAMPLES, tol)
    t = h * (STEPS // SAMPLES) * np.arange(len(energy))
    return {TOLERANCE: [{"tolerance": tol, "problem": SPHERE, "iterations": iterations / STEPS} | _slope(t, energy, h)]}


@numba.njit
def loose_rattle(q: np.ndarray, p: np.ndarray, h: float, steps: int, every: int, tol: float) -> tuple[np.ndarray, int]:
    """Integrate the spherical pendulum by RATTLE, with the constraint iterated until abs(|q|^2 - 1) <= tol.

    It starts at (q, p) and takes ``steps`` steps h.  Returns (array of the energies at the start and after every
    ``every`` steps, total number of iterations).
    """
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
