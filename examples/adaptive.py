"""An adaptive integrator, SciPy's DOP853, which claims that its error is at most 50 times its tolerance.

`phasebench validate` must pass it.
"""

import numpy as np
from scipy.integrate import solve_ivp

CLAIMS = {"tolerance": 50}


def run(system, q, p, t_end, tol):
    d = len(q)

    def slope(t, y):
        return np.concatenate([system.dH_dp(y[:d], y[d:]), -system.dH_dq(y[:d], y[d:])])

    end = solve_ivp(slope, (0.0, t_end), np.concatenate([q, p]), method="DOP853", rtol=tol, atol=tol).y[:, -1]
    return end[:d], end[d:]
