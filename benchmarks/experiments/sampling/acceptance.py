r"""The expected acceptance of Hamiltonian Monte Carlo with each method, at equal numbers of gradient evaluations.

A proposal is a run over the time T from a state (q, p) that is drawn from the density :math:`e^{-H}`; it is accepted
with the probability :math:`\min(1, e^{-\Delta H})`.  The mean of this probability over independent draws is the
expected acceptance in the stationary state, with a normal interval; no chain is run, and there is no burn-in.  All
methods get the same draws.

.. math::
    H = \tfrac12 |p|^2 + \sum_{i=1}^{d} v(\omega_i q_i),\qquad \omega_i = 2 i,

with :math:`v(x) = x^2/2`, the Gaussian target, or :math:`v(x) = x^2/2 + x^4/4`, the quartic one, for which x is drawn
by rejection from the normal density.  The budget of a run is its number of gradient evaluations: a method with n
evaluations a step has h = T n / budget; a kick with a gradient of the force counts as two.

Source: S. Blanes, F. Casas, J. M. Sanz-Serna, SIAM J. Sci. Comput. 36 (2014) A1556-A1580.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks.store.cells import Cell, Rows, content
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.registry import BY_ID
from phasebench.integrators.systems.hamiltonian import Hamiltonian

if TYPE_CHECKING:
    from phasebench.integrators.ensemble import Ensemble

TABLE = "sampling_acceptance"
#: Degrees of freedom, length of a proposal's run, number of proposals, seed of the draws.
D, TIME, DRAWS, SEED = 8, 2.25, 1500, 30
#: Target -> v(x).
TARGETS = {"Gaussian": "x**2/2", "quartic": "x**2/2 + x**4/4"}
#: Target -> evaluations of the gradient in a run, such that the frequencies are resolved.
BUDGETS = {"Gaussian": (36, 48, 72, 96), "quartic": (72, 96, 144, 192)}
#: Standard deviations of a normal mean's 95 % interval.
NORMAL = 1.96
VERLET = "stormer-verlet"
#: Method -> evaluations of the gradient in a step.
STAGES = {
    VERLET: 1,
    "mclachlan-s2": 2,
    "omelyan-2": 2,
    "blanes-casas-sanz-serna-2": 2,
    "blanes-casas-sanz-serna-3": 3,
    "predescu-3": 3,
    "blanes-casas-sanz-serna-4": 4,
    "pefrl": 4,
}
GRADIENTS = {"takahashi-imada": 2, "chin-4a": 3, "hessian-free-badab": 3, "omelyan-4-3f1g-p": 4}
EVALUATIONS = STAGES | GRADIENTS


def system(target: str) -> Hamiltonian:
    """Return the Hamiltonian system of a target, H = |p|^2 / 2 + sum of v(2 i q_i) over i = 1, ..., `D`.

    ``target`` is a key of `TARGETS`, which has the formula of v(x).
    """
    q, p = ([f"{x}{i}" for i in range(1, D + 1)] for x in "qp")
    terms = [TARGETS[target].replace("x", f"({2 * i}*q{i})") for i in range(1, D + 1)]
    return Hamiltonian(q=q, p=p, H=f"({' + '.join(f'{x}**2' for x in p)})/2 + {' + '.join(terms)}")


def draws(target: str, n: int = DRAWS) -> tuple[np.ndarray, np.ndarray]:
    """Draw ``n`` independent states from the density exp(-H) of a target: (q, p), arrays (n, `D`).

    ``target`` is a key of `TARGETS`.  The seed is fixed, so that every method gets the same states.
    """
    generator = np.random.default_rng(SEED)
    p = generator.standard_normal((n, D))
    x = generator.standard_normal((n, D))
    if target == "quartic":
        rejected = generator.random((n, D)) > np.exp(-(x**4) / 4)
        while rejected.any():
            x[rejected] = generator.standard_normal(rejected.sum())
            rejected[rejected] = generator.random(rejected.sum()) > np.exp(-(x[rejected] ** 4) / 4)
    return x / (2 * np.arange(1, D + 1)), p


def budgets(target: str, method: str) -> list[int]:
    """List the budgets (numbers of gradient evaluations of a run) that are a whole number of steps of a method.

    They are chosen from ``BUDGETS[target]``; ``method`` is the method's id.
    """
    return [budget for budget in BUDGETS[target] if budget % EVALUATIONS[method] == 0]


def propose(of: Hamiltonian, q: np.ndarray, p: np.ndarray, method: str, budget: int) -> Ensemble:
    """Integrate a proposal of Hamiltonian Monte Carlo from each of the states q, p, arrays (n, D), on one thread.

    ``of`` is the target's system; ``budget`` is the number of gradient evaluations of a proposal by the method.
    Returns an `Ensemble`, with the end states.
    """
    steps = budget // EVALUATIONS[method]
    return integrate_ensemble(of, method, q, p, h=TIME / steps, steps=steps, threads=1)


def acceptance(target: str, method: str, budget: int, n: int = DRAWS) -> dict[str, float]:
    """Measure the mean probability with which Hamiltonian Monte Carlo accepts a method's proposals.

    A proposal is a trajectory of ``budget`` gradient evaluations.
    Returns a dict: "acceptance", "low" and "high" (its 95 % interval), "failed" (number of failed runs, which count as
    rejected) and "median energy error" (the median of |Delta H|).  ``n`` is the number of proposals; ``target`` is a
    key of `TARGETS`.
    """
    of, (q, p) = system(target), draws(target, n)
    found = propose(of, q, p, method, budget)
    reached = np.isclose(found.t, TIME)
    with np.errstate(all="ignore"):
        error = np.where(reached, of.energies(found.q, found.p) - of.energies(q, p), np.inf)
        accepted = np.exp(-np.clip(error, 0.0, 700.0)) * np.isfinite(error)
    half = NORMAL * accepted.std(ddof=1) / np.sqrt(n)
    mean = float(accepted.mean())
    return {
        "acceptance": mean,
        "low": float(max(0.0, mean - half)),
        "high": float(min(1.0, mean + half)),
        "failed": int((~reached).sum()),
        "median energy error": float(np.median(np.abs(error))),
    }


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each method on each target; none if ``quick``."""
    return [] if quick else [_cell(target, method) for target in TARGETS for method in EVALUATIONS]


def _cell(target: str, method: str) -> Cell:
    return Cell(
        "sampling",
        (TABLE,),
        {"target": target, "method": method},
        measure_rows,
        (target, method),
        content("acceptance", target, BY_ID[method], code=[__name__]),
        frozenset({method}),
    )


def measure_rows(target: str, method: str) -> Rows:
    """Measure the expected acceptance of a method on a target of Hamiltonian Monte Carlo: rows, by table name.

    There is a row for each budget: a number of gradient evaluations of a run that is a whole number of steps.
    """
    each = EVALUATIONS[method]
    about = {"target": target, "method": method, "evaluations per step": each}
    return {
        TABLE: [
            about | {"budget": budget, "h": TIME * each / budget} | acceptance(target, method, budget)
            for budget in budgets(target, method)
        ]
    }
