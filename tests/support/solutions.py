"""What tests read off a solution: its end, and errors of H."""

from __future__ import annotations

import numpy as np

from phasebench.integrators.solution import Solution


def last(solution: Solution) -> np.ndarray:
    """Return the last state (q, p) of a solution, whatever its status."""
    return np.concatenate([solution.q[-1], solution.p[-1]])


def end(solution: Solution) -> np.ndarray:
    """Return the end state (q, p) of a solution; fail if its status is not "ok"."""
    assert solution.status == "ok", solution.reason
    return last(solution)


def energy_errors(solution: Solution) -> np.ndarray:
    """Return H - H0 along a solution, an array with an entry for each row."""
    H = solution.system.observe(solution.system.H, solution.q, solution.p)
    return H - H[0]
