"""Records of methods for charged particles; the data are (rule of rotation, fractions of the step).

The methods conserve volume and are not symplectic.  Boris's method nearly conserves the energy if B is constant or the
potential quadratic; otherwise the energy may drift (Hairer & Lubich 2018).
"""

from __future__ import annotations

from typing import Any

from phasebench.integrators import coefficients
from phasebench.integrators.record import NONE, Method


def pusher(id: str, name: str, rule: str, source: str, cite: tuple[str, ...], order: int = 2, data: Any = ()) -> Method:
    """Make the record of a symmetric composition of steps over fractions of h: half a drift, a push, half a drift.

    A push is half a kick by the electric field, a rotation about B, half a kick; ``rule`` names the rotation: "boris",
    "higuera-cary" or "exact".  The one fraction is 1 without ``data``.
    """
    return Method(
        id=id,
        name=name,
        family="magnetic",
        order=order,
        symmetric=True,
        symplectic=False,
        volume=True,
        energy=NONE,
        quadratic=NONE,
        source=source,
        cite=cite,
        requires=("magnetic",),
        data=data or (rule, (1,)),
    )


HE = "He, Sun, Liu & Qin's splitting with the exact rotation"

METHODS: tuple[Method, ...] = (
    pusher(
        "boris",
        "Boris's method for charged particles",
        "boris",
        "Boris 1970; drift first, the tangent of the angle not corrected",
        ("boris1970", "qin2013", "hairer-lubich2018"),
    ),
    pusher(
        "higuera-cary",
        "the method of Higuera and Cary; Boris's where the particle is not relativistic",
        "higuera-cary",
        "Higuera & Cary 2017",
        ("higuera-cary2017",),
    ),
    pusher("he-splitting-2", f"{HE}, order 2", "exact", "He, Sun, Liu & Qin 2015", ("he2015",)),
    pusher(
        "he-splitting-4",
        f"{HE}, order 4",
        "exact",
        "He, Sun, Liu & Qin 2015; the triple jump of he-splitting-2",
        ("he2015", "forest-ruth1990"),
        order=4,
        data=lambda: ("exact", tuple(coefficients.steps("forest-ruth"))),
    ),
)
