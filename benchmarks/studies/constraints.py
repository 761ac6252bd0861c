r"""Methods for constraints beside ordinary ones on the index-reduced equations, and RATTLE iterated to a tolerance.

Packages of molecular dynamics iterate the multipliers to a tolerance.  One iteration for
:math:`\tfrac12(|q|^2 - 1) = 0` moves q by :math:`-\frac{|q|^2 - 1}{2\,q\cdot q_0}\,q_0`, where q_0 is the q before the
step; the momentum is projected with the last q.

Source: H. C. Andersen, J. Comput. Phys. 52 (1983) 24-34; J.-P. Ryckaert, G. Ciccotti, H. J. C. Berendsen, J. Comput.
Phys. 23 (1977) 327-341.
"""

from __future__ import annotations

import numba
import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.drift import drift
from phasebench.benchmarks.measure.global_error import end_error
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Data
from phasebench.benchmarks.page.study import Claim, Curves, Runs, Shown, Study, over
from phasebench.benchmarks.page.verdict import EVERY, at_least, at_most
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import BY_ID

MANIFOLD, DRIFT, TOLERANCE = "constraints_manifold", "constraints_drift", "constraints_tolerance"
SPHERE, CARTESIAN = "spherical-pendulum", "double-pendulum-cartesian:regular"
LOBATTO = tuple(f"lobatto-iiia-iiib-constrained-{p}" for p in (2, 4, 6))
#: Methods for constraints, and ordinary ones on the index-reduced equations.
BOUND, ORDINARY = ("rattle", "shake", "rattle-yoshida-4", *LOBATTO), ("rk4", "gauss-4")
#: Step and time span; problem of a long run -> its step (0.02 is 4 fs of the molecule); its steps and stored rows.
H, SPAN = 0.02, 100.0
LONG = {SPHERE: 0.05, "butane": 0.02}
STEPS, SAMPLES = 1_000_000, 2000
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
#: A drift up to this is round-off; a usual tolerance of molecular dynamics: GROMACS's shake-tol (OpenMM's is 1e-5).
NO_DRIFT, USUAL = 1e-15, 1e-4
#: The interval of a drift holds 0, or is all round-off.
STILL = f"low <= 0 <= high or (abs(low) <= {NO_DRIFT} and abs(high) <= {NO_DRIFT})"


def manifold(method: str, problem: str) -> dict:
    """The largest change of a constraint, of a hidden one and of the energy, and the error of the end state."""
    made, steps = problem_of(problem), round(SPAN / H)
    s = integrate(made, method, h=H, steps=steps, save_every=1)
    moved = {k: float(np.abs(v - v[0]).max()) for k, v in s.invariants().items()}
    energy, error = s.energy(), end_error(made, s, SPAN)
    return {
        "bound": method in BOUND,
        "status": s.status,
        "h": H,
        "constraint": max(v for k, v in moved.items() if k.startswith("constraint")),
        "hidden constraint": max(v for k, v in moved.items() if k.startswith("hidden")),
        "energy": float(np.abs(energy - energy[0]).max()),
        "evaluations": s.counts["gradient"] / steps,
        "error": error["global_error"],
        "uncertainty": error["reference"]["uncertainty"],
    }


def _slope(t: np.ndarray, energy: np.ndarray, h: float) -> dict[str, float]:
    found = drift(t, energy - energy[0])
    about = {"slope": found.value, "low": found.low, "high": found.high}
    return about | {"oscillation": float(np.abs(energy - energy[0]).max()), "steps": STEPS, "h": h}


