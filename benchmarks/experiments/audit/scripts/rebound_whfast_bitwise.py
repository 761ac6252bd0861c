"""Whether output on the way changes an orbit of REBOUND's WHFast: keep_unsynchronized, "bit-wise reproducibility"."""

import numpy as np
import rebound


def end(outputs, keep):
    sim = rebound.Simulation()
    sim.integrator = "whfast"
    sim.integrator.safe_mode, sim.integrator.corrector, sim.integrator.keep_unsynchronized = 0, 11, keep
    sim.add(m=1.0)
    sim.add(m=1e-3, a=1.0, e=0.1)
    sim.add(m=1e-3, a=1.9, e=0.1, f=1.0)
    sim.dt = 0.05
    for _ in range(outputs):
        sim.steps(1000 // outputs)
        sim.synchronize()
    return np.array([p.xyz + p.vxyz for p in sim.particles])


for keep in (0, 1):
    differ = int((end(1, keep) != end(10, keep)).sum())
    print(f"numbers of 18 that ten outputs change, keep_unsynchronized {keep} = {differ}")
