r"""Conservation that a user can demand of an integration: what a method declares, and whether its run satisfies it.

``symplectic`` and ``reversible`` are properties of the step map; ``energy`` and ``momentum`` (invariants q.D p, such as
linear and angular momentum) are conserved to round-off; an invariant of the problem may be named too.  Declarations
decide which methods are tried.  What can be measured is verified: the invariants over the rows of the run, and
symplecticity of a step of constant size at the initial state, :math:`\max_{ij}|M^T J M - J|`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import inf
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from phasebench.benchmarks.measure import step_map
from phasebench.benchmarks.measure.integrator import OURS, YOURS, Integrator
from phasebench.integrators.driver import OK
from phasebench.integrators.errors import unknown_name
from phasebench.integrators.record import EXACT, ROUND_OFF
from phasebench.reference.peers import Peer

if TYPE_CHECKING:
    from phasebench.benchmarks.advice.ask import Ask
    from phasebench.benchmarks.problems.base import Problem

SYMPLECTIC, REVERSIBLE, ENERGY, MOMENTUM = "symplectic", "reversible", "energy", "momentum"
#: Largest error of a conserved invariant, in units of eps times its terms times the square root of the steps.
UNITS = 100.0
#: Largest defect that central differences give for a symplectic step.
DEFECT = 1e-8
#: Defects at two displacements within this factor belong to the step; otherwise to the differences.
SAME = 4.0
#: Number of steps from which the sizes of q and p are taken.
LOOKED = 16
#: Number of rows on which invariants are evaluated.
ROWS = 1000
EPS = float(np.finfo(float).eps)


def claim_names(problem: Problem) -> list[str]:
    """Return the names of all properties that a user can demand of an integration of a problem."""
    return [SYMPLECTIC, REVERSIBLE, ENERGY, MOMENTUM, *problem.invariants]


def check(problem: Problem, name: str) -> None:
    """Raise InvalidInput, with the nearest known name, if ``name`` is not in `claim_names` of the problem."""
    if name not in claim_names(problem):
        raise unknown_name("conserved quantity", str(name), claim_names(problem))


def declaration(integrator: Integrator, name: str) -> bool | None:
    """Return whether an integrator is declared to have the property ``name`` (see `claim_names`); None if unknown.

    For a peer or a user's own step, "symplectic" and "reversible" are False unless declared, and all other properties
    are None.  For a method of this project only invariants of the problem are None.
    """
    record = integrator.record
    if integrator.kind == OURS:
        return {
            SYMPLECTIC: record.symplectic,
            REVERSIBLE: record.symmetric,
            ENERGY: record.energy in (EXACT, ROUND_OFF),
            MOMENTUM: record.quadratic in (EXACT, ROUND_OFF),
        }.get(name)
    claims = record.claims
    if integrator.kind == YOURS:
        return bool(claims.get(name)) if name in (SYMPLECTIC, REVERSIBLE) else None
    return {SYMPLECTIC: bool(claims.symplectic), REVERSIBLE: bool(claims.reversible)}.get(name)


def refusal(integrator: Integrator, conserve: Iterable[str]) -> str | None:
    """Return a sentence that names the demanded properties that an integrator is declared to lack, or None."""
    lacking = [name for name in conserve if declaration(integrator, name) is False]
    whose = "its package does not state" if isinstance(integrator.record, Peer) else "it is not declared to keep or be"
    return f"{whose} what has to be conserved: {', '.join(lacking)}" if lacking else None


def broken(integrator: Integrator, ask: Ask, size: dict) -> str | None:
    """Run an integrator and return a sentence on the first demanded property that fails; None if none does.

    ``size`` is {"steps": number} or {"tol": tolerance}.  Symplecticity is measured for fixed steps, reversibility not
    at all; invariants are compared over the run's rows.
    """
    names = [name for name in ask.conserve if name not in (SYMPLECTIC, REVERSIBLE)]
    for name, (error, bound) in _errors(integrator, ask, size, names).items():
        if not error <= bound:
            return f"its run does not keep {name}: the error is {error:.2g}, of round-off {bound:.2g}"
    if SYMPLECTIC in ask.conserve and "steps" in size:
        defect = symplecticity_defect(integrator, ask.problem, ask.t_end / size["steps"])
        if not defect <= DEFECT:
            return f"its step is not symplectic: the defect is {defect:.2g}"
    return None


def expressions(problem: Problem, name: str) -> dict[str, sp.Expr]:
    """Return name -> invariant for a demanded property: H, all invariants q.D p + b.p, or the one of this name."""
    if name == ENERGY:
        return {ENERGY: problem.system.H}
    if name != MOMENTUM:
        return {name: problem.invariants[name]}
    system = problem.system
    return {n: e for n, e in problem.invariants.items() if _bilinear(sp.sympify(e), system.q, system.p)}


def _bilinear(expression: sp.Expr, q: Sequence[sp.Symbol], p: Sequence[sp.Symbol]) -> bool:
    """True if an expression has the form q.D p + b.p: linear in p and at most linear in q."""
    try:
        polynomial = sp.Poly(expression, *q, *p)
    except sp.PolynomialError:
        return False
    d = len(q)
    return all(sum(m[d:]) == 1 and sum(m[:d]) <= 1 for m in polynomial.monoms())


def _errors(integrator: Integrator, ask: Ask, size: dict, names: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Run it; return invariant -> (largest error over the rows, infinite if it fails; bound by round-off)."""
    wanted = {k: e for name in names for k, e in expressions(ask.problem, name).items()}
    if not wanted:
        return {}
    solution = integrator.run(ask.problem, t_end=ask.t_end, **rows(size))
    if solution.status != OK:
        return dict.fromkeys(wanted, (inf, 0.0))
    system, count = ask.problem.system, max(1, solution.counts["steps"])
    found = {}
    for name, expression in wanted.items():
        value = system.observe(expression, solution.q, solution.p)
        terms = sp.Add.make_args(sp.expand(expression))
        scale = sum(np.abs(system.observe(t, solution.q, solution.p)).max() for t in terms)
        bound = UNITS * EPS * float(scale) * count**0.5
        found[name] = float(np.abs(value - value[0]).max()), bound
    return found


