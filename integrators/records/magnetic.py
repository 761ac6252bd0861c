"""Records of methods for charged particles: a rule of rotation and fractions of the step (family `magnetic`).

They keep volume and are not symplectic.  That of Boris keeps the energy nearly where B is constant or the potential
quadratic; elsewhere it may drift (Hairer & Lubich 2018).
"""

from __future__ import annotations

from phasebench.integrators import coefficients
from phasebench.integrators.families.magnetic import BORIS, EXACT, HIGUERA_CARY
from phasebench.integrators.record import NONE, Method


def pusher(*, rule: int, fractions=(1,), order: int = 2, **facts) -> Method:
    """Make the record of a symmetric composition of drift, push and drift over ``fractions`` of the step."""
    return Method(
        family="magnetic",
        order=order,
        symmetric=True,
        symplectic=False,
        volume=True,
        energy=NONE,
        quadratic=NONE,
        requires=("magnetic",),
        data=(rule, tuple(fractions)),
        **facts,
    )


METHODS: tuple[Method, ...] = (
    pusher(
        id="boris",
        name="Boris's method for charged particles",
        source="Boris 1970; drift first, the tangent of the angle not corrected",
        cite=("boris1970", "qin2013", "hairer-lubich2018"),
        rule=BORIS,
    ),
    pusher(
        id="higuera-cary",
        name="the method of Higuera and Cary; Boris's where the particle is not relativistic",
        source="Higuera & Cary 2017",
        cite=("higuera-cary2017",),
        rule=HIGUERA_CARY,
    ),
    pusher(
        id="he-splitting-2",
        name="He, Sun, Liu & Qin's splitting with the exact rotation, order 2",
        source="He, Sun, Liu & Qin 2015",
        cite=("he2015",),
        rule=EXACT,
    ),
    pusher(
        id="he-splitting-4",
        name="He, Sun, Liu & Qin's splitting with the exact rotation, order 4",
        source="He, Sun, Liu & Qin 2015; the triple jump of he-splitting-2",
        cite=("he2015", "forest-ruth1990"),
        rule=EXACT,
        fractions=coefficients.steps("forest-ruth"),
        order=4,
    ),
)
