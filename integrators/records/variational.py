"""Variational integrators."""

from __future__ import annotations

from phasebench.integrators.record import BOUNDED, ROUND_OFF, Method

MW, OS = "Marsden & West 2001, 2.6.6", "Ober-Bloebaum & Saake 2015"


def galerkin(id, name, degree, quadrature, nodes, order, source=MW, cite=("marsden2001",)):
    """Polynomials of that degree with a quadrature of so many nodes."""
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
    galerkin("variational-midpoint", "variational midpoint rule", 1, "gauss", 1, 2),
    galerkin("variational-trapezoidal", "variational trapezoidal rule", 1, "lobatto", 2, 2),
    galerkin("variational-gauss-2", "Galerkin variational, degree 2, 2 Gauss nodes", 2, "gauss", 2, 4, **BOTH),
    galerkin("variational-gauss-3", "Galerkin variational, degree 3, 3 Gauss nodes", 3, "gauss", 3, 6, **BOTH),
    galerkin("variational-lobatto-3", "Galerkin variational, degree 2, 3 Lobatto nodes", 2, "lobatto", 3, 4, **BOTH),
    galerkin("variational-lobatto-4", "Galerkin variational, degree 3, 4 Lobatto nodes", 3, "lobatto", 4, 6, **BOTH),
    galerkin("variational-2-3", "Galerkin variational, degree 2, 3 Gauss nodes", 2, "gauss", 3, 4, **BOTH),
)
