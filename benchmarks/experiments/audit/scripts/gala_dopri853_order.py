"""The order of the formula with which gala's DOPRI853 advances, measured with a row each step and loose tolerances."""

import numpy as np
from gala.integrate import DOPRI853Integrator


def pendulum(t, w):
    return np.array([w[1], -np.sin(w[0])])


def end(n, span=6.0):
    h = span / n
    loose = {"atol": 1e9, "rtol": 1e9, "first_step": h, "max_step": h}
    return DOPRI853Integrator(pendulum, **loose)(w0=[1.0, 0.5], t1=0.0, dt=h, n_steps=n).w()[:, -1].ravel()


exact, (coarse, fine) = end(400), (end(n) for n in (20, 40))
print(f"order = {np.log2(np.abs(coarse - exact).max() / np.abs(fine - exact).max()):.2f}")
