"""Print a file for `phasebench elsewhere` without phasebench: SciPy's DOP853 on a box orbit of Henon and Heiles."""

import platform
import sys

import numpy as np
import scipy
from scipy.integrate import solve_ivp

#: The initial state of the orbit in doubles, and the end.
Q0, P0, T_END = (0.0, -0.082), (0.18140678414362935, 0.0), 10.0


def field(t, y):
    q1, q2, p1, p2 = y
    return [p1, p2, -q1 - 2 * q1 * q2, -q2 - q1 * q1 + q2 * q2]


def energy(y):
    q1, q2, p1, p2 = y
    return (p1**2 + p2**2 + q1**2 + q2**2) / 2 + q1**2 * q2 - q2**3 / 3


header = {
    "phasebench-elsewhere": 1,
    "package": "scipy",
    "version": scipy.__version__,
    "language": f"Python {platform.python_version()}",
    "machine": f"{platform.machine()}, {platform.system()}",
    "problem": "henon-heiles:box",
    "q0": ", ".join(map(repr, Q0)),
    "p0": ", ".join(map(repr, P0)),
    "energy": repr(float(energy(np.array(Q0 + P0)))),
    "t_end": T_END,
}
for name, value in header.items():
    print(f"# {name}: {value}")
print("method,tol,evaluations,q1,q2,p1,p2")
for tol in map(float, sys.argv[1:] or ("1e-4", "1e-7", "1e-10")):
    run = solve_ivp(field, (0.0, T_END), Q0 + P0, "DOP853", rtol=tol, atol=tol)
    print("DOP853", repr(tol), run.nfev, *(repr(float(x)) for x in run.y[:, -1]), sep=",")
