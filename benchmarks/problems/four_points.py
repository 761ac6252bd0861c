r"""A free rigid body as four points at fixed distances: twelve coordinates and six constraints.

.. math::
    H = \sum_{k=1}^4 \frac{|p_k|^2}{2 m_k},\qquad \tfrac12\bigl(|r_i - r_j|^2 - l_{ij}^2\bigr) = 0,\quad i < j .

The body moves as Euler's equations say: :math:`r_k = c + R(t)\,(r_k(0) - c(0))` about its centre of mass c, which moves
uniformly, with the rotation R of a free rigid body.  It conserves the momentum and the angular momentum.

Start: a corner of the unit cube with its three neighbours, which doubles hold exactly, as they do the momenta
:math:`p_k = m_k\,(v + \omega\times(r_k - c))`.
"""

import sympy as sp

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.constrained import ConstrainedHamiltonian

from .base import Orbit, Pace, Problem, decades

PARAMETERS = {"m1": 1.0, "m2": 0.5, "m3": 0.25, "m4": 0.25}
#: The points at the start, and the body's angular velocity.
POINTS = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
TURN = (0.5, 1.0, -0.25)


def make(**parameters: float) -> Problem:
    """Make the problem of a free rigid body of four points with the masses ``m1`` to ``m4``, all positive."""
    for name, value in parameters.items():
        if not value > 0:
            raise InvalidInput(f"{name} of the four points is {value}; it must be positive")
    masses = [sp.Rational(parameters[name]) for name in PARAMETERS]
    q, p = (sp.symbols([f"{name}{k}" for k in range(1, 5) for name in names], real=True) for names in ("xyz", "uvw"))
    r, way = ([sp.Matrix(v[3 * k : 3 * k + 3]) for k in range(4)] for v in (q, p))
    start = [sp.Matrix(point) for point in POINTS]
    pairs = [(i, j) for i in range(4) for j in range(i + 1, 4)]
    middle = sum((m * x for m, x in zip(masses, start, strict=True)), sp.zeros(3, 1)) / sum(masses)
    turn = sp.Matrix([sp.Rational(w) for w in TURN])
    momenta = [m * turn.cross(x - middle) for m, x in zip(masses, start, strict=True)]
    angular = sum((x.cross(v) for x, v in zip(r, way, strict=True)), sp.zeros(3, 1))
    momentum = sum(way, sp.zeros(3, 1))
    invariants = {f"angular-momentum-{x}": e for x, e in zip("xyz", angular, strict=True)}
    invariants |= {f"momentum-{x}": e for x, e in zip("xyz", momentum, strict=True)}
    return Problem(
        id="four-points",
        name="free rigid body, four points by constraints",
        source="Landau & Lifshitz, Mechanics (1976), sections 31-36; data: this suite",
        cite=("landau1976",),
        system=ConstrainedHamiltonian(
            q=q,
            p=p,
            H=sum(v.dot(v) / (2 * m) for v, m in zip(way, masses, strict=True)),
            constraints=[
                ((r[i] - r[j]).dot(r[i] - r[j]) - (start[i] - start[j]).dot(start[i] - start[j])) / 2 for i, j in pairs
            ],
            invariants=list(invariants.values()),
        ),
        orbits=(
            Orbit(
                "tumbling",
                tuple(float(x) for point in start for x in point),
                tuple(float(x) for v in momenta for x in v),
                "a corner of a cube with three neighbours, turning about its centre of mass",
                decades(10.0),
            ),
        ),
        invariants=invariants,
        parameters=parameters,
        pace=Pace(),
    )
