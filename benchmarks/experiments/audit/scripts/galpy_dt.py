"""Whether galpy's orbits end at their time if dt is to "force the integrator to use this basic stepsize".

An orbit with rows 0.3 apart and dt = 0.1 is compared with those at t = 30, its end, and at t = 20.
"""

import numpy as np
from galpy.orbit import Orbit
from galpy.potential import LogarithmicHaloPotential

potential = LogarithmicHaloPotential(normalize=1.0).toPlanar()


def end(rows_apart, rows, dt):
    orbit = Orbit([1.0, 0.1, 1.1, 0.0])
    orbit.integrate(rows_apart * np.arange(rows + 1), potential, method="leapfrog_c", dt=dt)
    return np.array([orbit.x(orbit.t[-1]), orbit.y(orbit.t[-1])])


asked, divided = end(0.3, 100, 0.1), end(0.25, 120, 0.125)
print(f"distance from t = 30, which was asked for = {np.abs(asked - end(0.1, 300, 0.1)).max():.1e}")
print(f"distance from t = 20 = {np.abs(asked - end(0.1, 200, 0.1)).max():.1e}")
print(f"the same with rows 0.25 apart and dt = 0.125 = {np.abs(divided - end(0.125, 240, 0.125)).max():.1e}")
