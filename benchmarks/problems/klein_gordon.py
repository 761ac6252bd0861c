r"""A nonlinear Klein-Gordon equation on N points: :math:`\phi_{tt} = \phi_{xx} - \phi - |\phi|^2\phi`, complex.

On a periodic interval of length L with :math:`\Delta x = L/N`, central differences and
:math:`\phi_j = (q_j + i q_{N+j})/\sqrt{\Delta x}`, :math:`\dot\phi_j = (p_j + i p_{N+j})/\sqrt{\Delta x}` the
semi-discrete equation is canonical,

.. math::
    H = \tfrac12 |p|^2 + \tfrac12 |q|^2 + \sum_{j=0}^{N-1} \Bigl(\frac{(q_{j+1} - q_j)^2
    + (q_{N+j+1} - q_{N+j})^2}{2\Delta x^2} + \frac{(q_j^2 + q_{N+j}^2)^2}{4\Delta x}\Bigr)

with indices periodic in each half.  H is invariant under rotations of :math:`\phi`, so that the charge
:math:`\sum_j q_j p_{N+j} - q_{N+j} p_j` is conserved, a quadratic invariant of the form q.D p.

In space-time it is multisymplectic (`multisymplectic`) with z = (q, p, w), :math:`\phi = q_1 + iq_2`, p its rate, w its
slope,

.. math:: -p_t + w_x = q + |q|^2 q,\quad q_t = p,\quad -q_x = -w .

The orbit "collision" starts with two wave packets of opposite charge at x = -L/4 and L/4 that move towards each other,
:math:`\phi = A\operatorname{sech}(x)\,e^{ikx}`, :math:`\dot\phi = -i\omega\phi` with A = 1 and 1/2,
:math:`\omega^2 = 1 + k^2`, \|k\| = 1 and the signs of k and omega that this requires.  (The data are this suite's own.)
"""

from __future__ import annotations

from cmath import exp
from collections.abc import Callable
from fractions import Fraction
from math import cosh, sqrt

import numpy as np
import sympy as sp

from phasebench.integrators.compile.codegen import value_kind
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from phasebench.integrators.systems.hand import HandHamiltonian, part, unit_mass_field
from phasebench.integrators.systems.multisymplectic import Equation
from phasebench.integrators.values.kinds import Number

from .base import Orbit, Pace, Problem, whole

PARAMETERS = {"N": 64, "L": 40.0}
#: The most points; the least and greatest length at which the initial data are finite.
LARGEST, SHORTEST, LONGEST = 2048, 1e-3, 500.0
#: The wave number of the packets.
K = 1.0


def grad_V(a: Number, b: Number, sign: int = 1) -> Callable[..., None]:
    """Make the function f(q, g) that writes ``sign`` times grad V to g; a = 1 / dx^2, b = 1 / dx."""

    @part
    def at(j: int, left: int, right: int, x: np.ndarray, y: np.ndarray, g_x: np.ndarray, g_y: np.ndarray) -> None:
        m = 1 + 2 * a + b * (x[j] * x[j] + y[j] * y[j])
        g_x[j] = sign * (m * x[j] - a * (x[left] + x[right]))
        g_y[j] = sign * (m * y[j] - a * (y[left] + y[right]))

    def f(q: np.ndarray, g: np.ndarray) -> None:
        n = len(q) // 2
        x, y, g_x, g_y = q[:n], q[n:], g[:n], g[n:]
        at(0, n - 1, 1, x, y, g_x, g_y)
        for j in range(1, n - 1):
            at(j, j - 1, j + 1, x, y, g_x, g_y)
        at(n - 1, n - 2, 0, x, y, g_x, g_y)

    return f


def field(a: Number, b: Number) -> Callable[..., None]:
    """Make the loop f(q, p, h, lam, dq, dp) of the vector field (p, -grad V), see `systems.hand`."""
    return unit_mass_field(grad_V(a, b, -1))


def energy(a: Number, b: Number) -> Callable[..., tuple[Number, Number]]:
    """Make the function f(q, p) -> (H, M) of the grid; H's round-off is about M machine epsilons."""

    def f(q: np.ndarray, p: np.ndarray) -> tuple[Number, Number]:
        n = len(q) // 2
        H = M = 0 * q[0]
        for j in range(n):
            left, right = (j if j > 0 else n) - 1, (j + 1 if j < n - 1 else 0)
            r = q[j] * q[j] + q[n + j] * q[n + j]
            v = p[j] * p[j] + p[n + j] * p[n + j]
            x, y = q[right] - q[j], q[n + right] - q[n + j]
            terms = (v + r + a * (x * x + y * y)) / 2 + b * r * r / 4
            H += terms
            M += terms + v
            m = 1 + 2 * a + b * r
            M += abs(q[j] * (m * q[j] - a * (q[left] + q[right])))
            M += abs(q[n + j] * (m * q[n + j] - a * (q[n + left] + q[n + right])))
        return H, M

    return f


