"""The error of one integration against a reference of stated uncertainty, for ``integrate --error``."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks.measure import quantities, truths
from phasebench.benchmarks.measure.quantities import END_STATE, TRAJECTORY, Quantity, Truth
from phasebench.benchmarks.problems.base import Orbit, Problem
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.request import initial
from phasebench.reference.certificates import followed, horizon, stored
from phasebench.reference.solvers.taylor import ReferenceFailed

if TYPE_CHECKING:
    from phasebench.benchmarks.measure.integrator import Integrator
    from phasebench.integrators.keywords import State
    from phasebench.integrators.solution import Solution
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

#: Past the horizon, and if the reference's uncertainty exceeds the share `KNOWN` of the state's size, an error is given
#: only where that uncertainty is at most the share `RESOLVED` of the error.
KNOWN, RESOLVED = 0.01, 0.25


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


def end_error(problem: Problem, solution: Solution | SimpleNamespace, span: float) -> dict[str, Any]:
    """Return the error of a solution's last state and the reference used: a dict {global_error, reference}.

    ``global_error`` is the max norm over (q, p), None with a ``reason`` in the reference if that fails, or is past the
    horizon or vague and does not resolve the error (`RESOLVED`).  ``span`` is t_end - t0, negative for a run back.
    """
    try:
        true = truths.truth(problem, END_STATE, span)
        reach = orbit_horizon(problem, span)
    except ReferenceFailed as error:
        return {"global_error": None, "reference": {"uncertainty": None, "horizon": None, "reason": str(error)}}
    rows = SimpleNamespace(t=solution.t, q=solution.q, p=solution.p)
    error = quantities.error(problem, END_STATE, rows, true)
    reference = {"uncertainty": true.uncertainty, "horizon": reach, "source": true.source}
    why = "" if true.uncertainty <= RESOLVED * error else past(reach, abs(span)) or vague(true)
    if why:
        return {"global_error": None, "reference": reference | {"reason": _least(why, true)}}
    return {"global_error": error, "reference": reference}


def _least(why: str, true: Truth) -> str:
    return f"{why}; an error of {true.uncertainty / RESOLVED:.2g} or more could be told"


def orbit_horizon(problem: Problem, t_end: float) -> float:
    """Return the last time, at most ``|t_end|``, to which a reference in long double follows the orbit."""
    certificate = stored.find(problem) if hasattr(problem, "orbits") else None
    if certificate is not None and 0 < t_end <= certificate.t_end:
        return min(certificate.horizon, t_end)
    return followed.reach(truths.onwards(problem, t_end), abs(t_end))


def past(reach: float, t_end: float) -> str:
    """Return a sentence that tells why no error of the state at ``t_end`` is given; "" up to the horizon ``reach``."""
    if t_end <= reach:
        return ""
    return (
        f"the orbit cannot be followed to t = {t_end:g}: past its horizon, t = {reach:.4g}, rounding to long double "
        f"moves it by more than {horizon.LIMIT:g} of its size"
    )


def vague(true: Truth, angle: bool = False) -> str:
    """Return a sentence if a reference is less certain than the share `KNOWN` of its size (pi for an angle), or ""."""
    size = pi if angle else float(np.abs(true.values).max())
    if true.uncertainty <= KNOWN * size:
        return ""
    return f"the reference is known to {true.uncertainty:.2g} alone, of {size:.2g}"


def known_truth(problem: Problem, wanted: Quantity, t_end: float) -> Truth:
    """Return the true value of a quantity at ``t_end``; raise InvalidInput if it is unknown or too uncertain."""
    try:
        true = truths.truth(problem, wanted, t_end)
        why = "" if wanted.kept else vague(true, wanted.angle)
    except ReferenceFailed as error:
        why = str(error)
    if why:
        raise InvalidInput(f"there is no reference of {problem.label} to t = {t_end:g}: {why}")
    return true


def quantity_error(
    problem: Problem, integrator: Integrator, wanted: Quantity, t_end: float, size: dict
) -> dict[str, Any]:
    """Run an integrator and return the error of a quantity, a dict {quantity, error, uncertainty, unit}.

    ``size`` is {"steps": number} or {"tol": tolerance}.  The error is None, with a ``reason``, if it is not known (as
    in `end_error`).  Raises InvalidInput for a number of steps that is no multiple of the rows that the quantity needs.
    """
    if "steps" in size and wanted.steps(size["steps"]) != size["steps"]:
        raise InvalidInput(
            f"{wanted.name} is told from {wanted.rows} equidistant times: the number of steps, {size['steps']}, must "
            f"be a multiple; {wanted.steps(size['steps'])} is the nearest"
        )
    found: dict[str, Any] = {"quantity": wanted.name, "error": None, "uncertainty": None, "unit": wanted.unit}
    try:
        true = truths.truth(problem, wanted, t_end)
        error = quantities.error(problem, wanted, integrator.run(problem, t_end=t_end, **wanted.grid(**size)), true)
        why = ""
        if not wanted.kept and true.uncertainty > RESOLVED * error:
            state = wanted in (END_STATE, TRAJECTORY)
            why = past(orbit_horizon(problem, t_end), abs(t_end)) if state else ""
            why = why or vague(true, wanted.angle)
    except ReferenceFailed as failed:
        return found | {"reason": str(failed)}
    found["uncertainty"] = true.uncertainty
    return found | ({"reason": _least(why, true)} if why else {"error": error})
