"""A chain of 10,000 particles in double wells, by loops written by hand.

H = sum p_i^2 / 2 + k (q_{i+1} - q_i)^2 / 2 + (q_i^2 - 1)^2 / 4 with free ends.  It starts with a kink in the middle
that moves at half the speed of sound.
"""

from math import sqrt

import numpy as np

from phasebench.benchmarks.problems.base import Orbit, Problem
from phasebench.integrators.systems.hand import HandHamiltonian, unit_mass_field


def grad_V(k, sign=1):
    """Make the loop (q, g) that writes ``sign`` times grad V(q) to the array g; k is the constant of the springs."""

    def f(q, g):
        last = len(q) - 1
        left = 0 * q[0]
        for i in range(last):
            right = q[i + 1] - q[i]
            g[i] = sign * (k * (left - right) + (q[i] * q[i] - 1) * q[i])
            left = right
        g[last] = sign * (k * left + (q[last] * q[last] - 1) * q[last])

    return f


def field(k):
    """Make the loop that writes the field dq/dt = p, dp/dt = -grad V to arrays; k is the constant of the springs."""
    return unit_mass_field(grad_V(k, -1))


def energy(k):
    """Make the loop (q, p) -> (H, M); the round-off of H is about M machine epsilons.

    M is the sum of the absolute values of H's terms and of x H_x for every variable x; k is the constant of the
    springs.
    """

    def f(q, p):
        n = len(q)
        H = M = 0 * q[0]
        for i in range(n):
            left = q[i] - q[i - 1] if i > 0 else 0 * q[i]
            right = q[i + 1] - q[i] if i < n - 1 else 0 * q[i]
            well = q[i] * q[i] - 1
            terms = p[i] * p[i] / 2 + k * right * right / 2 + well * well / 4
            H += terms
            M += terms + p[i] * p[i] + abs(q[i] * (k * (left - right) + well * q[i]))
        return H, M

    return f


def make(N=10_000, k=4):
    """Make the problem of a chain of N > 20 particles in double wells, with springs of the constant k between them."""
    N = int(N)
    names = ([f"{x}{i}" for i in range(N)] for x in "qp")
    loops = {"grad_V": grad_V, "field": field, "energy": energy}
    system = HandHamiltonian(**dict(zip("qp", names, strict=True)), loops=loops, constants=(k,), degree=4)
    width = sqrt(2 * k * 0.75)
    q = np.tanh((np.arange(N) - N / 2) / width)
    p = -0.5 * sqrt(k) / width * (1 - q**2)
    return Problem(
        id="chain",
        name="a chain of double wells",
        source="phi^4 lattice",
        system=system,
        orbits=(Orbit("kink", tuple(q), tuple(p), "a kink at half the speed of sound"),),
    )
