r"""A free rigid body as four points at fixed distances: twelve coordinates and six constraints.

.. math::
    H = \sum_{k=1}^4 \frac{|p_k|^2}{2 m_k},\qquad \tfrac12\bigl(|r_i - r_j|^2 - l_{ij}^2\bigr) = 0,\quad i < j .

The body moves as Euler's equations say: :math:`r_k = c + R(t)\,(r_k(0) - c(0))` about its centre of mass c, which moves
uniformly, with the rotation R of a free rigid body.  It conserves the momentum and the angular momentum.

Start: a corner of the unit cube with its three neighbours, which doubles hold exactly, as they do the momenta
:math:`p_k = m_k\,(v + \omega\times(r_k - c))`.
"""

import sympy as sp

from phasebench.integrators.systems.constrained import ConstrainedHamiltonian

from .base import Orbit, Problem, check_positive, decades, floats
from .gravity import bodies

PARAMETERS = {"m1": 1.0, "m2": 0.5, "m3": 0.25, "m4": 0.25}
#: The points at the start, and the body's angular velocity.
POINTS = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
TURN = (0.5, 1.0, -0.25)


def make(**parameters: float) -> Problem:
    """Make the problem of a free rigid body of four points with the masses ``m1`` to ``m4``, all positive."""
    check_positive("the four points", **parameters)
    masses = [sp.Rational(parameters[name]) for name in PARAMETERS]
    q, p, pairs, distances, kept = bodies(4, "xyz")
    start = [sp.Matrix(point) for point in POINTS]
    lengths = [(start[i] - start[j]).norm() for i, j in pairs]
    middle = sum((m * x for m, x in zip(masses, start, strict=True)), sp.zeros(3, 1)) / sum(masses)
    turn = sp.Matrix([sp.Rational(w) for w in TURN])
    momenta = [m * turn.cross(x - middle) for m, x in zip(masses, start, strict=True)]
    about = "a corner of a cube with three neighbours, turning about its centre of mass"
    return Problem(
        id="four-points",
        name="free rigid body, four points by constraints",
        source="Landau & Lifshitz, Mechanics (1976), sections 31-36; data: this suite",
        cite=("landau1976",),
        system=ConstrainedHamiltonian(
            q=q,
            p=p,
            H=sum(x**2 / (2 * masses[i // 3]) for i, x in enumerate(p)),
            constraints=[(r**2 - length**2) / 2 for r, length in zip(distances, lengths, strict=True)],
            invariants=list(kept.values()),
        ),
        orbits=(Orbit("tumbling", floats(start), floats(momenta), about, decades(10.0)),),
        invariants=kept,
    )
