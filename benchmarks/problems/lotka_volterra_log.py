"""Lotka-Volterra in logarithms, x = ln u and y = ln v: canonical and separable, with a T(y) that is not quadratic.

H = e^y - 2 y + e^x - x, so that x' = e^y - 2 and y' = 1 - e^x; H = -I, the invariant of the problem `lotka_volterra`
in u and v.  The orbits are the same; they start from the logarithms of the same points, rounded to doubles.
"""

from math import log

import sympy as sp

from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import Orbit, Problem, decades

PARAMETERS: dict[str, float] = {}


def make() -> Problem:
    """Make the Lotka-Volterra problem in logarithms, with the starting points of ``lotka-volterra``."""
    x, y = sp.symbols("x y", real=True)
    return Problem(
        id="lotka-volterra-log",
        name="Lotka-Volterra in logarithms",
        source="Hairer, Lubich & Wanner 2006, I.1.1, VII.2.3; talk on symplectic integration, 'Numerical experiments'",
        cite=("hairer2006", "wang-talk"),
        system=Hamiltonian(q=[x], p=[y], H=sp.exp(y) - 2 * y + sp.exp(x) - x),
        orbits=tuple(
            Orbit(f"{a}-{b}", (log(a),), (log(b),), f"from (u, v) = ({a}, {b})", decades(120.0))
            for a, b in [(2, 2), (4, 8), (4, 2), (6, 2)]
        ),
    )
