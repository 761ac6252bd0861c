"""Systems that several test files make."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import sympy as sp

from phasebench.integrators import Hamiltonian


def of_masses(p: Sequence[sp.Symbol]) -> sp.Expr:
    """Return a kinetic energy with 1 / m = 1/3, 2/3, 1, ..., masses that are not exact doubles."""
    return sum(sp.Rational(i + 1, 3) * x**2 / 2 for i, x in enumerate(p))


def chain(d: int, T: Callable = of_masses, bond: Callable = lambda r: r**4 / 4) -> Hamiltonian:
    """Return a chain of d particles, each in a well and bound to its neighbours.

    ``T`` is a function of the momenta, the kinetic energy; ``bond`` one of the distance of two neighbours.
    """
    q, p = sp.symbols(f"q0:{d}", real=True), sp.symbols(f"p0:{d}", real=True)
    V = sum(x**2 / 2 for x in q) + sum(bond(x - y) for x, y in pairwise(q))
    return Hamiltonian(q=q, p=p, H=T(p) + V)


def general(system: Hamiltonian) -> Hamiltonian:
    """Return the same system treated as having a general T, so that the increments of q and p are the unknowns."""
    other = Hamiltonian(q=system.q, p=system.p, H=system.H)
    other.quadratic_kinetic = False
    return other
