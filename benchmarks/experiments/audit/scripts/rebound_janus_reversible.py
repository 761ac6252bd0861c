"""Whether REBOUND's JANUS is "bit-wise time-reversible" at every order: three bodies, 1000 steps out and back."""

import numpy as np
import rebound


def state(sim):
    x, v = np.empty((2, sim.N, 3))
    sim.serialize_particle_data(xyz=x, vxvyvz=v)
    return np.concatenate([x, v])


for order in (2, 4, 6, 8, 10):
    sim = rebound.Simulation()
    sim.integrator = "janus"
    sim.integrator.order, sim.dt = order, 0.01
    for m, a in ((1.0, 0.0), (1e-3, 1.0), (1e-3, 2.0)):
        sim.add(m=m) if not a else sim.add(m=m, a=a, e=0.1, f=0.3)
    sim.steps(1)  # the start becomes one of its integers
    start = state(sim)
    sim.steps(1000)
    sim.dt = -sim.dt
    sim.steps(1000)
    print(f"numbers that differ after 1000 steps out and back, order {order} = {int((state(sim) != start).sum())}")