def rows(size: dict) -> dict:
    """Return the keyword arguments of `Integrator.run` for about `ROWS` saved rows, with ``size`` as in `broken`."""
    if "steps" in size:
        return size | {"save_every": max(1, size["steps"] // ROWS)}
    return size | {"steps": ROWS, "save_every": 1}


def symplecticity_defect(integrator: Integrator, problem: Problem, h: float) -> float:
    """Return max |M^T J M - J| for the Jacobian M of a step h at the start, q and p in units of their sizes.

    It is 0 if finite differences cannot resolve it (two displacements give different values, or a step fails).  Of a
    planetary system massive bodies count alone, since the momenta of test particles cannot be displaced.
    """
    if hasattr(problem, "massive"):
        problem = problem.massive()
    if problem is None:
        return 0.0
    d = len(problem.q0)
    start = np.array([*problem.q0, *problem.p0], float)
    units = np.repeat(_sizes(integrator, problem, h), d)

    def step(x: np.ndarray) -> np.ndarray:
        y = x * units
        solution = integrator.run(problem, h=h, steps=1, q0=y[:d], p0=y[d:])
        end = np.concatenate([solution.q[-1], solution.p[-1]]) if solution.status == OK else np.full(2 * d, np.nan)
        return end / units

    first = EPS**0.2
    defects = [step_map.symplecticity_defect(step_map.jacobian(step, start / units, x)) for x in (first, first / 4)]
    low, high = min(defects), max(defects)
    return float(low) if np.isfinite(high) and high <= SAME * low else 0.0


def _sizes(integrator: Integrator, problem: Problem, h: float) -> list[float]:
    """Return [largest |q_i|, largest |p_i|] over the first `LOOKED` steps of size h; 1 in place of 0."""
    solution = integrator.run(problem, h=h, steps=LOOKED)
    return [float(np.nanmax(np.abs(x))) or 1.0 for x in (solution.q, solution.p)]
