"""What tests read off a solution: its end, how far that is from another state, and errors of H and of invariants."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from phasebench.integrators.solution import Solution


def last(solution: Solution) -> np.ndarray:
    """Return the last state (q, p) of a solution, whatever its status."""
    return np.concatenate([solution.q[-1], solution.p[-1]])


def end(solution: Solution) -> np.ndarray:
    """Return the end state (q, p) of a solution; fail if its status is not "ok"."""
    assert solution.status == "ok", solution.reason
    return last(solution)


def rough_end(solution: Solution) -> np.ndarray:
    """Return the end state (q, p) of a run that reached its end, whatever its accuracy; fail if it did not."""
    assert solution.status in ("ok", "inaccurate", "unstable"), solution.reason
    return last(solution)


def apart(a: Iterable, b: Iterable) -> Any:
    """Return the largest difference of two sequences, entry by entry, a number of their kind."""
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


def energy_errors(solution: Solution) -> np.ndarray:
    """Return H - H0 along a solution, an array with an entry for each row."""
    H = solution.system.observe(solution.system.H, solution.q, solution.p)
    return H - H[0]


def relative_errors(solution: Solution) -> list[float]:
    """Return the largest relative errors along a solution, of H and of the system's other invariants."""
    system = solution.system
    values = [system.observe(e, solution.q, solution.p) for e in (system.H, *system.invariants)]
    return [float(np.abs(v / v[0] - 1).max()) for v in values]
