"""The order in h of REBOUND's WHFast with correctors 0, 3 and 5, said to be "the order of the symplectic corrector".

It is measured on a star and two planets of mass eps = 1e-6.
"""

import numpy as np
import rebound


def end(steps, corrector=0, integrator="whfast", eps=1e-6, span=6.0):
    sim = rebound.Simulation()
    sim.integrator = integrator
    if integrator == "whfast":
        sim.integrator.corrector, sim.integrator.safe_mode = corrector, 0
    sim.add(m=1.0)
    sim.add(m=eps, a=1.0, e=0.05)
    sim.add(m=eps, a=1.9, e=0.05, f=1.0)
    sim.dt = span / steps
    sim.integrate(span) if integrator == "ias15" else sim.steps(steps)
    sim.synchronize()
    return np.array([p.xyz for p in sim.particles[1:]])


exact = end(100, integrator="ias15")
for corrector, n in {0: 24, 3: 24, 5: 24}.items():
    coarse, fine = (np.abs(end(k, corrector) - exact).max() for k in (n, 40))
    print(f"order in h with corrector {corrector} = {np.log(coarse / fine) / np.log(40 / n):.2f}")
