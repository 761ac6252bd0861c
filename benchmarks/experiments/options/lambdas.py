r"""The parameter lambda of Schemes I and III, and of a composition of Scheme III, from -2 to 3.

Scheme I is (Q, P) = (q, p) + h f(lambda q + (1 - lambda) Q, lambda P + (1 - lambda) p) for the vector field f, and
Scheme III its composition with the adjoint.  At a fixed h: the error at the end, the largest error at `PARTS` times,
the iterations of a step, and the largest h at which runs survive.  The orbits of one ensemble (`pb.integrate_ensemble`)
differ in lambda and h.  The error constant of Scheme I is :math:`\lambda - 1/2` times an elementary differential plus
O(h); that of Scheme III is even about 1/2, a sum :math:`C_0 + C_1 (\lambda - 1/2)^2`: if the two terms differ in sign,
it is least away from 1/2.

Source: Y. Wang, Y. Bo, W. Cai, "A general symplectic integrator for canonical Hamiltonian systems" (talk), (19)-(21).
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.benchmarks.measure.quantities import PARTS, TRAJECTORY, scale
from phasebench.benchmarks.measure.truths import truth
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, Unavailable, content
from phasebench.integrators.driver import OK, integrate
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.registry import method

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem

ERRORS, COSTS = "knobs_lambda", "knobs_lambda_costs"
METHODS = ("scheme-i", "scheme-iii", "scheme-iii-suzuki-4")


class Sight(NamedTuple):
    """An orbit on which a scheme is compared with all values of its parameter lambda.

    Attributes
    ----------
    problem : id and orbit, such as "pendulum:swinging"
    t_end : end time
    steps : number of steps of the coarsest run; the runs have this number times each factor of `FINER`
    """

    problem: str
    t_end: float
    steps: int


SCENES = (
    Sight("henon-heiles:box", 50.0, 500),
    Sight("pendulum:swinging", 50.0, 500),
    Sight("kepler", 20.0, 2000),
    Sight("perturbed-kepler", 20.0, 2000),
    Sight("lotka-volterra-log:4-2", 12.0, 600),
    Sight("double-pendulum:regular", 20.0, 1000),
)
FINER = (1, 4)
#: The range of lambda; points per unit of lambda for errors, and for iterations and largest steps; both grids hold 1/2.
LOW, HIGH, PARTS_OF_ONE, COARSE = -2, 3, 24, 6
#: Number of steps that a run must survive; step sizes tried, as multiples of the scene's.
SURVIVED, LENGTHS = 300, tuple(float(2 ** (k / 3)) for k in range(-6, 19))
ROWS = 50


def grid(parts: int) -> list[Fraction]:
    """Return the values of a scheme's parameter lambda from `LOW` to `HIGH` in steps of 1 / ``parts``."""
    return [Fraction(k, parts) for k in range(LOW * parts, HIGH * parts + 1)]


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each orbit and each method with a parameter lambda; none if ``quick``."""
    return [] if quick else [_cell(k, id) for k in range(len(SCENES)) for id in METHODS]


def _cell(k: int, id: str) -> Cell:
    sight = SCENES[k]
    needs = content("lambda", tuple(sight), method(id), ProblemKey(sight.problem), code=[__name__])
    key = {"scene": sight.problem, "method": id}
    return Cell(
        "options", (ERRORS, COSTS), key, measure_rows, (k, id), needs, frozenset({id, sight.problem.partition(":")[0]})
    )


def errors(
    made: Problem, id: str, lams: Sequence[Fraction], t_end: float, steps: int, true: np.ndarray
) -> list[tuple[float, float]]:
    """Return (error at the end, largest error at equidistant times) for each value of a method's parameter lambda.

    ``made`` is the problem, ``id`` the method, ``lams`` are the values of lambda.  ``true`` is an array (times, 2 d):
    the exact states at these times.  Errors are in the max norm, and infinite if a run stops.
    """
    n = len(lams)
    found = integrate_ensemble(
        made,
        id,
        np.tile(made.q0, (n, 1)),
        np.tile(made.p0, (n, 1)),
        t_end=t_end,
        steps=steps,
        parameters={"lam": np.array(lams, dtype=object)},
        save_every=steps // len(true),
    )
    apart = np.abs(np.concatenate([found.Q, found.P], axis=2)[:, 1:] - true).max(axis=2)
    apart = np.where((found.status == OK)[:, None] & np.isfinite(apart), apart, np.inf)
    return [(float(row[-1]), float(row.max())) for row in apart]


def largest(made: Problem, id: str, lams: Sequence[Fraction], h: float) -> list[float]:
    """Return, for each value of a method's parameter lambda, the largest step up to which every run survives.

    ``made`` is the problem, ``id`` the method, ``lams`` are the values of lambda; the steps tried are `LENGTHS` times
    ``h``.  A run has `SURVIVED` steps, and survives if its status is ok and its energy error stays below the size of
    H's terms; 0 if no run survives.
    """
    n = len(LENGTHS)
    found = integrate_ensemble(
        made,
        id,
        np.tile(made.q0, (len(lams) * n, 1)),
        np.tile(made.p0, (len(lams) * n, 1)),
        h=np.tile(h * np.array(LENGTHS), len(lams)),
        steps=SURVIVED,
        parameters={"lam": np.repeat(np.array(lams, dtype=object), n)},
        save_every=SURVIVED // ROWS,
    )
    with np.errstate(all="ignore"):
        H = [made.system.observe(made.system.H, q, p) for q, p in zip(found.Q, found.P, strict=True)]
        off = np.abs(np.array(H) - np.array(H)[:, :1]).max(axis=1)
    survives = ((found.status == OK) & (off <= scale(made))).reshape(-1, n)
    counts = np.where(survives.all(axis=1), n, survives.argmin(axis=1))
    return [h * LENGTHS[k - 1] if k else 0.0 for k in counts]


def measure_rows(k: int, id: str) -> Rows:
    """Measure the errors, cost and largest step of the method ``id`` for each value of its parameter lambda.

    The orbit is ``SCENES[k]``.  Returns {`ERRORS`: rows, `COSTS`: rows}, with a row for each lambda (in `ERRORS` also
    for each of two step sizes).  Raises Unavailable if the reference solution fails.
    """
    from phasebench.reference.solvers.taylor import ReferenceFailed

    name, t_end, steps = SCENES[k]
    made = problem(name)
    try:
        found = truth(made, TRAJECTORY, t_end)
    except ReferenceFailed as error:
        raise Unavailable(str(error)) from None
    true = found.values.reshape(PARTS, -1)
    common, fine, coarse = {"scene": name, "method": id}, grid(PARTS_OF_ONE), grid(COARSE)
    rows, costs = [], []
    for factor in FINER:
        size = {"h": t_end / (factor * steps), "finer": factor, "uncertainty": found.uncertainty}
        for lam, (end, worst) in zip(fine, errors(made, id, fine, t_end, factor * steps, true), strict=True):
            rows.append(common | {"lam": float(lam)} | size | {"end": end, "trajectory": worst})
    h = t_end / steps
    for lam, longest in zip(coarse, largest(made, id, coarse, h), strict=True):
        run = integrate(made, id, parameters={"lam": lam}, h=h, steps=steps, save_every=steps)
        each = run.counts["gradient"] / max(1, run.counts["steps"])
        row = {"lam": float(lam), "h": h, "status": run.status, "gradients per step": each}
        costs.append(common | row | {"newton": run.counts["newton"], "largest h": longest, "survived": SURVIVED})
    return {ERRORS: rows, COSTS: costs}
