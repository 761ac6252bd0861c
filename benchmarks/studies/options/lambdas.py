r"""The parameter lambda of Schemes I and III, and of a composition of Scheme III, from -2 to 3.

Scheme I is (Q, P) = (q, p) + h f(lambda q + (1 - lambda) Q, lambda P + (1 - lambda) p) for the vector field f, and
Scheme III its composition with the adjoint.  The orbits of one ensemble differ in lambda and h.  The error constant of
Scheme I is :math:`\lambda - 1/2` times an elementary differential plus O(h); that of Scheme III is even about 1/2, a
sum :math:`C_0 + C_1 (\lambda - 1/2)^2`: if the two terms differ in sign, it is least away from 1/2.

Source: Y. Wang, Y. Bo, W. Cai, "A general symplectic integrator for canonical Hamiltonian systems" (talk), (19)-(21).
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from phasebench.benchmarks.measure.quantities import PARTS, TRAJECTORY, scale
from phasebench.benchmarks.measure.truths import truth
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.base import Problem
from phasebench.integrators.driver import OK, integrate
from phasebench.integrators.ensemble import Ensemble, integrate_ensemble

ERRORS, COSTS = "knobs_lambda", "knobs_lambda_costs"
METHODS = ("scheme-i", "scheme-iii", "scheme-iii-suzuki-4")
#: Orbit -> end time, steps of the coarsest run; all runs have this number times each factor of `FINER`.
SCENES = {
    "henon-heiles:box": (50.0, 500),
    "pendulum:swinging": (50.0, 500),
    "kepler": (20.0, 2000),
    "perturbed-kepler": (20.0, 2000),
    "lotka-volterra-log:4-2": (12.0, 600),
    "double-pendulum:regular": (20.0, 1000),
}
FINER = (1, 4)
#: The range of lambda; points per unit of lambda for errors, and for costs and largest steps; both grids hold 1/2.
LOW, HIGH, FINE, COARSE = -2, 3, 24, 6
#: Number of steps that a run must survive; step sizes tried, as multiples of the scene's; rows saved.
SURVIVED, LENGTHS, ROWS = 300, tuple(float(2 ** (k / 3)) for k in range(-6, 19)), 50
KEYS = [{"scene": scene, "method": method} for scene in SCENES for method in METHODS]


def grid(parts: int) -> list[Fraction]:
    """The values of lambda in steps of 1 / ``parts``."""
    return [Fraction(k, parts) for k in range(LOW * parts, HIGH * parts + 1)]


def run(made: Problem, method: str, lams: Sequence[Fraction], **how: object) -> Ensemble:
    """Orbits from the problem's start, one for each value of lambda."""
    starts = (np.tile(x, (len(lams), 1)) for x in (made.q0, made.p0))
    return integrate_ensemble(made, method, *starts, parameters={"lam": np.array(lams, dtype=object)}, **how)


def errors(
    made: Problem, method: str, lams: Sequence[Fraction], t_end: float, steps: int, true: np.ndarray
) -> list[tuple[float, float]]:
    """(Error at the end, largest error at equidistant times) for each lambda; infinite if a run stops.

    ``true`` has the exact states at these times, array (times, 2 d).
    """
    found = run(made, method, lams, t_end=t_end, steps=steps, save_every=steps // len(true))
    apart = np.abs(np.concatenate([found.Q, found.P], axis=2)[:, 1:] - true).max(axis=2)
    apart = np.where((found.status == OK)[:, None] & np.isfinite(apart), apart, np.inf)
    return [(float(row[-1]), float(row.max())) for row in apart]


def largest(made: Problem, method: str, lams: Sequence[Fraction], h: float) -> list[float]:
    """For each lambda the largest step, of `LENGTHS` times h, up to which every run survives; 0 if none does.

    A run survives if its status is ok and its energy error stays below the size of H's terms.
    """
    n = len(LENGTHS)
    steps = np.tile(h * np.array(LENGTHS), len(lams))
    found = run(made, method, np.repeat(lams, n), h=steps, steps=SURVIVED, save_every=SURVIVED // ROWS)
    with np.errstate(all="ignore"):
        H = np.array([made.system.observe(made.system.H, q, p) for q, p in zip(found.Q, found.P, strict=True)])
        off = np.abs(H - H[:, :1]).max(axis=1)
    survives = ((found.status == OK) & (off <= scale(made))).reshape(-1, n)
    counts = np.where(survives.all(axis=1), n, survives.argmin(axis=1))
    return [h * LENGTHS[k - 1] if k else 0.0 for k in counts]


def errors_of(scene: str, method: str) -> list[dict]:
    """Errors: a row for each lambda of the fine grid and number of steps."""
    made, (t_end, steps) = problem_of(scene), SCENES[scene]
    found, lams, rows = truth(made, TRAJECTORY, t_end), grid(FINE), []
    true = found.values.reshape(PARTS, -1)
    for factor in FINER:
        size = {"h": t_end / (factor * steps), "finer": factor, "uncertainty": found.uncertainty}
        for lam, (end, worst) in zip(lams, errors(made, method, lams, t_end, factor * steps, true), strict=True):
            rows.append({"lam": float(lam)} | size | {"end": end, "trajectory": worst})
    return rows


def costs_of(scene: str, method: str) -> list[dict]:
    """Gradients of a step and the largest step: a row for each lambda of the coarse grid."""
    made, (t_end, steps), rows = problem_of(scene), SCENES[scene], []
    h = t_end / steps
    for lam, longest in zip(grid(COARSE), largest(made, method, grid(COARSE), h), strict=True):
        s = integrate(made, method, parameters={"lam": lam}, h=h, steps=steps, save_every=steps)
        each = s.counts["gradient"] / max(1, s.counts["steps"])
        row = {"lam": float(lam), "h": h, "status": s.status, "gradients per step": each}
        rows.append(row | {"newton": s.counts["newton"], "largest h": longest, "survived": SURVIVED})
    return rows
