r"""The matrix of a step on the oscillator in extended precision, from a method's coefficients and the double h.

A linear symplectic step y -> M y with trace 2 cos(theta) turns :math:`w = M_{pq} q + (e^{i\theta} - M_{qq}) p` by
theta: |w|^2 is kept exactly and arg w grows by theta a step.  `errors` are the changes of both in a run beyond that.

Coefficients rounded to doubles make a slightly different method, also symplectic: |w|^2 then oscillates without
growing, and the phase error has a part linear in time.
"""

from __future__ import annotations

import math
from fractions import Fraction

import mpmath
import numpy as np
import sympy as sp

from phasebench.benchmarks.problems import problem
from phasebench.integrators.coefficients.tableaus import runge_kutta
from phasebench.integrators.registry import BY_ID, method
from phasebench.integrators.systems import generating

#: Working precision; binary places of the integers in `errors`.
DIGITS, PLACES = 50, 160
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


def errors(M: mpmath.matrix, n: np.ndarray, Q: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(Relative errors of |w|^2, errors of the phase arg w in radians), arrays (..., m), at step numbers n.

    Q, P are states, arrays (..., m), whose first column is the start; M is the matrix of a step, in the working
    precision.  The arithmetic is exact, in integers times 2^-`PLACES`; only M and theta are rounded.
    """
    cosine = (M[0, 0] + M[1, 1]) / 2
    turn = mpmath.mpc(cosine, mpmath.sqrt(1 - cosine**2))
    theta, by_p = mpmath.arg(turn), turn - M[0, 0]
    back = [mpmath.expj(-theta * int(k)) for k in n]
    Q, P = _integers(np.asarray(Q, float)), _integers(np.asarray(P, float))
    x, y = _integer(M[1, 0]) * Q + _integer(by_p.real) * P, _integer(by_p.imag) * P
    first_x, first_y = x[..., :1], y[..., :1]
    first = first_x * first_x + first_y * first_y
    energy = (x * x + y * y - first) / first
    c, s = (np.array([_integer(part(z)) for z in back], dtype=object) for part in (mpmath.re, mpmath.im))
    along, across = x * first_x + y * first_y, y * first_x - x * first_y
    whole = first << PLACES
    phase = np.arctan2(*(((a * c + b * s) / whole).astype(float) for a, b in ((across, along), (along, -across))))
    return energy.astype(float), phase


def _integer(x: mpmath.mpf) -> int:
    return int(mpmath.nint(mpmath.ldexp(x, PLACES)))


#: 2^`PLACES` x for an array of doubles; exact if no nonzero one is below 2^-100.
_integers = np.frompyfunc(lambda x: int(math.ldexp(x, PLACES)), 1, 1)


def has_exact_map(id: str) -> bool:
    """True if the exact matrix of a method's step on the oscillator can be computed here."""
    return id not in OTHERS and BY_ID[SAME.get(id, id)].family in BY_FAMILY


def exact_matrix(id: str, values: dict, h: float) -> mpmath.matrix:
    """A method's 2 x 2 matrix of a step of h on (q, p), in the working precision; ``values``: parameters."""
    made, h = method(SAME.get(id, id), **values), mpmath.mpf(h)
    return BY_FAMILY[made.family](made.data, h)


def _number(x: Fraction | float | mpmath.mpf) -> mpmath.mpf:
    return mpmath.mpf(x.numerator) / x.denominator if hasattr(x, "numerator") else mpmath.mpf(x)


def _parametric(data: tuple, h: mpmath.mpf) -> mpmath.matrix:
    """A substep (c, mu, lambda) has the length c h and the gradient of the generating function at these weights."""
    order, substeps = data
    one, total = mpmath.mpf(1), mpmath.eye(2)
    for c, mu, lam in substeps:
        z, mu, lam = h * _number(c), _number(mu), _number(lam)
        a, b, d = (z * x for x in _generating(order, z, lam))
        left = mpmath.matrix([[one - b * mu, -d * lam], [a * mu, one + b * lam]])
        right = mpmath.matrix([[one + b * (one - mu), d * (one - lam)], [-a * (one - mu), one - b * (one - lam)]])
        total = left**-1 * right * total
    return total


def _generating(order: int, h: mpmath.mpf, lam: mpmath.mpf) -> list:
    """The second derivatives K_qq, K_qp, K_pp of the oscillator's generating function K of an order; for 1 it is H."""
    if order == 1:
        return [mpmath.mpf(1), mpmath.mpf(0), mpmath.mpf(1)]
    q, p = sp.symbols("q p", real=True)
    K = generating.coefficients((q**2 + p**2) / 2, (q,), (p,), order)
    second = [[sp.diff(k, x, y) for k in K] for x, y in ((q, q), (q, p), (p, p))]
    of_lam = [[sp.lambdify(generating.LAMBDA, k, "mpmath")(lam) for k in each] for each in second]
    return [mpmath.fsum(k * h**i for i, k in enumerate(each)) for each in of_lam]


def _splitting(data: tuple, h: mpmath.mpf) -> mpmath.matrix:
    """Of a splitting that begins with a kick: ``data`` has the drifts' and the kicks' fractions of h."""
    drifts, kicks = ([*map(_number, part)] for part in data)
    total = mpmath.eye(2)
    for k in range(max(len(drifts), len(kicks))):
        if k < len(kicks):
            total = mpmath.matrix([[1, 0], [-h * kicks[k], 1]]) * total
        if k < len(drifts):
            total = mpmath.matrix([[1, h * drifts[k]], [0, 1]]) * total
    return total


def _collocation(data: tuple, h: mpmath.mpf) -> mpmath.matrix:
    """Of a (partitioned) Runge-Kutta method, from its stage equations: ``data`` is (kind, stages)."""
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
    """Of a method that is exact on the oscillator: its flow over h; ``data`` is not used."""
    omega = mpmath.mpf(problem("harmonic-oscillator").parameters.get("omega", 1))
    c, s = mpmath.cos(h * omega), mpmath.sin(h * omega)
    return mpmath.matrix([[c, s / omega], [-omega * s, c]])


BY_FAMILY = {
    "parametric": _parametric,
    "splitting": _splitting,
    "collocation": _collocation,
    "trigonometric": _rotation,
}
