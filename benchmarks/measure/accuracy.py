"""What a row of a sweep says: its error against the certified reference, and how the invariants are kept.

What is true is a stored state of the orbit's certificate, so that it is the same on every machine.  The error is taken
at the scene's end, or, of an orbit that parts from its neighbours, at the last stored time before the certificate's
horizon, up to which rounding to long double stays within 1e-13 of the state (`reference.certificates.horizon`, the same
on every machine): a double's error there is far above a stored state's uncertainty, and not yet as large as the orbit.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import cache
from typing import Any

import numpy as np

from phasebench.benchmarks.problems.scenes import BY_ID, Scene
from phasebench.benchmarks.rows.provenance import versions
from phasebench.integrators.driver import OK, Solution
from phasebench.reference.certificates import stored

from . import metrics
from .drift import POINTS, drift

#: The first part of a long run, in which also a chaotic trajectory can be measured again to all digits but a few.
EARLY = 0.05
#: Fewer steps than this say nothing of an early error.
LEAST = 10
#: Of a time that is a product n h.
ROUND_OFF = 4 * float(np.finfo(float).eps)
STORED, COMPUTED = "stored", "computed"


@dataclass(frozen=True)
class Truth:
    """Where an orbit is at a time.

    Attributes
    ----------
    t : the time
    texts : (q, p) as 2 d decimal strings
    uncertainty : of these, in the max norm
    horizon : up to which errors of trajectories may be told
    source : "stored", or "computed" where no certificate has this time
    """

    t: float
    texts: tuple[str, ...]
    uncertainty: float
    horizon: float
    source: str

    def error(self, state) -> float:
        """The max norm of a state (q, p), array (2 d,) of doubles, minus this one, without a round-off of its own."""
        with localcontext(prec=50):
            return float(max(abs(Decimal(float(x)) - Decimal(y)) for x, y in zip(state, self.texts, strict=True)))


@cache
def truth(scene: str) -> Truth:
    """What is true of a scene: at its end where that can be told, else at the last stored time that can."""
    wanted = BY_ID[scene]
    problem = wanted.made()
    certificate = stored.find(problem)
    if certificate is not None:
        horizon = min(certificate.horizon, wanted.t_end)
        ends = [e for e in certificate.ends if e.t <= horizon and (e.t == wanted.t_end or not wanted.regular)]
        if ends:
            last = ends[-1]
            return Truth(last.t, (*last.q_text, *last.p_text), last.uncertainty, horizon, STORED)
    return _computed(problem, wanted.t_end)


def _computed(problem, t: float) -> Truth:
    from phasebench.reference.certificates import horizon
    from phasebench.reference.solvers import taylor

    run = taylor.reference(problem, [t])
    reach = horizon.span(problem, t).horizon
    return Truth(t, (*run.q_text[0], *run.p_text[0]), float(run.uncertainty[0]), reach, COMPUTED)


def head(scene: Scene, problem, chosen, kind: str, *packages: str) -> dict[str, Any]:
    """What a row begins with: on what and of whom (a method or a peer) it is, with the versions of ``packages`` too."""
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
        "versions": ", ".join(f"{k} {versions().get(k, 'absent')}" for k in used),
    }


def end_state(solution, row: int = -1) -> np.ndarray:
    """(q, p) at the end of a solution or a reference, or in another row of it, array (2 d,)."""
    return np.concatenate([solution.q[row], solution.p[row]])


def trajectory_error(scene: Scene, solution: Solution) -> dict[str, float | str]:
    """The error of the trajectory where it can be told (`truth`); none where the solution has no row at that time."""
    true = truth(scene.id)
    out: dict[str, float | str] = {"reference_horizon": true.horizon}
    rows = np.flatnonzero(np.abs(solution.t - true.t) <= ROUND_OFF * true.t)
    if not len(rows) or true.t > true.horizon:
        return out
    error = true.error(end_state(solution, int(rows[-1])))
    out |= {"reference_uncertainty": true.uncertainty, "global_error": error, "global_error_time": true.t}
    return out | ({"reference": COMPUTED} if true.source == COMPUTED else {})


def invariants(problem, solution: Solution, t_end: float) -> dict[str, float]:
    """The largest error of the energy and of each invariant, and the energy's drift with its 95 % interval."""
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
