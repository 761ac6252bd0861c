"""Errors of an integrator's runs on a scene: of the final state against a certified reference, and of the invariants.

A scene is a problem on an orbit with a time span and step sizes.  The reference is a stored state of the orbit's
certificate (stored states with their uncertainty), hence the same on every machine.  The error is taken at the scene's
end or, for an orbit with sensitive dependence, at the last stored time before the certificate's horizon.  Up to the
horizon, rounding to long double moves the orbit by at most 1e-13 of its size (`reference.certificates.horizon`): the
error of a run in doubles is then far above the uncertainty of a stored state, and not yet as large as the orbit.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.scenes import BY_ID, Scene
from phasebench.integrators.driver import OK, Solution
from phasebench.reference.certificates import stored
from phasebench.reference.installed import version_of

from . import metrics
from .drift import POINTS, drift

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.record import Method
    from phasebench.reference.peers import Peer
    from phasebench.reference.solvers.taylor import Reference

#: Share of a long run in which the error of a chaotic trajectory can still be reproduced to a few digits.
EARLY = 0.05
#: Smallest number of rows for an early error.
LEAST = 10
#: Relative round-off of a time computed as a product n h.
ROUND_OFF = 4 * float(np.finfo(float).eps)
STORED, COMPUTED = "stored", "computed"


@dataclass(frozen=True)
class Truth:
    """The true state of an orbit at one time, with its uncertainty.

    Attributes
    ----------
    t, texts : the time; the components of (q, p) as 2 d decimal strings
    uncertainty, horizon : of the state, in the max norm; the last time to which errors of trajectories are meaningful
    source : "stored" in the orbit's certificate, or "computed" now since no certificate has this time
    """

    t: float
    texts: tuple[str, ...]
    uncertainty: float
    horizon: float
    source: str

    def error(self, state: np.ndarray) -> float:
        """Return the max norm of ``state``, (q, p) as an array (2 d,), minus the true state, without round-off."""
        with localcontext(prec=50):
            return float(max(abs(Decimal(float(x)) - Decimal(y)) for x, y in zip(state, self.texts, strict=True)))


@cache
def truth(scene: str) -> Truth:
    """Return the true state of a scene (its id) at its end or, if the orbit is chaotic, the last known one.

    It is the last one stored before the scene's end and the horizon; if there is none, that at the end is computed.
    """
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


def _compute_truth(problem: Problem, t: float) -> Truth:
    from phasebench.reference.certificates import horizon
    from phasebench.reference.solvers import taylor

    run = taylor.reference(problem, [t])
    reach = horizon.span(problem, t).horizon
    return Truth(t, (*run.q_text[0], *run.p_text[0]), float(run.uncertainty[0]), reach, COMPUTED)


def head(scene: Scene, problem: Problem, chosen: Method | Peer, kind: str, *packages: str) -> dict[str, Any]:
    """Return the first columns of a row: what was integrated by ``chosen`` of origin ``kind``, with which versions."""
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


def end_state(solution: Solution | Reference, row: int = -1) -> np.ndarray:
    """Return the state (q, p), array (2 d,), in the last row of a solution or a reference, or in row ``row``."""
    return np.concatenate([solution.q[row], solution.p[row]])


def trajectory_error(scene: Scene, solution: Solution) -> dict[str, float | str]:
    """Return columns of a row, name -> value, with a solution's error against the true state of its orbit.

    Only ``reference_horizon`` is returned if no row of the solution has the time of the true state, or if this time is
    past the horizon.
    """
    true = truth(scene.id)
    out: dict[str, float | str] = {"reference_horizon": true.horizon}
    rows = np.flatnonzero(np.abs(solution.t - true.t) <= ROUND_OFF * true.t)
    if not len(rows) or true.t > true.horizon:
        return out
    error = true.error(end_state(solution, int(rows[-1])))
    out |= {"reference_uncertainty": true.uncertainty, "global_error": error, "global_error_time": true.t}
    return out | ({"reference": COMPUTED} if true.source == COMPUTED else {})


def invariants(problem: Problem, solution: Solution, t_end: float) -> dict[str, float]:
    """Return columns of a row, name -> value, with a solution's errors of the energy and the invariants.

    ``energy_max_early`` is the largest over the first part of the span (the share `EARLY`); ``energy_drift`` the
    secular slope, with its 95 % interval.  What cannot be computed (too few rows, a failed run) is left out.
    """
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
