"""The steps that pyhamsys takes for the ones that are asked for: "The step size is slightly readjusted"."""

import numpy as np
from pyhamsys import HamSys, Parameters

system = HamSys(y_dot=lambda t, y: np.array([y[1], -np.sin(y[0])]))
for asked, rows in ((0.1, 2), (0.03, 2), (0.1, 512), (1.0, 101)):
    options = Parameters(step=asked, solver="Verlet", extension=True, display=False)
    found = system.integrate(np.array([1.0, 0.5]), np.linspace(0, 20, rows), options)
    print(f"step for {asked} with {rows} rows = {found.step:.4f}")
