"""Records of symmetric linear multistep methods for H = p . M^-1 p / 2 + V(q)."""

from __future__ import annotations

from phasebench.integrators.coefficients.multistep import QUINLAN_TREMAINE
from phasebench.integrators.record import BOUNDED, Method


def symmetric_multistep(order: int) -> Method:
    """Make the record of the symmetric multistep method of Quinlan and Tremaine of order 8, 10, 12 or 14."""
    table = QUINLAN_TREMAINE[order]
    return Method(
        id=f"quinlan-tremaine-{order}",
        name=f"symmetric multistep method of Quinlan and Tremaine, order {order}",
        family="multistep",
        order=order,
        symmetric=True,  # as a recursion: it is no map of phase space
        symplectic=False,
        energy=BOUNDED,
        quadratic=BOUNDED,
        source="Quinlan & Tremaine 1990; started by Gauss, 8 stages",
        cite=("quinlan-tremaine1990", "quinlan1999", "butcher1964"),
        requires=("canonical", "separable", "quadratic kinetic energy", "constant mass matrix"),
        earlier=order - 1,
        data=tuple(table),
    )


METHODS: tuple[Method, ...] = tuple(map(symmetric_multistep, QUINLAN_TREMAINE))
