"""The times of the states that pyhamsys returns, beside those given as "Times at which the solution is evaluated"."""

import numpy as np
from pyhamsys import HamSys, Parameters

system = HamSys(y_dot=lambda t, y: np.array([y[1], -np.sin(y[0])]))
asked = np.array([0.0, 0.13, 1.27, 2.0])
found = system.integrate(np.array([1.0, 0.5]), asked, Parameters(step=0.1, extension=True, display=False))
print(f"times asked for = {', '.join(f'{t:.2f}' for t in asked)}")
print(f"times returned = {', '.join(f'{t:.2f}' for t in found.t)}")
