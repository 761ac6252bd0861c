"""Lotka-Volterra, u' = u (v - 2), v' = v (1 - u), in its own variables: partitioned, not canonical.

The invariant I = ln u - u + 2 ln v - v takes the energy's place.  q = u, p = v: the symplectic Euler method that is
implicit in u and explicit in v is ``symplectic-euler-q``.
"""

import sympy as sp

from integrators.hamiltonian import PartitionedSystem

from .base import Orbit, Problem

PARAMETERS: dict[str, float] = {}


def make() -> Problem:
    """The problem with the talk's starting points."""
    u, v = sp.symbols("u v", real=True)
    return Problem(
        id="lotka-volterra",
        name="Lotka-Volterra in its own variables",
        source="Hairer, Lubich & Wanner 2006, I.1.1; talk on symplectic integration, 'Numerical experiments'",
        system=PartitionedSystem(
            q=[u], p=[v], dq=[u * (v - 2)], dp=[v * (1 - u)], energy=sp.log(u) - u + 2 * sp.log(v) - v
        ),
        orbits=tuple(
            Orbit(f"{a}-{b}", (float(a),), (float(b),), f"from ({a}, {b})") for a, b in [(2, 2), (4, 8), (4, 2), (6, 2)]
        ),
    )
