"""The largest relative energy error along a trajectory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem


def energy_error(made: Problem, q: np.ndarray, p: np.ndarray) -> float:
    """Return the largest |H / H_0 - 1| over states q, p, arrays (n, d), of the problem ``made``; H_0 is the first H."""
    E = made.system.observe(made.system.H, q, p)
    return float(np.abs(E / E[0] - 1).max())
