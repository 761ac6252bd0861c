"""The orders that desolver's explicit classes have as __order__, measured on the pendulum at constant steps."""

import desolver as de
import numpy as np


def end(name, n, span=3.0):
    integrator = getattr(de.integrators, name)((2,), dtype=np.dtype(float))
    integrator.adaptation_fn = lambda _: (np.float64(span / n), False)  # the adaptive one keeps its step
    rhs = de.DiffRHS(lambda t, y: np.array([y[1], -np.sin(y[0])]))
    y, h = np.array([1.0, 0.5]), np.float64(span / n)
    for k in range(n):
        y = y + integrator(rhs, k * h, y, {}, h)[1][1]
    return y


exact = end("RK1412Solver", 40)
for name, n in {"RK8713MSolver": 12, "BABs9o7HSolver": 40, "ABAs5o6HSolver": 40, "SymplecticEulerSolver": 100}.items():
    steps = np.array([n, 1.2 * n, 1.4 * n, 1.7 * n, 2 * n]).round().astype(int)
    errors = [np.abs(end(name, k) - exact).max() for k in steps]
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    print(f"order of {name}, __order__ {getattr(de.integrators, name).__order__:.0f} = {order:.2f}")
