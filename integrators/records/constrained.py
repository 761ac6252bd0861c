"""Records of methods for constraints g(q) = 0: RATTLE, SHAKE, a composition, and collocation on the manifold.

The field ``symplectic`` refers to the manifold of the constraints and the hidden constraints: the map conserves the
two-form of phase space for tangents of the manifold.
"""

from __future__ import annotations

from typing import Any

from phasebench.integrators.record import NONE, SYMPLECTIC, Method

from .compositions import compose

HLW = "Hairer, Lubich & Wanner 2006"


def constrained(*, requires: tuple[str, ...] = (), **facts: Any) -> Method:
    """Make the record of a method for systems with constraints, symplectic on their manifold by default.

    ``requires`` are traits that the system must have besides the constraints.
    """
    return Method(requires=("constrained", *requires), **(SYMPLECTIC | {"quadratic": NONE} | facts))


def rattle(*, project: bool = True, **facts: Any) -> Method:
    """Make the record of RATTLE, or of SHAKE, which does not ``project`` the momenta onto the hidden constraints."""
    return constrained(family="rattle", order=2, requires=("constant mass matrix",), data=((1,), project), **facts)


RATTLE = rattle(
    id="rattle",
    name="RATTLE: Stormer-Verlet with constraints",
    source=f"Andersen 1983; Leimkuhler & Skeel 1994; {HLW}, VII.1.4",
    cite=("andersen1983", "leimkuhler-skeel1994", "hairer2006"),
)

METHODS: tuple[Method, ...] = (
    RATTLE,
    rattle(
        id="shake",
        name="SHAKE: RATTLE's q, and p from their differences, off the hidden constraints",
        source=f"Ryckaert, Ciccotti & Berendsen 1977; {HLW}, VII.1.4",
        cite=("ryckaert1977", "leimkuhler-skeel1994", "hairer2006"),
        project=False,
        symmetric=False,
        tangent=False,
    ),
    compose(
        RATTLE,
        "forest-ruth",
        id="rattle-yoshida-4",
        name="RATTLE, composed of three steps by the triple jump",
        source="Yoshida 1990; Reich 1996; the triple jump of rattle",
        cite=("andersen1983", "yoshida1990", "reich1996"),
    ),
    *(
        constrained(
            id=f"lobatto-iiia-iiib-constrained-{2 * s - 2}",
            name=f"Lobatto IIIA - IIIB on the manifold of constraints, {s} stages",
            family="manifold",
            order=2 * s - 2,
            source=f"Jay 1996; {HLW}, VII.1.5",
            cite=("jay1996", "hairer2006"),
            data=(s,),
        )
        for s in (2, 3, 4)
    ),
)
