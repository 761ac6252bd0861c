r"""The cubic nonlinear Schroedinger equation on N points: :math:`i\psi_t + \psi_{xx} + 2|\psi|^2\psi = 0`, focusing.

On a periodic interval of length L with :math:`\Delta x = L/N`, central differences and
:math:`\psi_j = (q_j + i p_j)/\sqrt{\Delta x}` the semi-discrete equation is canonical,

.. math::
    H = \sum_j \frac{(q_{j+1} - q_j)^2 + (p_{j+1} - p_j)^2}{2\Delta x^2} - \frac{(q_j^2 + p_j^2)^2}{2\Delta x}
    = \Delta x\sum_j \frac{|\psi_{j+1} - \psi_j|^2}{2\Delta x^2} - \frac{|\psi_j|^4}2 .

It conserves the mass :math:`\sum_j q_j^2 + p_j^2 = \Delta x\sum_j |\psi_j|^2`, a quadratic invariant of the form q.q +
p.p, not q.D p.  The equation is integrable, this discretization is not.

In space-time it is multisymplectic (`multisymplectic`) with z = (q, p, v, w), :math:`\psi = q + ip`, v + iw its slope,

.. math:: p_t - v_x = 2|\psi|^2 q,\quad -q_t - w_x = 2|\psi|^2 p,\quad q_x = v,\quad p_x = w .

"plane-wave": a modulated plane wave, unstable to two modes at the default length.  "soliton": a soliton that moves,
:math:`\psi = \operatorname{sech}(x)\,e^{2\pi i x/L}` from x = -L/2 to L/2 (periodic up to the size of its tails).
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from math import cos, cosh, pi, sin, sqrt

import numpy as np
import sympy as sp

from phasebench.integrators.compile.codegen import value_kind
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from phasebench.integrators.systems.hand import HandHamiltonian, part
from phasebench.integrators.systems.multisymplectic import Equation
from phasebench.integrators.values.kinds import Number

from .base import Orbit, Pace, Problem, whole

PARAMETERS = {"N": 64, "L": 4 * sqrt(2) * pi}
#: The most points; the least and greatest length at which the initial data are finite.
LARGEST, SHORTEST, LONGEST = 4096, 1e-3, 500.0


def field(a: Number, b: Number) -> Callable[..., None]:
    """Make the loop f(q, p, h, lam, dq, dp) of the vector field, see `systems.hand`; a = 1 / dx^2, b = 2 / dx."""

    @part
    def at(j: int, left: int, right: int, q: np.ndarray, p: np.ndarray, dq: np.ndarray, dp: np.ndarray) -> None:
        s = b * (q[j] * q[j] + p[j] * p[j])
        dq[j] = a * (2 * p[j] - p[left] - p[right]) - s * p[j]
        dp[j] = s * q[j] - a * (2 * q[j] - q[left] - q[right])

    def f(q: np.ndarray, p: np.ndarray, h: Number, lam: Number, dq: np.ndarray, dp: np.ndarray) -> None:
        n = len(q)
        at(0, n - 1, 1, q, p, dq, dp)
        for j in range(1, n - 1):
            at(j, j - 1, j + 1, q, p, dq, dp)
        at(n - 1, n - 2, 0, q, p, dq, dp)

    return f


def energy(a: Number, b: Number) -> Callable[..., tuple[Number, Number]]:
    """Make the function f(q, p) -> (H, M) of the grid; H's round-off is about M machine epsilons."""

    def f(q: np.ndarray, p: np.ndarray) -> tuple[Number, Number]:
        n = len(q)
        H = M = 0 * q[0]
        for j in range(n):
            left, right = (j if j > 0 else n) - 1, (j + 1 if j < n - 1 else 0)
            r = q[j] * q[j] + p[j] * p[j]
            x, y = q[right] - q[j], p[right] - p[j]
            bending, focusing = a * (x * x + y * y) / 2, b * r * r / 4
            H += bending - focusing
            M += bending + focusing
            M += abs(q[j] * (a * (2 * q[j] - q[left] - q[right]) - b * r * q[j]))
            M += abs(p[j] * (a * (2 * p[j] - p[left] - p[right]) - b * r * p[j]))
        return H, M

    return f


