"""The error of one integration against a reference of stated uncertainty, for ``integrate --error``."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp

from phasebench.benchmarks.measure import quantities, truths
from phasebench.benchmarks.measure.quantities import END_STATE, TRAJECTORY, Quantity, Truth
from phasebench.benchmarks.problems.base import Orbit, Problem
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.request import initial
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from phasebench.reference.certificates import followed, horizon, stored
from phasebench.reference.solvers.taylor import ReferenceFailed

if TYPE_CHECKING:
    from phasebench.benchmarks.measure.integrator import Integrator
    from phasebench.integrators.keywords import State
    from phasebench.integrators.solution import Solution
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

#: A reference whose uncertainty exceeds this share of the state's size gives no error.
KNOWN = 0.01


def with_start(
    problem: Problem | PartitionedSystem, q0: State | None = None, p0: State | None = None, tangent: bool = True
) -> Problem:
    """Return a problem with another initial state q0, p0, arrays (d,), under a new id that has no certificate.

    The problem is returned unchanged if neither is given.  A bare system, which needs both, is wrapped in a problem.
    Raises InvalidInput for a state that does not fit the system; with ``tangent`` its momenta must fulfil the hidden
    constraints, too.
    """
    if isinstance(problem, Problem) and q0 is None and p0 is None:
        return problem
    system, q, p = initial(problem, q0, p0, tangent=tangent)
    orbit = Orbit("given", tuple(q.tolist()), tuple(p.tolist()))
    if not isinstance(problem, Problem):
        return Problem("given", "a system of one's own", "", system, (orbit,))
    return replace(problem, id=f"{problem.id} from a given state", orbits=(orbit,), orbit="")


def onwards(
    problem: Problem, solution: Solution | SimpleNamespace, span: float
) -> tuple[Problem, SimpleNamespace, float]:
    """Restate a run as one from time 0 forward, to compare it with a reference; return (problem, solution, span).

    ``span`` is t_end - t0, negative for a run back in time; the one returned is positive.  The solution returned has
    only t (n,), q and p (n, d).  A run back in time becomes a run forward of the problem with -H in place of H.

    Raises InvalidInput for a negative span of a system that is not canonical or has no formula of H.
    """
    sign = 1.0 if span > 0 else -1.0
    rows = SimpleNamespace(t=sign * (solution.t - solution.t[0]), q=solution.q, p=solution.p)
    if span > 0:
        return problem, rows, span
    system = problem.system
    if not (system.canonical and isinstance(system.H, sp.Basic)):
        raise InvalidInput("the error of a span back in time is told of canonical systems with a formula of H alone")
    back = Hamiltonian(q=system.q, p=system.p, H=-system.H)
    return replace(problem, id=f"{problem.id} back in time", system=back), rows, -span


def end_error(problem: Problem, solution: Solution | SimpleNamespace, span: float) -> dict[str, Any]:
    """Return the error of a solution's last state and the reference used: a dict {global_error, reference}.

    ``global_error`` is the max norm over (q, p).  It is None if ``span`` (t_end - t0) exceeds the horizon of the orbit,
    and if the reference fails or is too uncertain.  ``reference`` is a dict with uncertainty, horizon and source, and
    with a reason if there is no error.
    """
    problem, solution, t_end = onwards(problem, solution, span)
    try:
        true = truths.truth(problem, END_STATE, t_end)
        reach = orbit_horizon(problem, t_end)
    except ReferenceFailed as error:
        return {"global_error": None, "reference": {"uncertainty": None, "horizon": None, "reason": str(error)}}
    reference = {"uncertainty": true.uncertainty, "horizon": reach, "source": true.source}
    why = past(reach, t_end) or vague(true)
    if why:
        return {"global_error": None, "reference": reference | {"reason": why}}
    return {"global_error": quantities.error(problem, END_STATE, solution, true), "reference": reference}


def orbit_horizon(problem: Problem, t_end: float) -> float:
    """Return the last time, at most ``t_end``, to which a reference in long double can follow the problem's orbit.

    It is read from the orbit's certificate, or computed.
    """
    certificate = stored.find(problem) if hasattr(problem, "orbits") else None
    if certificate is not None and t_end <= certificate.t_end:
        return min(certificate.horizon, t_end)
    return followed.reach(problem, t_end)


def past(reach: float, t_end: float) -> str:
    """Return a sentence that tells why no error of the state at ``t_end`` is given; "" if ``t_end`` <= ``reach``.

    ``reach`` is the orbit's horizon, the last time to which a reference in long double follows the orbit.
    """
    if t_end <= reach:
        return ""
    return (
        f"the orbit cannot be followed to t = {t_end:g}: past its horizon, t = {reach:.4g}, rounding to long double "
        f"moves it by more than {horizon.LIMIT:g} of its size"
    )


def vague(true: Truth) -> str:
    """Return a sentence that tells how uncertain a reference value is, if it is too uncertain to measure errors with.

    The sentence is "" if the uncertainty of the value is at most `KNOWN` times its size.
    """
    size = float(np.abs(true.values).max())
    if true.uncertainty <= KNOWN * size:
        return ""
    return f"the reference is known to {true.uncertainty:.2g} alone, of {size:.2g}"


def unknown_truth(problem: Problem, wanted: Quantity, t_end: float, true: Truth) -> str:
    """Return the reason why a quantity has no meaningful error at ``t_end`` against its true value; "" if it has one.

    Raises reference.solvers.taylor.ReferenceFailed if the horizon of a state cannot be computed.
    """
    why = past(orbit_horizon(problem, t_end), t_end) if wanted in (END_STATE, TRAJECTORY) else ""
    return why or ("" if wanted.kept or wanted.angle else vague(true))


def known_truth(problem: Problem, wanted: Quantity, t_end: float) -> Truth:
    """Return the true value of a quantity at ``t_end``, with its uncertainty.

    Raises InvalidInput, with the reason, if the value cannot be computed or is too uncertain to measure errors with.
    """
    try:
        true = truths.truth(problem, wanted, t_end)
        why = unknown_truth(problem, wanted, t_end, true)
    except ReferenceFailed as error:
        why = str(error)
    if why:
        raise InvalidInput(f"there is no reference of {problem.label} to t = {t_end:g}: {why}")
    return true


def quantity_error(
    problem: Problem, integrator: Integrator, wanted: Quantity, t_end: float, size: dict
) -> dict[str, Any]:
    """Run an integrator and return the error of a quantity, a dict {quantity, error, uncertainty}.

    The run saves the rows that the quantity needs; ``size`` is {"steps": number} or {"tol": tolerance}.  The error is
    None, and the dict has a ``reason``, for a state past the horizon and if the reference fails or is too uncertain.
    Raises InvalidInput if the quantity needs rows at equidistant times, and the number of steps is not a multiple of
    their number.
    """
    try:
        true = truths.truth(problem, wanted, t_end)
        why = unknown_truth(problem, wanted, t_end, true)
    except ReferenceFailed as error:
        return {"quantity": wanted.name, "error": None, "uncertainty": None, "reason": str(error)}
    if "steps" in size and wanted.steps(size["steps"]) != size["steps"]:
        raise InvalidInput(
            f"{wanted.name} is told from {wanted.rows} equidistant times: the number of steps, {size['steps']}, must "
            f"be a multiple; {wanted.steps(size['steps'])} is the nearest"
        )
    if why:
        return {"quantity": wanted.name, "error": None, "uncertainty": true.uncertainty, "reason": why}
    solution = integrator.run(problem, t_end=t_end, **wanted.grid(**size))
    error = quantities.error(problem, wanted, solution, true)
    return {"quantity": wanted.name, "error": error, "uncertainty": true.uncertainty}
