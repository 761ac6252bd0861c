r"""A free rigid body in space: its attitude as a quaternion, three axes of different moments.

.. math::
    H = \frac{L_1^2}{2 I_1} + \frac{L_2^2}{2 I_2} + \frac{L_3^2}{2 I_3},\qquad L_k = \tfrac12\,p\cdot(q\,e_k),

with the quaternions e_k = i, j, k (`systems.rigid`).  The angular momentum in space is conserved, and so is its size G.
With the energy E, the angular momentum in the body goes round the axis of the largest moment of inertia if 2 E is below
G^2 / I_2, and round that of the smallest if it is above.

Start: q = 1 and the angular momenta L about the body's axes.  "tumbling" begins close to the middle axis, about which
rotation is unstable: the body turns over again and again (Dzhanibekov's effect).
"""

from __future__ import annotations

from phasebench.integrators.systems.rigid import RigidBody

from .base import Orbit, Problem, check_positive, decades, floats

PARAMETERS = {"I1": 1.0, "I2": 2.0, "I3": 2.5}
STARTS = {
    "tumbling": ((0.0625, 2.0, 0.0625), "close to the middle axis, L = (1/16, 2, 1/16)"),
    "wobbling": ((0.5, 0.25, 2.0), "around the axis of the largest moment, L = (1/2, 1/4, 2)"),
}


def make(**parameters: float) -> Problem:
    """Make the problem of the free rigid body with principal moments of inertia ``I1``, ``I2``, ``I3``, positive."""
    check_positive("the rigid body", **parameters)
    body = RigidBody(moments=[parameters[name] for name in PARAMETERS])
    states = {name: body.start(attitude=(1, 0, 0, 0), momentum=L) for name, (L, _) in STARTS.items()}
    return Problem(
        id="free-rigid-body",
        name="free rigid body, its attitude as a quaternion",
        source="Landau & Lifshitz, Mechanics (1976), section 37; variables: Miller et al. 2002; data: this suite",
        cite=("landau1976", "miller2002"),
        system=body,
        orbits=tuple(
            Orbit(name, floats(q), floats(p), STARTS[name][1], decades(100.0)) for name, (q, p) in states.items()
        ),
        invariants=body.kept,
    )
