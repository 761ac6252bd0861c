r"""A frozen argon crystal: seven atoms in the plane with the Lennard-Jones potential, in reduced units.

.. math::
    H = \tfrac12\sum_i |p_i|^2 + \sum_{i<j} 4\,(r_{ij}^{-12} - r_{ij}^{-6})

One atom in the middle of six.  Units: sigma = 0.341 nm, epsilon = 119.8 K k_B, the mass 66.34e-27 kg of an atom, hence
the time sigma (m / epsilon)^(1/2) = 2.16 ps.  The positions (nm) and velocities (nm/ns) that Hairer, Lubich & Wanner
print (section I.4) are divided by these units and rounded to double; total momentum zero, temperature 22.72 K,
H = -1260.2 K k_B.
"""

from math import sqrt

import numpy as np
import sympy as sp

from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import Orbit, Pace, Problem, floats
from .gravity import bodies

PARAMETERS: dict[str, float] = {}
#: Length (nm), energy (K), Boltzmann's constant (J/K), mass (kg) as printed.
SIGMA, EPSILON, BOLTZMANN, MASS = 0.341, 119.8, 1.380658e-23, 66.34e-27
#: Positions (nm) and velocities (nm/ns) of the atoms.
POSITIONS = ((0, 0), (0.02, 0.39), (0.34, 0.17), (0.36, -0.21), (-0.02, -0.40), (-0.35, -0.16), (-0.31, 0.21))
VELOCITIES = ((-30, -20), (50, -90), (-70, -60), (90, 40), (80, 90), (-40, 100), (-80, -60))


def make() -> Problem:
    """Make the problem of the seven argon atoms, which has no parameters."""
    q, p, _, distances, kept = bodies(len(POSITIONS), "xy")
    speed = sqrt(EPSILON * BOLTZMANN / MASS)  # m/s = nm/ns
    where, velocities = floats(np.array(POSITIONS) / SIGMA), floats(np.array(VELOCITIES) / speed)
    H = sp.Add(*(x**2 / 2 for x in p)) + sp.Add(*(4 * (r**-12 - r**-6) for r in distances))
    return Problem(
        id="lennard-jones",
        name="frozen argon crystal",
        source="Hairer, Lubich & Wanner 2006, I.4; Biesiadecki & Skeel 1993, J. Comput. Phys. 109, 318-328",
        cite=("hairer2006", "biesiadecki1993"),
        system=Hamiltonian(q=q, p=p, H=H, singular=distances, invariants=kept.values()),
        orbits=(Orbit("argon", where, velocities, "seven atoms of 22.72 K", (0.1, 1.0, 10.0)),),
        invariants=kept,
        pace=Pace(unit=0.2, step=0.005, span=0.5, later=0.1),
    )
