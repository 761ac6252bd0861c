r"""The spherical pendulum in Cartesian coordinates: a point on the unit sphere under gravity, by a constraint.

.. math::
    H = \tfrac12 |p|^2 + g\,q_3,\qquad \tfrac12(|q|^2 - 1) = 0 .

The vertical angular momentum :math:`q_1 p_2 - q_2 p_1` is conserved.  With z the height, :math:`\dot z^2 = 2(E - gz)(1
- z^2) - L^2`, so that z moves periodically between two circles of latitude (Landau & Lifshitz, section 14, problem 1).

Start: q = (1, 0, 0), p = (0, 3/4, 1/4), which is exactly on the sphere and tangent to it in doubles.
"""

import sympy as sp

from phasebench.integrators.systems.constrained import ConstrainedHamiltonian

from .base import Orbit, Problem, check_positive, decades

PARAMETERS = {"g": 1.0}


def make(g: float) -> Problem:
    """Make the spherical pendulum of unit length and mass with gravity ``g`` > 0."""
    check_positive("the spherical pendulum", g=g)
    x, y, z, px, py, pz = sp.symbols("x y z px py pz", real=True)
    angular = x * py - y * px
    return Problem(
        id="spherical-pendulum",
        name="spherical pendulum, on the sphere by a constraint",
        source="Landau & Lifshitz, Mechanics (1976), section 14, problem 1; data: this suite",
        cite=("landau1976",),
        system=ConstrainedHamiltonian(
            q=[x, y, z],
            p=[px, py, pz],
            H=(px**2 + py**2 + pz**2) / 2 + sp.Rational(g) * z,
            constraints=[(x**2 + y**2 + z**2 - 1) / 2],
            invariants=[angular],
        ),
        orbits=(
            Orbit(
                "tilted", (1.0, 0.0, 0.0), (0.0, 0.75, 0.25), "from the equator, momentum (0, 3/4, 1/4)", decades(100.0)
            ),
        ),
        invariants={"angular-momentum": angular},
    )
