"""Records of Galerkin variational integrators."""

from __future__ import annotations

from phasebench.integrators.record import BOUNDED, ROUND_OFF, Method

MW, OS = "Marsden & West 2001, 2.6.6", "Ober-Bloebaum & Saake 2015"


def galerkin(
    *,
    id: str,
    name: str,
    degree: int,
    quadrature: str,
    nodes: int,
    order: int,
    source: str = MW,
    cite: tuple[str, ...] = ("marsden2001",),
) -> Method:
    """Make the record of the Galerkin variational integrator with polynomials of a ``degree`` and a quadrature rule.

    ``quadrature`` is "gauss" or "lobatto", ``nodes`` the number of its nodes.  The other arguments are fields of the
    record.
    """
    return Method(
        id=id,
        name=name,
        family="variational",
        order=order,
        symmetric=True,
        symplectic=True,
        energy=BOUNDED,
        quadratic=ROUND_OFF,
        source=source,
        cite=cite,
        requires=("separable", "quadratic kinetic energy"),
        data=(degree, quadrature, nodes),
    )


BOTH = {"source": f"{MW}; {OS}", "cite": ("marsden2001", "ober-bloebaum2015")}

METHODS: tuple[Method, ...] = (
    galerkin(
        id="variational-midpoint", name="variational midpoint rule", degree=1, quadrature="gauss", nodes=1, order=2
    ),
    galerkin(
        id="variational-trapezoidal",
        name="variational trapezoidal rule",
        degree=1,
        quadrature="lobatto",
        nodes=2,
        order=2,
    ),
    galerkin(
        id="variational-gauss-2",
        name="Galerkin variational, degree 2, 2 Gauss nodes",
        degree=2,
        quadrature="gauss",
        nodes=2,
        order=4,
        **BOTH,
    ),
    galerkin(
        id="variational-gauss-3",
        name="Galerkin variational, degree 3, 3 Gauss nodes",
        degree=3,
        quadrature="gauss",
        nodes=3,
        order=6,
        **BOTH,
    ),
    galerkin(
        id="variational-lobatto-3",
        name="Galerkin variational, degree 2, 3 Lobatto nodes",
        degree=2,
        quadrature="lobatto",
        nodes=3,
        order=4,
        **BOTH,
    ),
    galerkin(
        id="variational-lobatto-4",
        name="Galerkin variational, degree 3, 4 Lobatto nodes",
        degree=3,
        quadrature="lobatto",
        nodes=4,
        order=6,
        **BOTH,
    ),
    galerkin(
        id="variational-2-3",
        name="Galerkin variational, degree 2, 3 Gauss nodes",
        degree=2,
        quadrature="gauss",
        nodes=3,
        order=4,
        **BOTH,
    ),
)
