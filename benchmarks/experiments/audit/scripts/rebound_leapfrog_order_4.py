"""The orders measured of REBOUND's leapfrog with its option order set to 2, 4, 6 and 8.

The documentation says: "Default is 2.  Other allowed values are 6 and 8".
"""

import numpy as np
import rebound


def end(order, steps, span=6.0):
    sim = rebound.Simulation()
    sim.integrator = "leapfrog" if order else "ias15"
    if order:
        sim.integrator.order = order
    sim.add(m=1.0)
    sim.add(m=1e-2, a=1.0, e=0.2, f=0.5)
    sim.dt = span / steps
    sim.steps(steps) if order else sim.integrate(span)
    return np.array([p.xyz for p in sim.particles])


for order, steps in {2: 120, 4: 120, 6: 120, 8: 50}.items():
    coarse, fine = (np.abs(end(order, n) - end(0, 100)).max() for n in (steps, 2 * steps))
    print(f"order measured for order = {order} = {np.log2(coarse / fine):.2f}")
