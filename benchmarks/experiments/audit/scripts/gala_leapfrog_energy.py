"""The energy error of gala's leapfrog on an oscillator: "It conserves energy exactly for linear systems"."""

import numpy as np
from gala.integrate import LeapfrogIntegrator


def oscillator(t, w):
    return np.array([w[1], -w[0]])  # its docstring's example


for dt in (0.1, 0.5):
    orbit = LeapfrogIntegrator(oscillator)(w0=[1.0, 0.0], dt=dt, n_steps=1000)
    q, p = orbit.w()[:, :, 0] if orbit.w().ndim == 3 else orbit.w()
    print(f"relative energy error at dt = {dt} = {np.abs(q**2 + p**2 - 1).max():.2e}")
