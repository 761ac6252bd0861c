r"""The gravitational N-body problem in space, G = 1.

.. math::
    H = \sum_i \frac{|p_i|^2}{2m_i} - \sum_{i<j} \frac{m_im_j}{|q_i - q_j|}

N = 3 is the Pythagorean problem: masses 3, 4, 5 at rest in the corners of the triangle of these sides.  After close
encounters (to 4e-4 near t = 15.83), which usual fixed steps do not resolve, the lightest body escapes.

For other N the masses are equal, 1/N, on a random Plummer sphere by Aarseth, Henon & Wielen's recipe, always the same,
in their units (total mass 1, energy near -1/4) with the centre of mass at rest.  There p is the velocity and H the
energy divided by the mass of a body, which gives the same motion: :math:`H = \sum|p_i|^2/2 - \sum 1/(N|q_i - q_j|)`.
More than six bodies run on loops instead of derived formulae.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from math import cos, pi, sin, sqrt
from random import Random

import numpy as np
import sympy as sp

from phasebench.integrators.compile.codegen import value_kind
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from phasebench.integrators.systems.hand import HandHamiltonian, unit_mass_field
from phasebench.integrators.values.kinds import Number

from .base import Orbit, Pace, Problem, whole
from .gravity import bodies

PARAMETERS = {"N": 3}
#: The most bodies; the seed of the random start; radii beyond this are drawn again, as in the recipe.
LARGEST, SEED, RADIUS = 128, 1974, 10.0
#: (mass, position) of the Pythagorean problem.
PYTHAGOREAN = ((3, (1.0, 3.0, 0.0)), (4, (-2.0, -1.0, 0.0)), (5, (1.0, -1.0, 0.0)))


def plummer(N: int) -> tuple[list[float], list[float]]:
    """Draw a Plummer sphere, always the same: (positions, velocities), 3 N numbers each; the barycentre rests at 0."""
    draw = Random(SEED).random

    def direction(size: float) -> tuple[float, float, float]:
        z, angle = 1 - 2 * draw(), 2 * pi * draw()
        across = sqrt(1 - z * z)
        return size * across * cos(angle), size * across * sin(angle), size * z

    where, speed = [], []
    unit = 3 * pi / 16
    for _ in range(N):
        r = RADIUS + 1
        while r > RADIUS:
            r = 1 / sqrt((1 - draw()) ** (-2 / 3) - 1)
        while True:  # the speed in units of the escape speed has the density g(x) = x^2 (1 - x^2)^(7/2) < 0.1
            x, y = draw(), draw() / 10
            if y < x * x * (1 - x * x) ** 3.5:
                break
        where.append(direction(unit * r))
        speed.append(direction(x * sqrt(2) * (1 + r * r) ** -0.25 / sqrt(unit)))
    return tuple(
        [a - sum(b) / N for row in z for a, b in zip(row, zip(*z, strict=True), strict=True)] for z in (where, speed)
    )


def grad_V(strength: Number, sign: int = 1) -> Callable[..., None]:
    """Make the function f(q, g) that writes ``sign`` times grad V to g, V = -sum over pairs of ``strength`` / r_ij."""

    def f(q: np.ndarray, g: np.ndarray) -> None:
        for i in range(len(q)):
            g[i] = 0 * q[i]
        for i in range(0, len(q), 3):
            for j in range(i + 3, len(q), 3):
                x, y, z = q[j] - q[i], q[j + 1] - q[i + 1], q[j + 2] - q[i + 2]
                s = x * x + y * y + z * z
                a = sign * strength / (s * s**0.5)
                g[i], g[i + 1], g[i + 2] = g[i] - a * x, g[i + 1] - a * y, g[i + 2] - a * z
                g[j], g[j + 1], g[j + 2] = g[j] + a * x, g[j + 1] + a * y, g[j + 2] + a * z

    return f


def field(strength: Number) -> Callable[..., None]:
    """Make the loop f(q, p, h, lam, dq, dp) of the vector field (p, -grad V), see `systems.hand`."""
    return unit_mass_field(grad_V(strength, -1))


def energy(strength: Number) -> Callable[..., tuple[Number, Number]]:
    """Make the function f(q, p) -> (H, M); H's round-off is about M machine epsilons."""

    def f(q: np.ndarray, p: np.ndarray) -> tuple[Number, Number]:
        T = U = S = 0 * q[0]
        for i in range(0, len(q), 3):
            T = T + (p[i] * p[i] + p[i + 1] * p[i + 1] + p[i + 2] * p[i + 2]) / 2
            for j in range(i + 3, len(q), 3):
                x, y, z = q[j] - q[i], q[j + 1] - q[i + 1], q[j + 2] - q[i + 2]
                s = x * x + y * y + z * z
                u = strength / s**0.5
                U = U + u
                size = abs(q[i] * x) + abs(q[i + 1] * y) + abs(q[i + 2] * z)
                S = S + u / s * (size + abs(q[j] * x) + abs(q[j + 1] * y) + abs(q[j + 2] * z))
        return T - U, 3 * T + U + S

    return f


def nearest(Q: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return the least distance between two bodies in each row of Q (n, 3 N): array (n,); P is not used."""
    from scipy.spatial.distance import pdist

    return np.array([pdist(q.reshape(-1, 3)).min() for q in Q])


def make(N: int) -> Problem:
    """Make the gravitational problem of 2 <= ``N`` <= `LARGEST` bodies."""
    N = whole("N of bodies", N, 2, LARGEST)
    q, p, pairs, distances, kept = bodies(N, "xyz")
    if N == 3:
        m = [mass for mass, _ in PYTHAGOREAN]
        at = tuple(x for _, position in PYTHAGOREAN for x in position)
        start = Orbit("pythagorean", at, (0.0,) * 9, "masses 3, 4, 5 at rest", (1.0, 10.0, 15.0, 16.0, 30.0))
        product = {(i, j): sp.Integer(m[i] * m[j]) for i, j in pairs}
    else:
        m = [1] * N
        start = Orbit("plummer", *map(tuple, plummer(N)), f"a Plummer sphere of {N} bodies")
        product = dict.fromkeys(pairs, sp.Rational(1, N))
    H = sp.Add(*(x**2 / (2 * m[i // 3]) for i, x in enumerate(p)))
    H += sp.Add(*(-product[pair] / r for pair, r in zip(pairs, distances, strict=True)))
    if value_kind(3 * N) == "tuple":
        system = Hamiltonian(q=q, p=p, H=H, singular=distances, invariants=kept.values())
    else:
        loops = {"field": field, "grad_V": grad_V, "energy": energy}
        system = HandHamiltonian(
            q=q,
            p=p,
            H=H,
            loops=loops,
            constants=(Fraction(1, N),),
            invariants=kept.values(),
            singular=[nearest],
        )
    return Problem(
        id="n-body",
        name="gravitational N-body problem",
        source="Burrau 1913, Astron. Nachr. 195, 113-118, and Szebehely & Peters 1967, Astron. J. 72, 876-883 "
        "(Pythagorean); Aarseth, Henon & Wielen 1974, Astron. Astrophys. 37, 183-187 (Plummer sphere)",
        cite=("burrau1913", "szebehely1967", "aarseth1974"),
        system=system,
        orbits=(start,),
        invariants=kept,
        parameters={"N": N},
        pace=Pace(step=0.06, span=0.6, later=0.8),
    )
