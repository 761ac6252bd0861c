r"""n-Butane as four united atoms with fixed bonds and angles: a chain that turns about its middle bond.

.. math::
    H = \sum_i \frac{|p_i|^2}{2 m_i} + \sum_{k=0}^5 a_k c^k,\qquad
    c = -\frac{n_1\cdot n_2}{|n_1|\,|n_2|} = \cos\varphi,\qquad n_k = b_k\times b_{k+1}

with the bonds :math:`b_k = r_{k+1} - r_k`, |b_k| = 1, and the angle between neighbours, :math:`b_k\cdot b_{k+1} = 1/3`
(109.47 degrees), which the distances of second neighbours fix.  phi = 0 is trans.  Units: the bond's 0.153 nm, the mass
of CH2 (14 atomic units; CH3 has 15/14), and 1000 K k_B, hence the time 0.199 ps.
"""

from math import cos, pi, sin, sqrt

import numpy as np
import sympy as sp

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.constrained import ConstrainedHamiltonian

from .base import Orbit, Problem, decades, floats
from .gravity import bodies

PARAMETERS = {"phi": 1.0}
#: Masses of CH3, CH2, CH2, CH3; coefficients of the powers of cos phi.
MASSES = (sp.Rational(15, 14), sp.Integer(1), sp.Integer(1), sp.Rational(15, 14))
TORSION = tuple(sp.Rational(a, 1000) for a in (1116, 1462, -1578, -368, 3156, -3788))
#: The angular velocity of the whole molecule at the start.
TURN = (0.3, 0.2, -0.4)


def _system() -> tuple[ConstrainedHamiltonian, dict[str, sp.Expr]]:
    q, p, _, _, kept = bodies(4, "xyz")
    r = [sp.Matrix(q[3 * k : 3 * k + 3]) for k in range(4)]
    b = [r[k + 1] - r[k] for k in range(3)]
    n = [b[k].cross(b[k + 1]) for k in range(2)]
    c = -n[0].dot(n[1]) / sp.sqrt(n[0].dot(n[0]) * n[1].dot(n[1]))
    kinetic = sum(p[3 * k + i] ** 2 / (2 * MASSES[k]) for k in range(4) for i in range(3))
    bonds = [(x.dot(x) - 1) / 2 for x in b]
    angles = [((r[k + 2] - r[k]).dot(r[k + 2] - r[k]) - sp.Rational(8, 3)) / 2 for k in range(2)]
    H = kinetic + sum(a * c**k for k, a in enumerate(TORSION))
    return ConstrainedHamiltonian(q=q, p=p, H=H, constraints=[*bonds, *angles]), kept


def start(phi: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the state (q, p), arrays (12,), at the torsion angle ``phi`` in radians, turning as a whole by `TURN`."""
    s, masses = sqrt(8) / 3, np.array(MASSES, dtype=float)[:, None]
    r = np.array([[-1 / 3, -s, 0], [0, 0, 0], [1, 0, 0], [4 / 3, s * cos(phi), s * sin(phi)]])
    r -= (masses * r).sum(axis=0) / masses.sum()
    return r.ravel(), (masses * np.cross(TURN, r)).ravel()


def make(phi: float) -> Problem:
    """Make the problem of the butane molecule; ``phi`` is the torsion angle at the start, in radians from trans."""
    if not abs(phi) <= pi:
        raise InvalidInput(f"the torsion phi is {phi}; it is an angle in radians from -pi to pi")
    system, kept = _system()
    q, p = start(phi)
    return Problem(
        id="butane",
        name="butane, four atoms with fixed bonds and angles",
        source="Ryckaert & Bellemans 1975, Chem. Phys. Lett. 30, 123-125 (the torsion); Ryckaert, Ciccotti & Berendsen "
        "1977, J. Comput. Phys. 23, 327-341 (the molecule)",
        cite=("ryckaert1975", "ryckaert1977"),
        system=system,
        orbits=(
            Orbit("turning", floats(q), floats(p), f"{phi:g} radians from trans, turning as a whole", decades(10.0)),
        ),
        invariants=kept,
    )
