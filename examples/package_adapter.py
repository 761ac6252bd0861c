"""How to wrap another package's integrator as a step: one step of fixed size of SciPy's RK23, of order 3."""

import numpy as np
from scipy.integrate import RK23

CLAIMS = {"order": 3, "symplectic": False, "energy": "drift"}


def step(system, q, p, h):
    def slope(t, y):
        return np.concatenate([system.dH_dp(*np.split(y, 2)), -system.dH_dq(*np.split(y, 2))])

    solver = RK23(slope, 0.0, np.concatenate([q, p]), np.sign(h) * np.inf, first_step=abs(h), rtol=1e6, atol=1e6)
    solver.step()
    return np.split(solver.y, 2)
