"""Records of methods for charged particles; the data are (rule of rotation, fractions of the step).

The methods conserve volume and are not symplectic.  Boris's method nearly conserves the energy if B is constant or the
potential quadratic; otherwise the energy may drift (Hairer & Lubich 2018).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from phasebench.integrators import coefficients
from phasebench.integrators.record import NONE, Method

if TYPE_CHECKING:
    import mpmath


def pusher(*, rule: str, fractions: Iterable[mpmath.mpf | int] = (1,), order: int = 2, **facts: Any) -> Method:
    """Make the record of a symmetric composition of steps over ``fractions`` of h: half a drift, a push, half a drift.

    A push is half a kick by the electric field, a rotation about B, half a kick; ``rule`` names the rotation: "boris",
    "higuera-cary" or "exact".  ``facts`` are further fields of the record.
    """
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
        rule="boris",
    ),
    pusher(
        id="higuera-cary",
        name="the method of Higuera and Cary; Boris's where the particle is not relativistic",
        source="Higuera & Cary 2017",
        cite=("higuera-cary2017",),
        rule="higuera-cary",
    ),
    pusher(
        id="he-splitting-2",
        name="He, Sun, Liu & Qin's splitting with the exact rotation, order 2",
        source="He, Sun, Liu & Qin 2015",
        cite=("he2015",),
        rule="exact",
    ),
    pusher(
        id="he-splitting-4",
        name="He, Sun, Liu & Qin's splitting with the exact rotation, order 4",
        source="He, Sun, Liu & Qin 2015; the triple jump of he-splitting-2",
        cite=("he2015", "forest-ruth1990"),
        rule="exact",
        fractions=coefficients.steps("forest-ruth"),
        order=4,
    ),
)
