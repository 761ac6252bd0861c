"""Errors of solutions against references, and references with a wrong digit."""

from __future__ import annotations

from typing import Any

import numpy as np

from phasebench.integrators.solution import Solution
from phasebench.reference.solvers import taylor


def error(solution: Solution, made: Any) -> float:
    """Return the largest error of the rows of a solution against the reference of the problem ``made``."""
    truth = taylor.reference(made, solution.t, certify=False)
    return float(np.abs(np.hstack([solution.q - truth.q, solution.p - truth.p])).max())


def spoilt(text: str, place: int = 20) -> str:
    """Return a decimal string with one decimal, the 20th or the one at ``place``, changed by 5."""
    at = text.index(".") + place
    return f"{text[:at]}{(int(text[at]) + 5) % 10}{text[at + 1 :]}"
