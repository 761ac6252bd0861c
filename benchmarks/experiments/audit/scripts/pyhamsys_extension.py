"""Whether ten steps of pyhamsys's Verlet are symplectic with and without its option extension: max |M^T J M - J|.

M is the Jacobian of the ten steps on a pendulum.
"""

import numpy as np
from pyhamsys import HamSys, Parameters


def flow(y, extension, steps=10, h=0.1):
    def kick_drift(h, t, y):
        p = y[1] - h * np.sin(y[0])
        return np.array([y[0] + h * p, p])

    def drift_kick(h, t, y):
        q = y[0] + h * y[1]
        return np.array([q, y[1] - h * np.sin(q)])

    system = HamSys(y_dot=lambda t, y: np.array([y[1], -np.sin(y[0])]), chi=kick_drift, chi_star=drift_kick)
    options = Parameters(step=2.0, solver="Verlet", extension=extension, display=False)
    return system.integrate(y, h * np.arange(steps + 1), options).y[:, -1]


J, y, d = np.array([[0, 1], [-1, 0]]), np.array([1.0, 0.5]), 1e-5
for extension in (False, True):
    M = np.array([(flow(y + d * e, extension) - flow(y - d * e, extension)) / (2 * d) for e in np.eye(2)]).T
    print(f"defect with extension = {extension} = {np.abs(M.T @ J @ M - J).max():.1e}")
