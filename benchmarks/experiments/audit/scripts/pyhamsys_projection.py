"""pyhamsys's parameter projection: does 'symmetric' give another orbit than 'midpoint'?"""

import numpy as np
from pyhamsys import HamSys, Parameters

system = HamSys(y_dot=lambda t, y: np.array([y[1], -np.sin(y[0])]))
found = []
for projection in ("midpoint", "symmetric"):
    options = {"step": 0.1, "solver": "Verlet", "extension": True, "display": False, "projection": projection}
    found.append(system.integrate(np.array([1.0, 0.5]), np.linspace(0, 20, 101), Parameters(**options)))
print(f"projection used where 'symmetric' is asked for = {found[1].projection}")
print(f"largest difference of the orbits = {np.abs(found[0].y - found[1].y).max():.1e}")
