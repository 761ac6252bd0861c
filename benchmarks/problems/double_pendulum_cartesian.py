r"""The planar double pendulum in Cartesian coordinates: two points with rods for constraints.

.. math::
    H = \frac{|p_1|^2}{2 m_1} + \frac{|p_2|^2}{2 m_2} + m_1 g\,y_1 + m_2 g\,y_2,\qquad
    \tfrac12(|r_1|^2 - l_1^2) = 0,\quad \tfrac12(|r_2 - r_1|^2 - l_2^2) = 0 ,

with :math:`r_k = (x_k, y_k)`, q = (x1, y1, x2, y2).  Its orbits are those of `double_pendulum` in other coordinates: at
the angles a, b from the downward vertical :math:`r_1 = l_1(\sin a, -\cos a)`, :math:`r_2 = r_1 + l_2(\sin b, -\cos b)`.
"""

from math import cos, radians, sin, sqrt

import sympy as sp

from phasebench.integrators.systems.constrained import ConstrainedHamiltonian

from .base import Orbit, Problem, check_positive, decades

PARAMETERS = {"m1": 1.0, "m2": 1.0, "l1": 1.0, "l2": 1.0, "g": 1.0}
#: Orbit -> the angles at which it starts, and what it is.
STARTS = {
    "regular": (0.2, 0.2 * sqrt(2), "at rest near the slow normal mode"),
    "chaotic": (radians(120), radians(-10), "at rest at 120 and -10 degrees"),
}


def _at_rest(a: float, b: float, l1: float, l2: float) -> tuple[float, ...]:
    """Return q = (x1, y1, x2, y2) at the angles a, b of the rods, of lengths l1, l2, from the downward vertical."""
    x, y = l1 * sin(a), -l1 * cos(a)
    return x, y, x + l2 * sin(b), y - l2 * cos(b)


def make(**parameters: float) -> Problem:
    """Make the double pendulum with masses ``m1``, ``m2``, lengths ``l1``, ``l2`` and gravity ``g``, all positive."""
    check_positive("the double pendulum", **parameters)
    m1, m2, l1, l2, g = (sp.Rational(parameters[name]) for name in PARAMETERS)
    x1, y1, x2, y2, u1, v1, u2, v2 = sp.symbols("x1 y1 x2 y2 u1 v1 u2 v2", real=True)
    lengths = parameters["l1"], parameters["l2"]
    return Problem(
        id="double-pendulum-cartesian",
        name="double pendulum, two points by constraints",
        source="Landau & Lifshitz, Mechanics (1976), section 5, problem 1; Shinbrot, Grebogi, Wisdom & Yorke 1992, "
        "Am. J. Phys. 60, 491-499 (chaos)",
        cite=("landau1976", "shinbrot1992"),
        system=ConstrainedHamiltonian(
            q=[x1, y1, x2, y2],
            p=[u1, v1, u2, v2],
            H=(u1**2 + v1**2) / (2 * m1) + (u2**2 + v2**2) / (2 * m2) + m1 * g * y1 + m2 * g * y2,
            constraints=[(x1**2 + y1**2 - l1**2) / 2, ((x2 - x1) ** 2 + (y2 - y1) ** 2 - l2**2) / 2],
        ),
        orbits=tuple(
            Orbit(name, _at_rest(*angles, *lengths), (0.0,) * 4, about, decades(100.0))
            for name, (*angles, about) in STARTS.items()
        ),
    )
