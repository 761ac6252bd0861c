"""The orders of gala's integrators where the force depends on time: q'' = -q + cos(2 t), whose solution is known."""

import numpy as np
from gala.integrate import LeapfrogIntegrator, RK5Integrator, Ruth4Integrator


def forced(t, w):
    return np.array([w[1], -w[0] + np.cos(2 * t)])


def error(integrator, n, end=2.0):  # q(0) = 2/3, q'(0) = 0: q = cos t - cos(2 t) / 3
    orbit = integrator(forced)(w0=[2 / 3, 0.0], t1=0.0, dt=end / n, n_steps=n)
    return abs(np.ravel(orbit.w()[0])[-1] - (np.cos(end) - np.cos(2 * end) / 3))


for integrator in (LeapfrogIntegrator, Ruth4Integrator, RK5Integrator):
    order = np.log2(error(integrator, 200) / error(integrator, 400))
    print(f"order of {integrator.__name__} = {order:.2f}")
