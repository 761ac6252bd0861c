"""Whether desolver's Richardson extrapolation of a symplectic method, which says symplectic, is: max |M^T J M - J|.

M is the Jacobian of a step on a pendulum.
"""

import desolver as de
import numpy as np


def step(y, rows, h=0.5):
    make = de.integrators.generate_richardson_integrator(de.integrators.SymplecticEulerSolver, richardson_iter=rows)
    integrator = make((2,), dtype=np.dtype(float), rtol=1e-13, atol=1e-13)
    integrator.adaptation_fn = lambda _: (np.float64(h), False)
    return y + integrator(de.DiffRHS(lambda t, y: np.array([y[1], -np.sin(y[0])])), 0.0, y, {}, np.float64(h))[1][1]


J, y, d = np.array([[0, 1], [-1, 0]]), np.array([1.0, 0.5]), 1e-5
for rows in (2, 3, 4):
    M = np.array([(step(y + d * e, rows) - step(y - d * e, rows)) / (2 * d) for e in np.eye(2)]).T
    print(f"defect with {rows} rows = {np.abs(M.T @ J @ M - J).max():.1e}")
print(f"symplectic = {de.integrators.generate_richardson_integrator(de.integrators.SymplecticEulerSolver).symplectic}")
