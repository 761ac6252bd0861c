"""The record `Probe`, and functions that several probes share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from phasebench.benchmarks.measure import step_map

#: The table of the probes.
TABLE = "talk_checks"


@dataclass(frozen=True)
class Probe:
    """A measurement for a statement, with a control: the same number for a case in which the statement must fail.

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
    """The flow map of y' = field(y) over time ``t``, computed with the classical Runge-Kutta method."""
    h = t / steps

    def advance(y):
        y = np.array(y, float)
        for _ in range(steps):
            a = field(y)
            b = field(y + h / 2 * a)
            c = field(y + h / 2 * b)
            y = y + h / 6 * (a + 2 * b + 2 * c + field(y + h * c))
        return y

    return advance


def henon_heiles(y):
    """The Henon-Heiles vector field at y = (q, p)."""
    q1, q2, p1, p2 = y
    return np.array([p1, p2, -q1 - 2 * q1 * q2, -q2 - q1 * q1 + q2 * q2])


def damped_pendulum(y):
    """The vector field of the pendulum with friction, which is not Hamiltonian, at y = (q, p)."""
    return np.array([y[1], -np.sin(y[0]) - 0.1 * y[1]])


def pendulum(y):
    """The pendulum's vector field at y = (q, p)."""
    return np.array([y[1], -np.sin(y[0])])


def defect(step: Callable, y) -> float:
    """The symplecticity defect max |M^T J M - J| of the Jacobian M of a map at y."""
    return step_map.symplecticity_defect(step_map.jacobian(step, np.array(y, float)))


def J(d: int) -> np.ndarray:
    """The matrix (0 I; -I 0), array (2 d, 2 d)."""
    return np.kron([[0.0, 1.0], [-1.0, 0.0]], np.eye(d))
