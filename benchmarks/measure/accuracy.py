"""Errors of a sweep's runs against the certified reference, and how they conserve the invariants.

The reference is a stored state of the orbit's certificate, hence the same on every machine.  The error is taken at the
scene's end or, for an orbit with sensitive dependence, at the last stored time before the certificate's horizon.  Up
to the horizon, rounding to long double stays within 1e-13 of the state (`reference.certificates.horizon`): an error in
doubles is then far above the uncertainty of a stored state, and not yet as large as the orbit.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import cache
from typing import Any

import numpy as np

from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.scenes import BY_ID, Scene
from phasebench.integrators.driver import OK, Solution
from phasebench.reference.certificates import stored
from phasebench.reference.installed import version_of

from . import metrics
from .drift import POINTS, drift

#: Share of a long run in which the error of a chaotic trajectory can still be reproduced to a few digits.
EARLY = 0.05
#: Smallest number of rows for an early error.
LEAST = 10
#: Relative round-off of a time computed as a product n h.
ROUND_OFF = 4 * float(np.finfo(float).eps)
STORED, COMPUTED = "stored", "computed"


@dataclass(frozen=True)
class Truth:
    """The true state of an orbit at a time.

    Attributes
    ----------
    t : the time
    texts : (q, p) as 2 d decimal strings
    uncertainty : of the state, in the max norm
    horizon : the last time up to which errors of trajectories are meaningful
    source : "stored", or "computed" if no certificate has this time
    """

    t: float
    texts: tuple[str, ...]
    uncertainty: float
    horizon: float
    source: str

    def error(self, state) -> float:
        """Error in the max norm of a state (q, p), array (2 d,) of doubles; computed without round-off."""
        with localcontext(prec=50):
            return float(max(abs(Decimal(float(x)) - Decimal(y)) for x, y in zip(state, self.texts, strict=True)))


@cache
def truth(scene: str) -> Truth:
    """The true state of a scene's orbit: at its end, or if that is past the horizon, at the last stored time before."""
    wanted = BY_ID[scene]
    problem = problem_of(wanted.problem)
    certificate = stored.find(problem)
    if certificate is not None:
        horizon = min(certificate.horizon, wanted.t_end)
        ends = [e for e in certificate.ends if e.t <= horizon and (e.t == wanted.t_end or not wanted.regular)]
        if ends:
            last = ends[-1]
            return Truth(last.t, (*last.q_text, *last.p_text), last.uncertainty, horizon, STORED)
    return _compute_truth(problem, wanted.t_end)


def _compute_truth(problem, t: float) -> Truth:
    from phasebench.reference.certificates import horizon
    from phasebench.reference.solvers import taylor

    run = taylor.reference(problem, [t])
    reach = horizon.span(problem, t).horizon
    return Truth(t, (*run.q_text[0], *run.p_text[0]), float(run.uncertainty[0]), reach, COMPUTED)


def head(scene: Scene, problem, chosen, kind: str, *packages: str) -> dict[str, Any]:
    """The first columns of a result row: scene, problem, integrator (``chosen``, a method or peer), versions."""
    used = ("phasebench", "numpy", "numba", *packages)
    return {
        "scene": scene.id,
        "purpose": scene.purpose,
        "problem": problem.label,
        "method": chosen.label,
        "id": chosen.id,
        "kind": kind,
        "t_end": scene.t_end,
        "declared_order": chosen.order,
        "versions": ", ".join(f"{k} {version_of(k) or 'absent'}" for k in used),
    }


def end_state(solution, row: int = -1) -> np.ndarray:
    """(q, p) in the last row of a solution or a reference, or in another row, array (2 d,)."""
    return np.concatenate([solution.q[row], solution.p[row]])


def trajectory_error(scene: Scene, solution: Solution) -> dict[str, float | str]:
    """Columns with a solution's error against the true state of the scene; no error if no row has that state's time."""
    true = truth(scene.id)
    out: dict[str, float | str] = {"reference_horizon": true.horizon}
    rows = np.flatnonzero(np.abs(solution.t - true.t) <= ROUND_OFF * true.t)
    if not len(rows) or true.t > true.horizon:
        return out
    error = true.error(end_state(solution, int(rows[-1])))
    out |= {"reference_uncertainty": true.uncertainty, "global_error": error, "global_error_time": true.t}
    return out | ({"reference": COMPUTED} if true.source == COMPUTED else {})


def invariants(problem, solution: Solution, t_end: float) -> dict[str, float]:
    """Columns with the largest error of the energy and of each invariant, and the energy's drift with 95 % interval."""
    out: dict[str, float] = {}
    H = problem.system.observe(problem.system.H, solution.q, solution.p)
    good = np.isfinite(H)
    error = metrics.invariant_error(H[good])
    out["energy_max"], out["energy_end"] = error.max, error.end
    early = good & (solution.t <= EARLY * t_end)
    if early.sum() > LEAST:
        out["energy_max_early"] = metrics.invariant_error(H[early]).max
    if good.sum() >= POINTS and solution.status == OK:
        slope = drift(solution.t, H - H[0])
        out |= {"energy_drift": slope.value, "energy_drift_low": slope.low, "energy_drift_high": slope.high}
    for name, expression in problem.invariants.items():
        value = problem.system.observe(expression, solution.q, solution.p)
        out[f"{name}_max"] = float(metrics.invariant_error(value[np.isfinite(value)]).max)
    return out
