"""The error of one integration against what is true, with how well that is known: what ``integrate --error`` says."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import sympy as sp

from phasebench.benchmarks.measure import quantities, truths
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.quantities import END_STATE, TRAJECTORY, Quantity, Truth
from phasebench.benchmarks.problems.base import Orbit
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from phasebench.reference.certificates import followed, horizon, stored
from phasebench.reference.solvers.taylor import ReferenceFailed

#: A reference that is not known to this share of the state's size tells no error.
KNOWN = 0.01


def started(problem, q0=None, p0=None):
    """The problem from another initial state, under an id of its own: nothing is certified of it."""
    if q0 is None and p0 is None:
        return problem
    q, p = (problem.q0 if q0 is None else q0), (problem.p0 if p0 is None else p0)
    orbit = Orbit("given", tuple(map(float, q)), tuple(map(float, p)))
    return replace(problem, id=f"{problem.id} from a given state", orbits=(orbit,), orbit="")


def onwards(problem, solution, span: float):
    """(problem, solution, span) with times from 0 on: a span back in time is one of -H onwards.

    Raises InvalidInput for a span back in time of a system that is not canonical or has no formula.
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


def end_error(problem, solution, span: float) -> dict[str, Any]:
    """``global_error``, the max norm over (q, p) at the end, and the ``reference`` it was told by.

    None past the horizon, and where the reference fails or is not known well enough: ``reference`` has the reason.
    """
    problem, solution, t_end = onwards(problem, solution, span)
    try:
        true = truths.truth(problem, END_STATE, t_end)
        reach = reached(problem, t_end)
    except ReferenceFailed as error:
        return {"global_error": None, "reference": {"uncertainty": None, "horizon": None, "reason": str(error)}}
    reference = {"uncertainty": true.uncertainty, "horizon": reach, "source": true.source}
    why = past(reach, t_end) or vague(true)
    if why:
        return {"global_error": None, "reference": reference | {"reason": why}}
    return {"global_error": quantities.error(problem, END_STATE, solution, true), "reference": reference}


def reached(problem, t_end: float) -> float:
    """The horizon, of the certificate or looked for, or ``t_end`` where that is before it."""
    certificate = stored.find(problem) if hasattr(problem, "orbits") else None
    if certificate is not None and t_end <= certificate.t_end:
        return min(certificate.horizon, t_end)
    return followed.reach(problem, t_end)


def past(reach: float, t_end: float) -> str:
    """Why no error of a state is told at ``t_end``; empty where one is."""
    if t_end <= reach:
        return ""
    return (
        f"the orbit cannot be followed to t = {t_end:g}: past its horizon, t = {reach:.4g}, rounding to long double "
        f"moves it by more than {horizon.LIMIT:g} of its size"
    )


def vague(true: Truth) -> str:
    """Why nothing is compared with what is true; empty where it is known to `KNOWN` of its size."""
    size = float(np.abs(true.values).max())
    if true.uncertainty <= KNOWN * size:
        return ""
    return f"the reference is known to {true.uncertainty:.2g} alone, of {size:.2g}"


def quantity_error(problem, integrator: Integrator, wanted: Quantity, t_end: float, size: dict) -> dict[str, Any]:
    """A quantity's error in a run of its own, with the rows that it is told from; ``size`` is steps or tol.

    None of a state past the horizon, and where what is true is not known well enough, with the reason.
    """
    try:
        true = truths.truth(problem, wanted, t_end)
        why = past(reached(problem, t_end), t_end) if wanted in (END_STATE, TRAJECTORY) else ""
    except ReferenceFailed as error:
        return {"quantity": wanted.name, "error": None, "uncertainty": None, "reason": str(error)}
    if "steps" in size and wanted.steps(size["steps"]) != size["steps"]:
        raise InvalidInput(
            f"{wanted.name} is told from {wanted.rows} equidistant times: the number of steps, {size['steps']}, must "
            f"be a multiple; {wanted.steps(size['steps'])} is the nearest"
        )
    why = why or ("" if wanted.kept or wanted.angle else vague(true))
    if why:
        return {"quantity": wanted.name, "error": None, "uncertainty": true.uncertainty, "reason": why}
    solution = integrator.run(problem, t_end=t_end, **wanted.grid(**size))
    error = quantities.error(problem, wanted, solution, true)
    return {"quantity": wanted.name, "error": error, "uncertainty": true.uncertainty}
