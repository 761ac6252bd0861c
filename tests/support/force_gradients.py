"""Compare force-gradient methods with a plain implementation in 40 digits: ``python force_gradients.py``.

Run with NUMBA_DISABLE_JIT=1, as multiprecision needs; prints JSON.
"""

from __future__ import annotations

import json

import mpmath

from phasebench.benchmarks.measure.multiprecision import advance, displacement, start
from phasebench.benchmarks.measure.step_map import jacobian
from phasebench.integrators import Hamiltonian, coefficients
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision
from phasebench.integrators.driver import integrate
from phasebench.integrators.records.force_gradient import rows
from phasebench.integrators.registry import METHODS, method
from support.solutions import apart, distance

ALL = {m.id: m for m in METHODS if m.family == "force_gradient"}
#: A mass matrix that is not diagonal.
SYSTEM = Hamiltonian(q="q1 q2", p="p1 p2", H="p1**2 + p1*p2 + p2**2 + cos(q1)/3 + q1**2*q2**2/2 + q2**4/4 + q1*q2**3/5")
START = (0.5, -0.3), (0.25, 0.375)
H, STEPS, DIGITS = 1 / 32, (1, 50), 40
#: Relative change of the gradients' weights in the control.
SPOILED = mpmath.mpf("1e-18")


def gradient(x, y):
    """Return grad V at (x, y), written by hand for the potential of `SYSTEM`."""
    return -mpmath.sin(x) / 3 + x * y**2 + y**3 / 5, x**2 * y + y**3 + 3 * x * y**2 / 5


def hessian(x, y):
    """Return (V_xx, V_xy, V_yy) at (x, y), written by hand for the potential of `SYSTEM`."""
    return -mpmath.cos(x) / 3 + y**2, 2 * x * y + 3 * y**2 / 5, x**2 + 3 * y**2 + 6 * x * y / 5


def velocity(u, v):
    """Return M^-1 p for p = (u, v), written by hand for the mass matrix M of `SYSTEM`."""
    return 2 * u + v, u + 2 * v


def plain(weights, free, steps):
    """Integrate `SYSTEM` by a force-gradient method, programmed plainly; return the end state (x, y, u, v).

    Each (a, b, c) of ``weights`` is a drift by a h, then a kick by b h with the force gradient's weight c.  The force
    gradient is that of the Hessian, or, if ``free``, a gradient at a shifted position.
    """
    (x, y), (u, v) = (tuple(map(mpmath.mpf, part)) for part in START)
    h = mpmath.mpf(H)
    for _ in range(steps):
        for a, b, c in weights:
            s, t = velocity(u, v)
            x, y = x + a * h * s, y + a * h * t
            f, g = gradient(x, y)
            s, t = velocity(f, g)
            if free and c != 0:
                f, g = gradient(x - 2 * c * h**2 / b * s, y - 2 * c * h**2 / b * t)
                u, v = u - b * h * f, v - b * h * g
            else:
                xx, xy, yy = hessian(x, y)
                u += -b * h * f + 2 * c * h**3 * (xx * s + xy * t)
                v += -b * h * g + 2 * c * h**3 * (xy * s + yy * t)
    return x, y, u, v


def closed_forms():
    """Return {method's id: weights (a, b, c) of drifts, kicks and force gradients}, in closed form, from the papers."""
    one, root = mpmath.mpf(1), mpmath.sqrt(3)
    side, c = (1 - 1 / root) / 2, (2 - root) / 48
    third = [(0, one / 6, 0), (one / 2, 2 * one / 3, one / 72), (one / 2, one / 6, 0)]
    return {
        "takahashi-imada": [(one / 2, one, one / 24), (one / 2, 0, 0)],
        "chin-4a": third,
        "chin-4b": [(side, one / 2, c), (1 / root, one / 2, c), (side, 0, 0)],
        "chin-4c": [
            *((one / 6, 3 * one / 8, 0), (one / 3, one / 4, one / 192)),
            *((one / 3, 3 * one / 8, 0), (one / 6, 0, 0)),
        ],
        "sbabc-2": [(0, one / 6, one / 144), (one / 2, 2 * one / 3, 0), (one / 2, one / 6, one / 144)],
        "hessian-free-badab": third,
    }


def of(id: str) -> dict:
    """Compare the force-gradient method ``id`` with the plain implementation.

    Returns a dict: "distance" from plain runs, "control" (distance of plain runs with slightly wrong weights) and
    "ends" (end states), for each number of `STEPS`, and the defects of `structure`.
    """
    free, out = ALL[id].data[1], {"distance": [], "control": [], "ends": []}
    with precision(DIGITS):
        weights = closed_forms().get(id, rows(coefficients.steps(id)))
        for steps in STEPS:
            wanted = plain(weights, free, steps)
            s = integrate(SYSTEM, id, h=H, steps=steps, q0=START[0], p0=START[1], arithmetic=MULTIPRECISION)
            out["distance"].append(distance(s, wanted))
            spoiled = plain([(a, b, c * (1 + SPOILED)) for a, b, c in weights], free, steps)
            out["control"].append(float(apart(spoiled, wanted)))
            out["ends"].append([float(x) for x in wanted])
        return out | structure(id)


def structure(id: str) -> dict:
    """Return the defects "volume", |det J - 1|, and "form", |J^T Omega J - Omega|, of a step on Henon-Heiles.

    J is the Jacobian of a step of the method ``id``, Omega the symplectic form.
    """
    system, y = start("henon-heiles")
    J = jacobian(lambda x: advance(system, method(id), x, mpmath.mpf(1) / 8), y, displacement())
    M = mpmath.matrix([[mpmath.mpf(str(x)) for x in row] for row in J])
    n = M.rows // 2
    form = mpmath.matrix(2 * n)
    for i in range(n):
        form[i, n + i], form[n + i, i] = 1, -1
    return {"volume": float(abs(mpmath.det(M) - 1)), "form": float(mpmath.mnorm(M.T * form * M - form, 1))}


if __name__ == "__main__":
    print(json.dumps({"result": {id: of(id) for id in ALL}}))
