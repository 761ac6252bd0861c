r"""A charged particle in the plane, magnetic field :math:`B = R = |q|`, potential :math:`\phi = \phi_0/R`.

With the vector potential :math:`A = \tfrac R3(-q_2, q_1)`, whose curl is R, and unit mass and charge,

.. math::
    H = \tfrac12 |p - A(q)|^2 + \frac{\phi_0}R ,

not separable; the canonical angular momentum :math:`q_1p_2 - q_2p_1 = R^2\dot\theta + R^3/3` is conserved.  The
particle gyrates with a frequency near R and drifts around the origin.  Start: q = (0, -1), velocity (0.1, 0.01),
p = v + A.
"""

import sympy as sp

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import Orbit, Problem, decades

PARAMETERS = {"phi0": 0.01}


def make(phi0: float) -> Problem:
    """Make the problem of the charged particle, with the strength ``phi0`` >= 0 of the repulsive potential."""
    if not phi0 >= 0:
        raise InvalidInput(f"phi0 is {phi0}; it must not be negative: the origin would attract")
    q1, q2, p1, p2 = sp.symbols("q1 q2 p1 p2", real=True)
    R = sp.sqrt(q1**2 + q2**2)
    L = q1 * p2 - q2 * p1
    H = ((p1 + R * q2 / 3) ** 2 + (p2 - R * q1 / 3) ** 2) / 2 + sp.Rational(phi0) / R
    return Problem(
        id="charged-particle",
        name="charged particle in a magnetic field",
        source="He, Sun, Liu & Qin 2015, J. Comput. Phys. 281, 135-147, section 4.1",
        cite=("he2015",),
        system=Hamiltonian(q=[q1, q2], p=[p1, p2], H=H, singular=[R], invariants=[L]),
        orbits=(Orbit("drift", (0.0, -1.0), (0.1 + 1 / 3, 0.01), "velocity (0.1, 0.01)", decades(1000.0)),),
        invariants={"angular-momentum": L},
    )
