"""The orders of SciPy's explicit methods on the pendulum, at steps held constant by max_step and loose tolerances."""

import numpy as np
from scipy.integrate import solve_ivp


def pendulum(t, y):
    return [y[1], -np.sin(y[0])]


exact = solve_ivp(pendulum, (0, 6), [1.0, 0.5], method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
for method, n in {"RK23": 200, "RK45": 100, "DOP853": 20}.items():
    errors = []
    for steps in (n, 2 * n):
        loose = {"first_step": 6 / steps, "max_step": 6 / steps, "rtol": 1e-3, "atol": 1e9}
        found = solve_ivp(pendulum, (0, 6), [1.0, 0.5], method=method, **loose)
        errors.append(np.abs(found.y[:, -1] - exact).max())
    print(f"order of {method} = {np.log2(errors[0] / errors[1]):.2f}")
