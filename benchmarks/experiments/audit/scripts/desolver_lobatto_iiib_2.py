"""desolver's LobattoIIIB2 says symplectic = False; how far is its step from the implicit midpoint rule's?"""

import desolver as de
import numpy as np


def step(method, y, h=0.1):
    integrator = method((2,), dtype=np.dtype(float), rtol=1e-13, atol=1e-13)
    integrator.adaptation_fn = lambda _: (np.float64(h), False)
    return y + integrator(de.DiffRHS(lambda t, y: np.array([y[1], -np.sin(y[0])])), 0.0, y, {}, np.float64(h))[1][1]


iiib, midpoint, y = de.integrators.LobattoIIIB2, de.integrators.ImplicitMidpoint, np.array([1.0, 0.5])
print(f"LobattoIIIB2.symplectic = {iiib.symplectic}")
print(f"ImplicitMidpoint.symplectic = {midpoint.symplectic}")
print(f"difference of their steps = {np.abs(step(iiib, y) - step(midpoint, y)).max():.1e}")
