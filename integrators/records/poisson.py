"""Records of energy-preserving methods for Poisson systems y' = B(y) grad H(y)."""

from __future__ import annotations

from phasebench.integrators.record import CONSERVING, Method

METHODS: tuple[Method, ...] = tuple(
    Method(
        id=f"cohen-hairer-{s}",
        name=f"energy-preserving collocation for Poisson systems, s = {s}",
        family="poisson",
        order=2 * s,
        source="Cohen & Hairer 2011, section 2",
        cite=("cohen2011", "hairer2010") if s > 1 else ("cohen2011",),
        requires=("Poisson structure",),
        data=(s,),
        **CONSERVING,
    )
    for s in (1, 2, 3)
)
