r"""A charged particle in a magnetic mirror: the field grows along its axis, and sends the particle back.

With the vector potential :math:`A = \tfrac12\bigl(1 + z^2/L^2\bigr)(-y, x, 0)` and unit mass and charge,

.. math::
    H = \tfrac12 |p - A(x)|^2 ,\qquad
    B = \nabla\times A = \bigl(-xz/L^2,\ -yz/L^2,\ 1 + z^2/L^2\bigr),

the field of a mirror near its axis, where :math:`B_r = -\tfrac r2\,\partial B_z/\partial z`.  The canonical angular
momentum :math:`x p_y - y p_x` is conserved, the magnetic moment :math:`\mu = v_\perp^2 / 2B` an adiabatic invariant.
With :math:`\mu` constant the motion along the axis is :math:`\ddot z = -\mu\,\partial B/\partial z`: from z = 0 and the
velocities :math:`v_\perp, v_\parallel` it oscillates with the frequency :math:`v_\perp/L` and turns at :math:`|z| = L
v_\parallel/v_\perp`, where B is :math:`(v/v_\perp)^2` times what it was (Northrop 1963).

Start: q = (1/2, 0, 0), velocity (0, 0.3, 0.2).
"""

import sympy as sp

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import Orbit, Problem, decades

PARAMETERS = {"L": 10.0}
#: Position and velocity at the start.
START, VELOCITY = (0.5, 0.0, 0.0), (0.0, 0.3, 0.2)


def make(L: float) -> Problem:
    """Make the problem of a charged particle in a magnetic mirror; the field doubles at the distance ``L`` > 0."""
    if not L > 0:
        raise InvalidInput(f"L is {L}; it must be positive: the field doubles at z = L")
    x, y, z, px, py, pz = sp.symbols("x y z px py pz", real=True)
    half = (1 + z**2 / sp.Rational(L) ** 2) / 2
    angular = x * py - y * px
    H = ((px + half * y) ** 2 + (py - half * x) ** 2 + pz**2) / 2
    p = (VELOCITY[0] - START[1] / 2, VELOCITY[1] + START[0] / 2, VELOCITY[2])
    return Problem(
        id="magnetic-mirror",
        name="charged particle in a magnetic mirror",
        source="Northrop, The Adiabatic Motion of Charged Particles (1963); data: this suite",
        cite=("northrop1963",),
        system=Hamiltonian(q=[x, y, z], p=[px, py, pz], H=H, invariants=[angular]),
        orbits=(Orbit("trapped", START, p, "velocity (0, 0.3, 0.2)", decades(1000.0)),),
        invariants={"angular-momentum": angular},
    )
