"""What a check is, and what several of them use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from phasebench.benchmarks.measure import metrics

#: The table of the checks.
TABLE = "talk_checks"


@dataclass(frozen=True)
class Check:
    """A measurement.

    Attributes
    ----------
    id : kebab-case
    what, against : what its number is of, and what its control is of
    measure : () -> (number, control)
    methods, problems : of the suite, that it runs
    """

    id: str
    what: str
    against: str
    measure: Callable[[], tuple[float, float]]
    methods: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()


def flow(field: Callable, t: float, steps: int = 400) -> Callable:
    """The map of time ``t`` of y' = field(y), by the classical Runge-Kutta method."""
    h = t / steps

    def moved(y):
        y = np.array(y, float)
        for _ in range(steps):
            a = field(y)
            b = field(y + h / 2 * a)
            c = field(y + h / 2 * b)
            y = y + h / 6 * (a + 2 * b + 2 * c + field(y + h * c))
        return y

    return moved


def henon_heiles(y):
    """Its vector field at y = (q, p)."""
    q1, q2, p1, p2 = y
    return np.array([p1, p2, -q1 - 2 * q1 * q2, -q2 - q1 * q1 + q2 * q2])


def damped(y):
    """The pendulum with friction, which is not Hamiltonian."""
    return np.array([y[1], -np.sin(y[0]) - 0.1 * y[1]])


def pendulum(y):
    """Its vector field at y = (q, p)."""
    return np.array([y[1], -np.sin(y[0])])


def defect(step: Callable, y) -> float:
    """How far the Jacobian of a map at y is from symplectic."""
    return metrics.symplecticity_defect(metrics.jacobian(step, np.array(y, float)))


def J(d: int) -> np.ndarray:
    """The matrix (0 I; -I 0)."""
    return np.kron([[0.0, 1.0], [-1.0, 0.0]], np.eye(d))
