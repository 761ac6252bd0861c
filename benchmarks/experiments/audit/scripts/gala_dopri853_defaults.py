"""Whether gala's DOPRI853 uses "The default tolerances (atol=1.49e-8, rtol=1.49e-8)" of its documentation.

The error by default is compared with that at these tolerances and at rtol = 1e-6, atol = 1e-12.
"""

import numpy as np
from gala.integrate import DOPRI853Integrator


def pendulum(t, w):
    return np.array([w[1], -np.sin(w[0])])


def ends(**options):
    return DOPRI853Integrator(pendulum, **options)(w0=[1.0, 0.5], t=np.array([0.0, 100.0])).w()[:, -1].ravel()


default, exact = ends(), ends(atol=1e-13, rtol=1e-13, nsteps=10_000)
print(f"error by default = {np.abs(default - exact).max():.2e}")
print(f"error at atol = rtol = 1.49e-8 = {np.abs(ends(atol=1.49e-8, rtol=1.49e-8) - exact).max():.2e}")
print(f"default less rtol = 1e-6 and atol = 1e-12 = {np.abs(default - ends(rtol=1e-6, atol=1e-12)).max():.2e}")
