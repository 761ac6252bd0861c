r"""The free rigid body in the canonical variables of Serret and Andoyer, one degree of freedom.

With the angular momentum :math:`m = (\sqrt{G^2 - L^2}\sin l, \sqrt{G^2 - L^2}\cos l, L)` in the body and its size G,
Euler's equations :math:`\dot m = m\times I^{-1}m` are the Hamiltonian system in q = l, p = L of

.. math::
    H = \tfrac12 (G^2 - L^2)\Bigl(\frac{\sin^2 l}{I_1} + \frac{\cos^2 l}{I_2}\Bigr) + \frac{L^2}{2 I_3} ,

not separable.  (Euler's equations themselves are a Poisson system in R^3: of odd dimension, they have no q and p.)  The
variables degenerate at L = G and L = -G, where H is smooth but l has no meaning.

The moments and the start m = (cos 1.1, 0, sin 1.1) are those of Hairer, Lubich & Wanner (they violate
:math:`I_1\le I_2 + I_3`: no body has these moments, but the equations hold).  "around-e1" exchanges two components,
"near-separatrix" is close to the rotation about the unstable middle axis.  m is an elliptic function of time.
"""

from math import cos, pi, sin

import sympy as sp

from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import Orbit, Problem, check_positive, decades

PARAMETERS = {"I1": 2.0, "I2": 1.0, "I3": 2 / 3, "G": 1.0}


def make(**parameters: float) -> Problem:
    """Make the free rigid body of moments ``I1``, ``I2``, ``I3`` and angular momentum ``G``, all positive."""
    check_positive("the rigid body", **parameters)
    I1, I2, I3, G = (sp.Rational(parameters[name]) for name in PARAMETERS)
    q, p = sp.symbols("l L", real=True)
    H = (G**2 - p**2) * (sp.sin(q) ** 2 / I1 + sp.cos(q) ** 2 / I2) / 2 + p**2 / (2 * I3)
    size = parameters["G"]
    return Problem(
        id="rigid-body",
        name="free rigid body",
        source="Serret 1866; Andoyer, Cours de mecanique celeste (1923); Deprit 1967, Am. J. Phys. 35, 424-428; "
        "data: Hairer, Lubich & Wanner 2006, IV.1 and VII.5",
        cite=("andoyer1923", "deprit1967", "hairer2006"),
        system=Hamiltonian(q=[q], p=[p], H=H),
        orbits=(
            Orbit("around-e3", (pi / 2,), (size * sin(1.1),), "m = G (cos 1.1, 0, sin 1.1)", decades(200.0)),
            Orbit("around-e1", (pi / 2,), (size * cos(1.1),), "m = G (sin 1.1, 0, cos 1.1)", decades(200.0)),
            Orbit(
                "near-separatrix", (0.01,), (size * 0.02,), "almost the rotation about the middle axis", decades(200.0)
            ),
        ),
    )
