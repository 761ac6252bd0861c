"""The record `Probe` of a measurement that tests a talk's statement, and vector fields and maps that probes share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from phasebench.benchmarks.measure import step_map

#: The table of the probes.
TABLE = "talk_checks"


@dataclass(frozen=True)
class Probe:
    """A measurement that tests a statement of a talk, with a control.

    The control is the same number for a case in which the statement must fail.

    Attributes
    ----------
    id : name in kebab-case
    what, against : descriptions of the number and of the control
    measure : function without arguments that returns (number, control)
    methods, problems : ids of the methods and problems that it runs
    """

    id: str
    what: str
    against: str
    measure: Callable[[], tuple[float, float]]
    methods: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()


def flow(field: Callable, t: float, steps: int = 400) -> Callable:
    """Return the flow map y -> y(t) of y' = field(y), computed by ``steps`` classical Runge-Kutta steps."""
    h = t / steps

    def advance(y: Sequence[float] | np.ndarray) -> np.ndarray:
        y = np.array(y, float)
        for _ in range(steps):
            a = field(y)
            b = field(y + h / 2 * a)
            c = field(y + h / 2 * b)
            y = y + h / 6 * (a + 2 * b + 2 * c + field(y + h * c))
        return y

    return advance


def henon_heiles(y: np.ndarray) -> np.ndarray:
    """Return the Henon-Heiles vector field at y = (q1, q2, p1, p2), array (4,)."""
    q1, q2, p1, p2 = y
    return np.array([p1, p2, -q1 - 2 * q1 * q2, -q2 - q1 * q1 + q2 * q2])


def damped_pendulum(y: np.ndarray) -> np.ndarray:
    """Return the vector field of the pendulum with friction, which is not Hamiltonian, at y = (q, p): array (2,)."""
    return np.array([y[1], -np.sin(y[0]) - 0.1 * y[1]])


def pendulum(y: np.ndarray) -> np.ndarray:
    """Return the pendulum's vector field at y = (q, p): array (2,)."""
    return np.array([y[1], -np.sin(y[0])])


def defect(step: Callable, y: Sequence[float] | np.ndarray) -> float:
    """Return the symplecticity defect max |M^T J M - J|, M the Jacobian of the map ``step`` at y = (q, p)."""
    return step_map.symplecticity_defect(step_map.jacobian(step, np.array(y, float)))


def J(d: int) -> np.ndarray:
    """Return the structure matrix (0 I; -I 0) for d degrees of freedom, array (2 d, 2 d)."""
    return np.kron([[0.0, 1.0], [-1.0, 0.0]], np.eye(d))