def long_run(problem: str) -> dict:
    """The drift of the energy over `STEPS` steps of `rattle`."""
    s = integrate(problem_of(problem), "rattle", h=LONG[problem], steps=STEPS, save_every=STEPS // SAMPLES)
    return {"method": "rattle", "problem": problem, "status": s.status} | _slope(s.t, s.energy(), s.h)


def loose_run(tolerance: float) -> dict:
    """The drift of the energy over `STEPS` steps of a RATTLE that is iterated to a tolerance."""
    made, h = problem_of(SPHERE), LONG[SPHERE]
    energy, iterations = loose_rattle(np.array(made.q0), np.array(made.p0), h, STEPS, STEPS // SAMPLES, tolerance)
    t = h * (STEPS // SAMPLES) * np.arange(len(energy))
    return {"problem": SPHERE, "iterations": iterations / STEPS} | _slope(t, energy, h)


@numba.njit
def loose_rattle(q: np.ndarray, p: np.ndarray, h: float, steps: int, every: int, tol: float) -> tuple[np.ndarray, int]:
    """The spherical pendulum by RATTLE, with the constraint iterated until abs(|q|^2 - 1) <= tol.

    Returns (the energies at the start (q, p) and after every ``every`` steps, total number of iterations).
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


def kept(rows: pd.DataFrame) -> pd.Series:
    """The largest constraint, hidden ones included but for SHAKE, whose momenta do not satisfy them."""
    hidden = rows["hidden constraint"].where(rows["method"] != "shake", 0.0)
    return pd.concat([rows["constraint"], hidden], axis=1).max(axis=1)


def intervals(rows: pd.DataFrame) -> str:
    """The interval of each long run."""
    words = (f"{r['problem']}: {number(r['low'])} to {number(r['high'])} per unit of time" for _, r in rows.iterrows())
    return "; ".join(words)


def converged(data: Data) -> float | None:
    """The size of the drift of the RATTLE that is solved to round-off, on the sphere."""
    rows = data(DRIFT)
    return None if rows is None else next(iter(rows.loc[rows["problem"] == SPHERE, "slope"].abs()), None)


STUDY = Study(
    id="constraints",
    place=280,
    question="Do methods for constraints stay on the manifold, and keep the energy?",
    answer="Methods for constraints stay on the manifold to {kept}; RATTLE's energy does not drift in {drift.n} of "
    f"{{drift.of}} long runs; iterated to {number(USUAL)}, it drifts by {{loose}} per unit time.",
    setting=(
        "q' = H_p, p' = -H_q - Gᵀλ with g(q) = 0: the motion is on the manifold where g and its rate G H_p, the "
        "hidden constraint, vanish.",
        f"A spherical pendulum ({SPHERE}) and a double pendulum in Cartesian coordinates ({CARTESIAN}).",
        "Ordinary methods run on the index-reduced equations, with λ as a function of (q, p) from the twice "
        "differentiated constraint.",
        f"Long runs: {STEPS} steps of h = {LONG[SPHERE]} on the spherical pendulum; the drift is the slope of H with "
        "its interval.",
        "A molecule: n-butane of four atoms, fixed bonds and angles, torsion of Ryckaert and Bellemans, steps of "
        f"h = {LONG['butane']}, 4 fs.",
    ),
    runs=(
        Runs(MANIFOLD, manifold, over(method=(*BOUND, *ORDINARY), problem=(SPHERE, CARTESIAN))),
        Runs(DRIFT, long_run, over(problem=tuple(LONG)), needs=(BY_ID["rattle"],)),
        Runs(TOLERANCE, loose_run, over(tolerance=TOLERANCES), needs=(ProblemKey(SPHERE),)),
    ),
    claims={
        "kept": Claim(
            "Methods for constraints keep constraints and hidden constraints to round-off",
            MANIFOLD, kept, at_most(1e-14), rows="bound", fault=True,
        ),
        "left": Claim(
            "The fourth-order Runge-Kutta method on the index-reduced equations leaves the manifold",
            MANIFOLD, "constraint", at_least(1e-9), rows="method == 'rk4'", where="{problem}", fault=True,
        ),
        "same": Claim(
            "The double pendulum in Cartesian coordinates ends in its certified state",
            MANIFOLD, "error", at_most(1e-13), rows=f"problem == '{CARTESIAN}' and method == '{LOBATTO[-1]}'",
            where="{method}", fault=True,
        ),
        "drift": Claim(
            "The energy of RATTLE does not drift over a million steps",
            DRIFT, STILL, EVERY, unit="long runs", where=intervals, fault=True,
        ),
        "loose": Claim(
            "RATTLE iterated to a usual tolerance keeps the energy as the converged one does",
            TOLERANCE, "abs(slope)", at_most(NO_DRIFT), rows=f"tolerance == {USUAL}", unit="per unit of time",
            where=lambda rows: f"tolerance {number(USUAL)}",
        ),
    },
    figure=(
        Curves(TOLERANCE, "tolerance", {"abs(slope)": "plain RATTLE, iterated"}, "tolerance of the constraints",
               "|drift of H| per unit of time", level=(converged, "rattle")),
    ),
    legend=2,
    title="drift of the energy against the tolerance",
    caption=f"Drift of the energy over {STEPS} steps of h = {LONG[SPHERE]} on the spherical pendulum, against the "
    "tolerance to which the constraint is iterated. Dashed: `rattle`, whose multipliers are solved to round-off.",
    shown=Shown(
        MANIFOLD,
        ("problem", "method", "constraint", "hidden constraint", "energy", "error", "uncertainty", "evaluations"),
        "Largest change of a constraint, of a hidden one and of the energy, the error of the end state with the "
        "reference's uncertainty, and evaluations of the forces a step.",
    ),
    limits=(
        "The tolerance is of one constraint; GROMACS's `shake-tol` is 1e-4 and OpenMM's default 1e-5, relative to a "
        "length. Their other constraint solvers (LINCS, SETTLE) are not measured here.",
        "The certified state of the double pendulum in Cartesian coordinates agrees with that in angles: a test "
        "compares them.",
        "That the methods are symplectic on the manifold is measured without round-off, with controls, by the tests.",
    ),
)  # fmt: skip