def constants(N: int, L: float) -> tuple[Fraction, Fraction]:
    """Return (1 / dx^2, 1 / dx) as exact fractions, for N points of a period L, dx = L / N."""
    dx = Fraction(L) / N
    return 1 / dx**2, 1 / dx


def formula(N: int, L: float) -> tuple[list[sp.Symbol], list[sp.Symbol], sp.Expr]:
    """Return (q, p, H) on N points of a period L: 2 N symbols each, real parts before imaginary ones."""
    q, p = (sp.symbols([f"{x}{j}" for j in range(2 * N)], real=True) for x in "qp")
    a, b = (sp.Rational(c.numerator, c.denominator) for c in constants(N, L))
    bending = [a * (x[(j + 1) % N] - x[j]) ** 2 / 2 for j in range(N) for x in (q[:N], q[N:])]
    quartic = [b * (q[j] ** 2 + q[N + j] ** 2) ** 2 / 4 for j in range(N)]
    return q, p, sp.Add(*(x**2 / 2 for x in (*q, *p)), *bending, *quartic)


def multisymplectic(strength: float = 1.0) -> Equation:
    """Return K z_t + L z_x = grad S(z), z = (q, p, w) of two components each; ``strength`` is of the cubic term."""
    K, L = np.zeros((6, 6)), np.zeros((6, 6))
    K[[0, 1], [2, 3]], K[[2, 3], [0, 1]] = -1.0, 1.0
    L[[0, 1], [4, 5]], L[[4, 5], [0, 1]] = 1.0, -1.0

    def S(z: np.ndarray) -> np.ndarray:
        r, v, w = ((z[..., 2 * i : 2 * i + 2] ** 2).sum(-1) for i in range(3))
        return (r + v - w) / 2 + strength * r**2 / 4

    def gradient(z: np.ndarray) -> np.ndarray:
        q, p, w = z[..., :2], z[..., 2:4], z[..., 4:]
        return np.concatenate([(1 + strength * (q**2).sum(-1, keepdims=True)) * q, p, -w], axis=-1)

    def hessian(z: np.ndarray) -> np.ndarray:
        q = z[..., :2]
        r = (q**2).sum(-1)[..., None, None]
        H = np.zeros((*z.shape, 6))
        H[..., :2, :2] = (1 + strength * r) * np.eye(2) + 2 * strength * q[..., :, None] * q[..., None, :]
        H[..., 2:4, 2:4], H[..., 4:, 4:] = np.eye(2), -np.eye(2)
        return H

    return Equation(K, L, S, gradient, hessian, slopes=2)


def packet(x: float, A: float, direction: int, charge: int) -> tuple[complex, complex]:
    """Return (phi, phi_t) at x of a packet of amplitude A about 0; ``direction`` and ``charge`` are signs +-1."""
    phi = A * exp(1j * direction * charge * K * x) / cosh(x)
    return phi, -1j * charge * sqrt(1 + K**2) * phi


def make(N: int, L: float) -> Problem:
    """Make the problem on ``N`` >= 3 points of a period ``L``; for many points it is made of loops."""
    if min(max(L, SHORTEST), LONGEST) != L:
        raise InvalidInput(f"the length L is {L}; it must be between {SHORTEST} and {LONGEST}")
    N = whole("N of points", N, 3, LARGEST)
    q, p, H = formula(N, L)
    charge = sp.Add(*(q[j] * p[N + j] - q[N + j] * p[j] for j in range(N)))
    if value_kind(2 * N) == "tuple":
        system = Hamiltonian(q=q, p=p, H=H, invariants=(charge,))
    else:
        loops = {"field": field, "grad_V": grad_V, "energy": energy}
        system = HandHamiltonian(q=q, p=p, H=H, loops=loops, constants=constants(N, L), degree=4, invariants=(charge,))
    dx = L / N
    waves = []
    for x in (-L / 2 + j * dx for j in range(N)):
        pair = packet(x + L / 4, 1.0, 1, 1), packet(x - L / 4, 0.5, -1, -1)
        waves.append([sqrt(dx) * sum(w[k] for w in pair) for k in (0, 1)])
    start = [tuple(part(w[k]) for part in (lambda z: z.real, lambda z: z.imag) for w in waves) for k in (0, 1)]
    return Problem(
        id="klein-gordon",
        name="complex Klein-Gordon equation, semi-discrete",
        source="Strauss & Vazquez 1978, J. Comput. Phys. 28, 271-278 (the real equation); initial data of this suite",
        cite=("strauss-vazquez1978", "moore-reich2003", "reich2000", "chen-hong2020", "gong2014"),
        system=system,
        orbits=(Orbit("collision", *start, "two packets of opposite charge", (0.1, 1.0, 10.0)),),
        invariants={"charge": charge},
        parameters={"N": N, "L": L},
        pace=Pace(step=0.06),  # of the shortest waves on the default grid
    )
