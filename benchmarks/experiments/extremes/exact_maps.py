"""Compute the matrix of a step on the oscillator in extended precision, from a method's coefficients and the double h.

Coefficients rounded to doubles make a slightly different method, also symplectic: |w|^2, the quadratic form that the
exact step keeps (`brouwer`), then oscillates without growing, and the phase error has a part linear in time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import mpmath
import sympy as sp

from phasebench.benchmarks.problems import problem
from phasebench.integrators.coefficients.tableaus import runge_kutta
from phasebench.integrators.registry import BY_ID, method
from phasebench.integrators.systems import generating

if TYPE_CHECKING:
    from fractions import Fraction

#: Methods that coincide with another method on the oscillator, where gradients are linear.
SAME = dict.fromkeys(
    (
        *("avf", "gonzalez", "pavf", "pavf-adjoint", "pavf-p", "itoh-abe"),
        *("variational-midpoint", "imex", "implicit-midpoint-symmetric-projection"),
    ),
    "implicit-midpoint",
)
SAME |= {f"hbvm-{2 * s}-{s}": f"gauss-{s}" for s in (1, 2, 3, 4)} | {f"cpg-{s}": f"gauss-{s}" for s in (1, 2, 3, 4)}
SAME |= {f"{id}-yoshida-4": "implicit-midpoint-yoshida-4" for id in ("avf", "gonzalez")}
SAME |= {"avf-suzuki-4": "implicit-midpoint-suzuki-4", "variational-trapezoidal": "stormer-verlet"}
SAME |= {f"variational-gauss-{s}": f"gauss-{s}" for s in (2, 3)}
SAME |= {f"variational-lobatto-{s}": f"lobatto-iiia-iiib-{s}" for s in (3, 4)}
#: Methods of the families below to which their formula does not apply.
OTHERS = ("r-respa",)


def has_exact_map(id: str) -> bool:
    """True if the exact matrix of a method's step on the oscillator can be computed here."""
    return id not in OTHERS and BY_ID[SAME.get(id, id)].family in BY_FAMILY


def exact_matrix(id: str, values: dict, h: float) -> mpmath.matrix:
    """Compute a method's 2 x 2 matrix of a step of h on (q, p), in the working precision; ``values``: parameters."""
    made, h = method(SAME.get(id, id), **values), mpmath.mpf(h)
    return BY_FAMILY[made.family](made.data, h)


def _number(x: Fraction | float | mpmath.mpf) -> mpmath.mpf:
    return mpmath.mpf(x.numerator) / x.denominator if hasattr(x, "numerator") else mpmath.mpf(x)


def _parametric(data: tuple, h: mpmath.mpf) -> mpmath.matrix:
    """Compute the matrix of a step that is composed of generating-function steps, on the oscillator.

    ``data`` is (order, substeps); a substep (c, mu, lambda) has the length c h and the gradient of the generating
    function at (mu q1 + (1 - mu) q0, lambda p1 + (1 - lambda) p0).
    """
    order, substeps = data
    one, total = mpmath.mpf(1), mpmath.eye(2)
    for c, mu, lam in substeps:
        z, mu, lam = h * _number(c), _number(mu), _number(lam)
        a, b, d = (z * x for x in _generating(order, z, lam))
        # K's gradient at (mu q1 + (1 - mu) q0, lam p1 + (1 - lam) p0)
        left = mpmath.matrix([[one - b * mu, -d * lam], [a * mu, one + b * lam]])
        right = mpmath.matrix([[one + b * (one - mu), d * (one - lam)], [-a * (one - mu), one - b * (one - lam)]])
        total = left**-1 * right * total
    return total


def _generating(order: int, h: mpmath.mpf, lam: mpmath.mpf) -> list:
    """Compute the second derivatives K_qq, K_qp, K_pp of the oscillator's generating function K of an order.

    K depends on the step h and the parameter lambda (``lam``); for order 1 it is H.
    """
    if order == 1:
        return [mpmath.mpf(1), mpmath.mpf(0), mpmath.mpf(1)]
    q, p = sp.symbols("q p", real=True)
    K = generating.coefficients((q**2 + p**2) / 2, (q,), (p,), order)
    second = [[sp.diff(k, x, y) for k in K] for x, y in ((q, q), (q, p), (p, p))]
    of_lam = [[sp.lambdify(generating.LAMBDA, k, "mpmath")(lam) for k in each] for each in second]
    return [mpmath.fsum(k * h**i for i, k in enumerate(each)) for each in of_lam]


def _splitting(data: tuple, h: mpmath.mpf) -> mpmath.matrix:
    """Compute the matrix of a step of a splitting into drifts and kicks, on the oscillator.

    ``data`` has the drifts' and the kicks' fractions of h; a step begins with a kick.
    """
    drifts, kicks = ([*map(_number, part)] for part in data)
    total = mpmath.eye(2)
    for k in range(max(len(drifts), len(kicks))):
        if k < len(kicks):
            total = mpmath.matrix([[1, 0], [-h * kicks[k], 1]]) * total
        if k < len(drifts):
            total = mpmath.matrix([[1, h * drifts[k]], [0, 1]]) * total
    return total


def _collocation(data: tuple, h: mpmath.mpf) -> mpmath.matrix:
    """Compute the step matrix of a (partitioned) Runge-Kutta method on the oscillator, from its stage equations.

    ``data`` is (kind, stages), such as ("gauss", 2).
    """
    A, C, b, _ = runge_kutta(*data)
    s = len(b)
    left, start = mpmath.eye(2 * s), mpmath.matrix(2 * s, 2)  # Q - h A P = q, P + h C Q = p
    change = mpmath.matrix(2, 2 * s)
    for i in range(s):
        start[i, 0] = start[s + i, 1] = 1
        change[0, s + i], change[1, i] = h * b[i], -h * b[i]
        for j in range(s):
            left[i, s + j], left[s + i, j] = -h * A[i, j], h * C[i, j]
    return mpmath.eye(2) + change * left**-1 * start


def _rotation(data: tuple, h: mpmath.mpf) -> mpmath.matrix:
    """The matrix of a step of a method that is exact on the oscillator: its flow over h; ``data`` is not used."""
    omega = mpmath.mpf(problem("harmonic-oscillator").parameters.get("omega", 1))
    c, s = mpmath.cos(h * omega), mpmath.sin(h * omega)
    return mpmath.matrix([[c, s / omega], [-omega * s, c]])


BY_FAMILY = {
    "parametric": _parametric,
    "splitting": _splitting,
    "collocation": _collocation,
    "trigonometric": _rotation,
}
