"""The outer solar system: the Sun with the inner planets, Jupiter, Saturn, Uranus, Neptune, Pluto; d = 18.

Units: astronomical units, days, solar masses.  H = sum |p_i|^2 / (2 m_i) - G sum m_i m_j / |q_i - q_j|, with the Sun at
rest at the origin in the beginning; the momenta are m v, rounded to double.
"""

import numpy as np
import sympy as sp

from phasebench.integrators.families.wisdom_holman import jacobi
from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import Orbit, Pace, Problem, decades, floats
from .gravity import bodies, newton

PARAMETERS: dict[str, float] = {}
G = 2.95912208286e-4
#: Name -> (mass, position, velocity).
BODIES = {
    "sun": (1.00000597682, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "jupiter": (0.000954786104043, (-3.5023653, -3.8169847, -1.5507963), (0.00565429, -0.00412490, -0.00190589)),
    "saturn": (0.000285583733151, (9.0755314, -3.0458353, -1.6483708), (0.00168318, 0.00483525, 0.00192462)),
    "uranus": (0.0000437273164546, (8.3101420, -16.2901086, -7.2521278), (0.00354178, 0.00137102, 0.00055029)),
    "neptune": (0.0000517759138449, (11.4707666, -25.7294829, -10.8169456), (0.00288930, 0.00114527, 0.00039677)),
    "pluto": (1 / 1.3e8, (-15.5387357, -25.2225594, -3.1902382), (0.00276725, -0.00170702, -0.00136504)),
}


def make() -> Problem:
    """Make the problem of the outer solar system, which has no parameters."""
    q, p, pairs, distances, kept = bodies(len(BODIES), "xyz", first=0)
    masses, exact = [sp.Rational(m) for m, _, _ in BODIES.values()], sp.Rational(G)
    where, momenta = (
        floats([x for _, x, _ in BODIES.values()]),
        floats([np.multiply(m, v) for m, _, v in BODIES.values()]),
    )
    about = "the positions and velocities of September 5, 1994"
    return Problem(
        id="outer-solar-system",
        name="outer solar system",
        source="Hairer, Lubich & Wanner 2006, I.2.4",
        cite=("hairer2006",),
        system=Hamiltonian(
            q=q,
            p=p,
            H=newton(p, masses, exact, pairs, distances),
            singular=distances,
            invariants=kept.values(),
            kepler=jacobi(masses, exact),
        ),
        orbits=(Orbit("september-1994", where, momenta, about, decades(500_000.0)),),
        invariants=kept,
        time_unit="day",
        pace=Pace(unit=400.0, step=100.0, span=2500.0, later=700.0),
    )
