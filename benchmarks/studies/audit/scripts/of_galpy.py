"""Scripts on galpy."""

import numpy as np
from galpy.orbit import Orbit
from galpy.potential import LogarithmicHaloPotential

POTENTIAL = LogarithmicHaloPotential(normalize=1.0).toPlanar()


def galpy_dt():
    """Whether orbits end at their time if dt is to "force the integrator to use this basic stepsize".

    An orbit with rows 0.3 apart and dt = 0.1 is compared with those at t = 30, its end, and at t = 20.
    """

    def end(rows_apart, rows, dt):
        orbit = Orbit([1.0, 0.1, 1.1, 0.0])
        orbit.integrate(rows_apart * np.arange(rows + 1), POTENTIAL, method="leapfrog_c", dt=dt)
        return np.array([orbit.x(orbit.t[-1]), orbit.y(orbit.t[-1])])

    asked, divided = end(0.3, 100, 0.1), end(0.25, 120, 0.125)
    yield "distance from t = 30, which was asked for", f"{np.abs(asked - end(0.1, 300, 0.1)).max():.1e}"
    yield "distance from t = 20", f"{np.abs(asked - end(0.1, 200, 0.1)).max():.1e}"
    apart = np.abs(divided - end(0.125, 240, 0.125)).max()
    yield "the same with rows 0.25 apart and dt = 0.125", f"{apart:.1e}"


def galpy_ias15_tolerance():
    """ias15_c: do rtol and atol, arguments of Orbit.integrate, change the orbit?"""
    for method in ("ias15_c", "dop853_c"):
        ends = []
        for tol in (1e-4, 1e-12):
            orbit = Orbit([1.0, 0.1, 1.1, 0.0])
            orbit.integrate(np.linspace(0, 100, 1001), POTENTIAL, method=method, rtol=tol, atol=tol)
            ends.append(np.asarray(orbit.getOrbit())[-1])
        yield f"{method}: difference between tolerances 1e-4 and 1e-12", f"{np.abs(ends[0] - ends[1]).max():.1e}"
