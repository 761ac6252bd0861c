r"""A heavy top: a rigid body about a fixed point under gravity, its attitude as a quaternion.

.. math::
    H = \sum_k \frac{L_k^2}{2 I_k} + x_1 R_{31} + x_3 R_{33},\qquad L_k = \tfrac12\,p\cdot(q\,e_k),

with the rotation matrix R of q and (x_1, 0, x_3) the weight times the centre of mass, in the body (`systems.rigid`).
The vertical angular momentum is conserved.  With the default moments and centre of mass it is Lagrange's top: the
angular momentum about its axis is conserved, too, and :math:`z = R_{33}` moves as a particle in a cubic potential
(Landau & Lifshitz, section 35).  Other values of ``I2`` or ``x1`` make it chaotic.

Start: the axis tilted by the rotation q = (4/5, 3/5, 0, 0) about the first axis, and the angular momenta L about the
body's axes.
"""

from __future__ import annotations

from phasebench.integrators.systems.rigid import RigidBody

from .base import Orbit, Problem, check_positive, decades, floats

PARAMETERS = {"I1": 1.0, "I2": 1.0, "I3": 0.5, "x1": 0.0, "x3": 1.0}
STARTS = {
    "nutating": ((0.0, 0.0, 2.0), "released while it spins, L = (0, 0, 2)"),
    "slow": ((0.25, 0.5, 0.5), "a slow spin: the axis swings through the lowest place, L = (1/4, 1/2, 1/2)"),
}


def make(**parameters: float) -> Problem:
    """Make the top of moments ``I1``, ``I2``, ``I3`` > 0; (``x1``, 0, ``x3``) is its weight times the centre."""
    moments = {name: parameters[name] for name in ("I1", "I2", "I3")}
    check_positive("the top", **moments)
    weights = {f"r3{k}": parameters[f"x{k}"] for k in (1, 3) if parameters[f"x{k}"] != 0}
    top = RigidBody(moments=[*moments.values()], V=" + ".join(f"({x!r})*{name}" for name, x in weights.items()) or "0")
    states = {name: top.start(attitude=(0.8, 0.6, 0, 0), momentum=L) for name, (L, _) in STARTS.items()}
    return Problem(
        id="heavy-top",
        name="heavy top, its attitude as a quaternion",
        source="Landau & Lifshitz, Mechanics (1976), section 35; variables: Miller et al. 2002; data: this suite",
        cite=("landau1976", "miller2002"),
        system=top,
        orbits=tuple(
            Orbit(name, floats(q), floats(p), STARTS[name][1], decades(100.0)) for name, (q, p) in states.items()
        ),
        invariants=top.kept,
    )
