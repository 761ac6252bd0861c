r"""The planar double pendulum in canonical momenta: not separable, chaotic at intermediate energies.

With :math:`\Delta = q_1 - q_2` and the angles q from the downward vertical,

.. math::
    H = \frac{m_2 l_2^2 p_1^2 + (m_1 + m_2) l_1^2 p_2^2 - 2 m_2 l_1 l_2 p_1 p_2\cos\Delta}
    {2 m_2 l_1^2 l_2^2 (m_1 + m_2\sin^2\Delta)} - (m_1 + m_2) g l_1\cos q_1 - m_2 g l_2\cos q_2 .

For equal masses and lengths the normal frequencies at rest are :math:`\sqrt{(g/l)(2 \mp \sqrt2)}`, with
:math:`q_2 = \pm\sqrt2\,q_1` (Landau & Lifshitz, section 23, problem 2).

The chaotic orbit is released at rest from (120, -10) degrees, a start in wide use; from rest, g only sets the unit of
time.  The regular orbit, a choice of this suite, is released near the slow normal mode.
"""

from math import radians, sqrt

import sympy as sp

from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import Orbit, Problem, check_positive, decades

PARAMETERS = {"m1": 1.0, "m2": 1.0, "l1": 1.0, "l2": 1.0, "g": 1.0}


def make(**parameters: float) -> Problem:
    """Make the double pendulum with masses ``m1``, ``m2``, lengths ``l1``, ``l2`` and gravity ``g``, all positive."""
    check_positive("the double pendulum", **parameters)
    m1, m2, l1, l2, g = (sp.Rational(parameters[name]) for name in PARAMETERS)
    q1, q2, p1, p2 = sp.symbols("q1 q2 p1 p2", real=True)
    T = m2 * l2**2 * p1**2 + (m1 + m2) * l1**2 * p2**2 - 2 * m2 * l1 * l2 * p1 * p2 * sp.cos(q1 - q2)
    T /= 2 * m2 * l1**2 * l2**2 * (m1 + m2 * sp.sin(q1 - q2) ** 2)
    return Problem(
        id="double-pendulum",
        name="double pendulum",
        source="Landau & Lifshitz, Mechanics (1976), section 5, problem 1; Shinbrot, Grebogi, Wisdom & Yorke 1992, "
        "Am. J. Phys. 60, 491-499 (chaos)",
        cite=("landau1976", "shinbrot1992"),
        system=Hamiltonian(q=[q1, q2], p=[p1, p2], H=T - (m1 + m2) * g * l1 * sp.cos(q1) - m2 * g * l2 * sp.cos(q2)),
        orbits=(
            Orbit(
                "chaotic", (radians(120), radians(-10)), (0.0, 0.0), "at rest at 120 and -10 degrees", decades(100.0)
            ),
            Orbit("regular", (0.2, 0.2 * sqrt(2)), (0.0, 0.0), "at rest near the slow normal mode", decades(100.0)),
        ),
    )
