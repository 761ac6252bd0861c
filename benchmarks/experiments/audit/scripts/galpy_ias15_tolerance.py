"""galpy's ias15_c: do rtol and atol, arguments of Orbit.integrate, change the orbit?"""

import numpy as np
from galpy.orbit import Orbit
from galpy.potential import LogarithmicHaloPotential

potential, t, ends = LogarithmicHaloPotential(normalize=1.0), np.linspace(0, 100, 1001), {}
for method in ("ias15_c", "dop853_c"):
    for tol in (1e-4, 1e-12):
        orbit = Orbit([1.0, 0.1, 1.1, 0.0])
        orbit.integrate(t, potential.toPlanar(), method=method, rtol=tol, atol=tol)
        ends[method, tol] = np.asarray(orbit.getOrbit())[-1]
    apart = np.abs(ends[method, 1e-4] - ends[method, 1e-12]).max()
    print(f"{method}: difference between tolerances 1e-4 and 1e-12 = {apart:.1e}")
