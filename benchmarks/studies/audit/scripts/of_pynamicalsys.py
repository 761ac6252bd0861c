"""Scripts on pynamicalsys."""

import numpy as np
from numba import njit
from pynamicalsys import HamiltonianSystem


@njit
def _equations(q, p, parameters):
    return p.copy(), -np.sin(q)


@njit
def _hessian(q, p, parameters):
    return np.array([[np.cos(q[0]), 0.0], [0.0, 1.0]])


def pynamicalsys_newton():
    """What the implicit midpoint rule does if its iterations do not solve a step: return a state or raise."""
    system = HamiltonianSystem(eom=_equations, hess_H=_hessian, degrees_of_freedom=1, number_of_parameters=0)
    for iterations in (50, 1):
        system.integrator("imp", time_step=0.5, max_iter=iterations)
        try:
            system.trajectory([1.0], [0.5], 1.0)
            yield f"with {iterations} iterations", "a state"
        except RuntimeError as error:
            yield f"with {iterations} iterations", type(error).__name__
