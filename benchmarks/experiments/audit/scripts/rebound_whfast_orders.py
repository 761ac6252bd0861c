"""REBOUND's WHFast on a star and two planets of mass eps: how the error falls with h, and how with eps."""

import numpy as np
import rebound


def end(eps, steps, integrator="whfast", span=6.0, **options):
    sim = rebound.Simulation()
    sim.integrator = integrator
    for name, value in options.items():
        setattr(sim.integrator, name, value)
    sim.add(m=1.0)
    sim.add(m=eps, a=1.0, e=0.1)
    sim.add(m=eps, a=1.9, e=0.1, f=1.0)
    sim.dt = span / steps
    sim.integrate(span) if integrator == "ias15" else sim.steps(steps)
    sim.synchronize()
    return np.array([p.xyz for p in sim.particles[1:]])


for kernel in ("default", "modifiedkick", "composition", "lazy"):
    error = {}
    for eps in (1e-2, 1e-3):
        exact = end(eps, 100, "ias15")
        for n in (100, 200):
            error[eps, n] = np.abs(end(eps, n, kernel=kernel, corrector=17, safe_mode=0) - exact).max()
    in_h = np.log2(error[1e-2, 100] / error[1e-2, 200])
    in_eps = np.log10(error[1e-2, 200] / error[1e-3, 200])
    print(f"order in h, {kernel} kernel = {in_h:.2f}")
    print(f"order in eps, {kernel} kernel = {in_eps:.2f}")
