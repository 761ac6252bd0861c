"""Measures of an adaptive integrator: error and energy error against the tolerance, and whether repeated runs agree."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from phasebench.benchmarks.measure import own_step
from phasebench.integrators.errors import InvalidInput

from .battery import Entry
from .order import flow
from .stepping import StepFailed, report_failures
from .subject import Subject

#: The time of a run, in the unit of time of a test system, and the tolerances.
T_END = 4.0
#: The reference's uncertainty is at most this share of the state.
KNOWN = 1e-12
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)


def run(
    subject: Subject, entry: Entry, system: own_step.System, state: Iterable, t_end: float, tol: float
) -> np.ndarray:
    """Run an adaptive integrator from the state (q, p) to the time t_end: array (2 d,); raises StepFailed."""
    with report_failures(subject, f"the run on {entry.name} with tol = {tol:g}"):
        pair = subject.run(system, *state, t_end, tol)
    try:
        return np.concatenate(own_step.check_pair(pair, system.d))
    except InvalidInput as error:
        raise StepFailed(str(error)) from None


def end(subject: Subject, entry: Entry, y: np.ndarray, tol: float) -> tuple[np.ndarray, int]:
    """The state after `T_END` units of time, and the evaluations; raises StepFailed, or InputChanged."""
    system, d = own_step.System(entry.system), entry.system.d
    q, p = y[:d].copy(), y[d:].copy()
    state = run(subject, entry, system, (q, p), T_END * entry.unit, tol)
    if not (np.array_equal(q, y[:d]) and np.array_equal(p, y[d:])):
        raise InputChanged
    return state, sum(system.evaluations)


class InputChanged(Exception):
    """Raised for a run that changed the q or p it was given."""


class Unknown(Exception):
    """Raised for a test system whose reference is too uncertain."""


def tolerances(subject: Subject, entry: Entry, seed: int) -> dict:
    """Run an adaptive integrator on a system at each of `TOLERANCES`: a row of the certificate.

    Errors are relative to the end state's largest component, infinite where no number; ``energy`` is |H - H(0)| at the
    end.  Raises Unknown if the reference is too uncertain.
    """
    y, errors, energies, counts = entry.start(seed), [], [], []
    exact, doubt = flow(entry, seed, T_END * entry.unit, 32)
    truth = exact.astype(float)
    if not float(doubt) <= KNOWN * float(np.abs(truth).max()):
        raise Unknown(f"the reference on {entry.name} is known to {float(doubt):.0e} only")
    size, d = float(np.abs(truth).max()), entry.system.d
    states = []
    for tol in TOLERANCES:
        state, evaluations = end(subject, entry, y, tol)
        states.append(state)
        rows = np.array([y, state])
        H = entry.system.observe(entry.system.H, rows[:, :d], rows[:, d:])
        error = float(np.abs(state - truth).max()) / size
        errors.append(error if np.isfinite(error) else np.inf)
        energies.append(float(abs(H[1] - H[0])))
        counts.append(evaluations)
    again = end(subject, entry, y, TOLERANCES[0])[0]
    return {
        "on": entry.name,
        "tolerances": list(TOLERANCES),
        "errors": errors,
        "energy": energies,
        "evaluations": counts,
        "repeats": bool(np.array_equal(again, states[0])),
    }
