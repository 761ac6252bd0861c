"""The energy error of rows of states, relative to the first."""

from __future__ import annotations

import numpy as np


def energy_error(made, q, p) -> float:
    """The largest relative energy error of states q, p, arrays (n, d), of a problem."""
    E = made.system.observe(made.system.H, q, p)
    return float(np.abs(E / E[0] - 1).max())
