r"""The figure eight: three equal masses follow one another along one closed curve in the plane, m = G = 1.

.. math::
    H = \tfrac12\sum_i |p_i|^2 - \sum_{i<j} \frac1{|q_i - q_j|}

Start: q1 = -q2, q3 = 0, p1 = p2 = -p3/2, with Simo's data.  They are printed to eight digits with the period
T = 6.32591398.  The further digits come from Li & Liao's data to 18 digits for the same motion, which start from
(-1, 0), (1, 0), (0, 0), rotated so that the curve's axes are the coordinate axes.  The motion is linearly stable.
"""

import sympy as sp

from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import Orbit, Problem
from .gravity import bodies

PARAMETERS: dict[str, float] = {}
#: Position of the first body and momentum of the third, and the period.
FIRST, THIRD = (0.97000435669733344, -0.24308753153584886), (-0.9324073714410523, -0.864731460921006)
PERIOD = 6.32591398292621
#: Four times, each ten times the one before; the last is ten periods.
TIMES = (0.0632591398, 0.632591398, 6.32591398, 63.2591398)


def make() -> Problem:
    """Make the problem of the figure-eight orbit of three bodies, which has no parameters."""
    q, p, _, distances, kept = bodies(3, "xy")
    (x, y), (u, v) = FIRST, THIRD
    where = (x, y, -x, -y, 0.0, 0.0)
    return Problem(
        id="figure-eight",
        name="figure eight of three bodies",
        source="Moore 1993, Phys. Rev. Lett. 70, 3675-3679; Chenciner & Montgomery 2000, Ann. of Math. 152, 881-901 "
        "(with Simo's data); Li & Liao 2017, Sci. China Phys. Mech. Astron. 60, 129511 (digits)",
        cite=("moore1993", "chenciner2000", "li-liao2017"),
        system=Hamiltonian(
            q=q,
            p=p,
            H=sp.Add(*(z**2 / 2 for z in p)) + sp.Add(*(-1 / r for r in distances)),
            singular=distances,
            invariants=kept.values(),
        ),
        orbits=(Orbit("simo", where, (-u / 2, -v / 2, -u / 2, -v / 2, u, v), f"period {PERIOD:.11g}", TIMES),),
        invariants=kept,
    )
