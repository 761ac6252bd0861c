"""Code for peers of molecular dynamics: H = sum p_i^2 / 2 m_i + V(q) as particles with masses on parallel lines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import Hamiltonian, PartitionedSystem

WHY = "its particles have masses: H must be a sum of p_i^2 / 2 m_i, and V(q)"
SCOPE = "H = sum p_i^2 / 2 m_i + V(q)"


def lacks(problem: Any, system: PartitionedSystem) -> str | None:
    """Why particles with masses cannot represent a system, with the form of H that they need; None if they can."""
    return None if system.canonical and system.separable and system.diagonal else WHY


def masses(system: Hamiltonian) -> np.ndarray:
    """The masses m_i of a system H = sum p_i^2 / 2 m_i + V(q), array (d,)."""
    import sympy as sp

    return np.array([1 / float(sp.diff(v, p)) for v, p in zip(system.dq, system.p, strict=True)])


def on_lines(x: np.ndarray) -> np.ndarray:
    """Turn d numbers into positions or velocities of d particles on parallel lines: (d, 3), zero but for column 0."""
    places = np.zeros((len(x), 3))
    places[:, 0] = x
    return places
