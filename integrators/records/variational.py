"""Records of Galerkin variational integrators."""

from __future__ import annotations

from phasebench.integrators.record import SYMPLECTIC, Method

MW, OS = "Marsden & West 2001, 2.6.6", "Ober-Bloebaum & Saake 2015"


def galerkin(id: str, degree: int, quadrature: str, nodes: int, order: int, name: str = "") -> Method:
    """Make the record of the Galerkin variational integrator with polynomials of a ``degree`` and a quadrature rule.

    ``quadrature`` is "gauss" or "lobatto", ``nodes`` the number of its nodes.
    """
    both = degree > 1
    return Method(
        id=f"variational-{id}",
        name=name or f"Galerkin variational, degree {degree}, {nodes} {quadrature.capitalize()} nodes",
        family="variational",
        order=order,
        source=f"{MW}; {OS}" if both else MW,
        cite=("marsden2001", "ober-bloebaum2015") if both else ("marsden2001",),
        requires=("separable", "quadratic kinetic energy", "constant mass matrix"),
        data=(degree, quadrature, nodes),
        **SYMPLECTIC,
    )


METHODS: tuple[Method, ...] = (
    galerkin("midpoint", 1, "gauss", 1, order=2, name="variational midpoint rule"),
    galerkin("trapezoidal", 1, "lobatto", 2, order=2, name="variational trapezoidal rule"),
    galerkin("gauss-2", 2, "gauss", 2, order=4),
    galerkin("gauss-3", 3, "gauss", 3, order=6),
    galerkin("lobatto-3", 2, "lobatto", 3, order=4),
    galerkin("lobatto-4", 3, "lobatto", 4, order=6),
    galerkin("2-3", 2, "gauss", 3, order=4),
)