def constants(N: int, L: float) -> tuple[Fraction, Fraction]:
    """Return (1 / dx^2, 2 / dx) as exact fractions, for N points of a period L, dx = L / N."""
    dx = Fraction(L) / N
    return 1 / dx**2, 2 / dx


def formula(N: int, L: float) -> tuple[list[sp.Symbol], list[sp.Symbol], sp.Expr]:
    """Return (q, p, H) on N points of a period L: lists of N symbols, and an expression."""
    q, p = (sp.symbols([f"{x}{j}" for j in range(N)], real=True) for x in "qp")
    a, b = (sp.Rational(c.numerator, c.denominator) for c in constants(N, L))
    bending = [a * (x[(j + 1) % N] - x[j]) ** 2 / 2 for j in range(N) for x in (q, p)]
    return q, p, sp.Add(*bending, *(-b * (x**2 + y**2) ** 2 / 4 for x, y in zip(q, p, strict=True)))


def multisymplectic(strength: float = 1.0) -> Equation:
    """Return K z_t + L z_x = grad S(z) with z = (q, p, v, w); ``strength`` multiplies the cubic term."""
    K, L = np.zeros((4, 4)), np.zeros((4, 4))
    K[0, 1], K[1, 0] = 1.0, -1.0
    L[[0, 1], [2, 3]], L[[2, 3], [0, 1]] = -1.0, 1.0

    def S(z: np.ndarray) -> np.ndarray:
        return strength * (z[..., :2] ** 2).sum(-1) ** 2 / 2 + (z[..., 2:] ** 2).sum(-1) / 2

    def gradient(z: np.ndarray) -> np.ndarray:
        r = (z[..., :2] ** 2).sum(-1, keepdims=True)
        return np.concatenate([2 * strength * r * z[..., :2], z[..., 2:]], axis=-1)

    def hessian(z: np.ndarray) -> np.ndarray:
        y = z[..., :2]
        r = (y**2).sum(-1)[..., None, None]
        H = np.zeros((*z.shape, 4))
        H[..., :2, :2] = strength * (2 * r * np.eye(2) + 4 * y[..., :, None] * y[..., None, :])
        H[..., 2:, 2:] = np.eye(2)
        return H

    return Equation(K, L, S, gradient, hessian, slopes=2)


def make(N: int, L: float) -> Problem:
    """Make the problem on ``N`` >= 3 points of a period ``L``; for many points it is made of loops."""
    if min(max(L, SHORTEST), LONGEST) != L:
        raise InvalidInput(f"the length L is {L}; it must be between {SHORTEST} and {LONGEST}")
    N = whole("N of points", N, 3, LARGEST)
    q, p, H = formula(N, L)
    mass = sp.Add(*(x**2 for x in (*q, *p)))
    if value_kind(N) == "tuple":
        system = Hamiltonian(q=q, p=p, H=H, invariants=(mass,))
    else:
        loops = {"field": field, "energy": energy}
        system = HandHamiltonian(q=q, p=p, H=H, loops=loops, constants=constants(N, L), degree=4, invariants=(mass,))
    dx = L / N
    x = [-L / 2 + j * dx for j in range(N)]
    wave = tuple(sqrt(dx) / 2 * (1 + cos(2 * pi * y / L) / 10) for y in x)
    soliton = (tuple(sqrt(dx) / cosh(y) * turn(2 * pi * y / L) for y in x) for turn in (cos, sin))
    return Problem(
        id="nls",
        name="nonlinear Schroedinger equation, semi-discrete",
        source="Zakharov & Shabat 1972, Sov. Phys. JETP 34, 62-69 (soliton); Karpeev & Schober 2001, Math. Comput. "
        "Simul. 56, 145-156 (standard discretization); Islas, Karpeev & Schober 2001, J. Comput. Phys. 173, 116-148",
        cite=("zakharov-shabat1972", "islas2001", "bridges-reich2001"),
        system=system,
        orbits=(
            Orbit("plane-wave", wave, (0.0,) * N, "psi = (1 + cos(2 pi x / L) / 10) / 2", (0.1, 1.0, 10.0)),
            Orbit("soliton", *soliton, "psi = sech(x) exp(2 pi i x / L)", (0.1, 1.0, 5.0)),
        ),
        invariants={"mass": mass},
        parameters={"N": N, "L": L},
        pace=Pace(step=0.004),  # of the shortest waves on the default grid
    )
