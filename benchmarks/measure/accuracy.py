"""What a row of a sweep says: its error against the certified reference, and how the invariants are kept.

The error is taken at the end, or at the last saved time before the reference's horizon, up to which the reference's
uncertainty is at most 1e-13 of the state.  What a method in double precision rounds grows with time as the reference's
uncertainty does, from an epsilon 2048 times as large: its error stays well above the uncertainty of the reference.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from phasebench.benchmarks.problems.scenes import BY_ID, Scene
from phasebench.benchmarks.rows.provenance import versions
from phasebench.integrators.driver import OK, Solution

from . import metrics

#: The first part of a long run, in which also a chaotic trajectory can be measured again to all digits but a few.
EARLY = 0.05
#: Fewer steps than this say nothing of an early error.
LEAST = 10
#: Times at which the reference's uncertainty is looked at for its horizon.
GRID = 1000


@cache
def reference(scene: str):
    """The scene's certified trajectory on a grid that ends at its end; a `reference.taylor.Reference`."""
    from phasebench.reference.solvers import taylor

    made = BY_ID[scene]
    before = [made.t_end * (i + 1) / GRID for i in range(GRID - 1)]
    return taylor.reference(made.made(), [*before, made.t_end])


@cache
def _truth(scene: str, t: float):
    """The certified state at one time as (array (2 d,) of (q, p), uncertainty)."""
    from phasebench.reference.solvers import taylor

    found = reference(scene) if t == BY_ID[scene].t_end else taylor.reference(BY_ID[scene].made(), [t])
    return end_state(found), float(found.uncertainty[-1])


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


def trajectory_error(scene: Scene, solution: Solution) -> dict[str, float]:
    """The error of the trajectory at the last saved time at which the reference can be trusted; none before that."""
    horizon = reference(scene.id).horizon()
    out = {"reference_horizon": horizon}
    if horizon >= scene.t_end:
        state, t = end_state(solution), scene.t_end
    else:
        last = int(np.searchsorted(solution.t, horizon, side="right")) - 1
        if last < 1:
            return out
        state, t = end_state(solution, last), float(solution.t[last])
    truth, uncertainty = _truth(scene.id, t)
    error = float(np.abs(state - truth).max())
    return out | {"reference_uncertainty": uncertainty, "global_error": error, "global_error_time": t}


def invariants(problem, solution: Solution, t_end: float) -> dict[str, float]:
    """The largest error of the energy and of each invariant, and the energy's drift with its 95 % interval."""
    out: dict[str, float] = {}
    H = problem.system.observe(problem.system.H, solution.q, solution.p)
    good = np.isfinite(H)
    error = metrics.energy_error(H[good])
    out["energy_max"], out["energy_end"] = error.max, error.end
    early = good & (solution.t <= EARLY * t_end)
    if early.sum() > LEAST:
        out["energy_max_early"] = metrics.energy_error(H[early]).max
    if good.sum() >= 4 * metrics.BLOCKS and solution.status == OK:
        slope = metrics.drift(solution.t, H - H[0])
        out |= {"energy_drift": slope.value, "energy_drift_low": slope.low, "energy_drift_high": slope.high}
    for name, expression in problem.invariants.items():
        value = problem.system.observe(expression, solution.q, solution.p)
        out[f"{name}_max"] = float(np.abs(value - value[0])[np.isfinite(value)].max())
    return out
