"""The steps that desolver's "Fixed Step Methods" take with dt = 0.1, when they are driven as its README says."""

import desolver as de
import numpy as np


def rhs(t, state, **kwargs):
    return np.array([[0.0, 1.0], [-1.0, 0.0]]) @ state


for name in ("RK4Solver", "GaussLegendre4", "ImplicitMidpoint", "BackwardEuler", "RadauIA3"):
    system = de.OdeSystem(rhs, y0=np.array([1.0, 0.0]), t=(0, 2 * np.pi), dt=0.1, rtol=1e-9, atol=1e-9)
    system.method = getattr(de.integrators, name)
    system.integrate()
    print(f"steps of {name} = {', '.join(f'{h:.2f}' for h in np.diff(system.t)[:4])}")
