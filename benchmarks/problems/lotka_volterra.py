"""Lotka-Volterra, u' = u (v - 2), v' = v (1 - u), in its own variables: a Poisson system, not canonical.

The invariant I = ln u - u + 2 ln v - v takes the energy's place; with it the structure matrix is [[0, -uv], [uv, 0]].
q = u, p = v: the symplectic Euler method that is implicit in u and explicit in v is ``symplectic-euler-q``.
"""

import sympy as sp

from phasebench.integrators.systems.poisson import PoissonSystem

from .base import DRIFT, ORDER, Orbit, Problem, Scene, decades, halvings

PARAMETERS: dict[str, float] = {}
SCENES = (
    Scene("lotka-volterra-t1", "lotka-volterra:4-2", ORDER, 1.2, halvings(0.12, 6)),
    Scene("lotka-volterra-t120", "lotka-volterra:4-2", DRIFT, 120.0, (0.12, 0.06, 0.03)),
)


def make() -> Problem:
    """Make the Lotka-Volterra problem in its own variables, with four starting points (cited in its ``source``)."""
    u, v = sp.symbols("u v", real=True)
    return Problem(
        id="lotka-volterra",
        name="Lotka-Volterra in its own variables",
        source="Hairer, Lubich & Wanner 2006, I.1.1; talk on symplectic integration, 'Numerical experiments'",
        cite=("hairer2006", "wang-talk"),
        system=PoissonSystem(
            q=[u],
            p=[v],
            B=[[0, -u * v], [u * v, 0]],
            H=sp.log(u) - u + 2 * sp.log(v) - v,
            dq=[u * (v - 2)],
            dp=[v * (1 - u)],
        ),
        orbits=tuple(
            Orbit(f"{a}-{b}", (float(a),), (float(b),), f"from ({a}, {b})", decades(120.0))
            for a, b in [(2, 2), (4, 8), (4, 2), (6, 2)]
        ),
    )
