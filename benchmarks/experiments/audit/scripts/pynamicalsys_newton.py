"""What pynamicalsys's implicit midpoint rule does if its iterations do not solve a step: return a state or raise."""

from contextlib import redirect_stdout
from io import StringIO

import numpy as np
from numba import njit
from pynamicalsys import HamiltonianSystem


@njit
def equations(q, p, parameters):
    return p.copy(), -np.sin(q)


@njit
def hessian(q, p, parameters):
    return np.array([[np.cos(q[0]), 0.0], [0.0, 1.0]])


system = HamiltonianSystem(eom=equations, hess_H=hessian, degrees_of_freedom=1, number_of_parameters=0)
for iterations in (50, 1):
    system.integrator("imp", time_step=0.5, max_iter=iterations)
    try:
        with redirect_stdout(StringIO()):  # its warning has lines that look like results
            system.trajectory([1.0], [0.5], 1.0)
        print(f"with {iterations} iterations = a state")
    except RuntimeError as error:
        print(f"with {iterations} iterations = {type(error).__name__}")
