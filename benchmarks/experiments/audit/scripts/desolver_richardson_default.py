"""desolver's Richardson extrapolation by default: how far is its step from that of the method that it extrapolates?"""

import desolver as de
import numpy as np


def step(method, y, h=0.5):
    integrator = method((2,), dtype=np.dtype(float), rtol=1e-13, atol=1e-13)
    integrator.adaptation_fn = lambda _: (np.float64(h), False)
    return y + integrator(de.DiffRHS(lambda t, y: np.array([y[1], -np.sin(y[0])])), 0.0, y, {}, np.float64(h))[1][1]


base, y = de.integrators.MidpointSolver, np.array([1.0, 0.5])
for rows in (2, 3):
    extrapolated = de.integrators.generate_richardson_integrator(base, richardson_iter=rows)
    print(f"difference with {rows} rows = {np.abs(step(extrapolated, y) - step(base, y)).max():.1e}")
