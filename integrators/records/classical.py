"""Records of Euler's methods, the midpoint rule, Stormer-Verlet and the classical Runge-Kutta methods."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from phasebench.integrators.record import DRIFT, DRIFTING, SYMPLECTIC, Method

HALF = Fraction(1, 2)
HLW = "Hairer, Lubich & Wanner 2006"


def one_stage(substeps: tuple[tuple[Any, Any, Any], ...], *, order: int = 2, **facts: Any) -> Method:
    """Make the record of a method of one-stage substeps (c, mu, lambda), symplectic, and symmetric if of order 2.

    A substep has the length c h and evaluates the field at (q + mu (Q - q), p + lambda (P - p)), where (q, p) is the
    state before the substep and (Q, P) the state after it.  ``facts`` are further fields of the record.
    """
    common = SYMPLECTIC | {"order": order, "symmetric": order > 1, "cite": ("hairer2006",)}
    return Method(family="parametric", **(common | {"data": (1, substeps)} | facts))


METHODS: tuple[Method, ...] = (
    Method(
        id="explicit-euler",
        name="explicit Euler",
        family="runge_kutta",
        order=1,
        source="Euler 1768",
        data=((0,), (1,)),
        cite=("euler1768",),
        **DRIFTING,
    ),
    one_stage(
        ((1, 1, 1),),
        id="implicit-euler",
        name="implicit Euler",
        source=f"{HLW}, I.1.2",
        order=1,
        symplectic=False,
        energy=DRIFT,
        quadratic=DRIFT,
    ),
    *(
        one_stage(
            (substep,),
            id=f"symplectic-euler-{x}",
            name=f"symplectic Euler, implicit in {x}",
            source=f"de Vogelaere 1956; {HLW}, I.1.9",
            order=1,
            cite=("devogelaere1956", "hairer2006"),
        )
        for x, substep in (("p", (1, 0, 1)), ("q", (1, 1, 0)))
    ),
    one_stage(((1, HALF, HALF),), id="implicit-midpoint", name="implicit midpoint rule", source=f"{HLW}, VI.3.4"),
    *(
        one_stage(
            substeps,
            id=id,
            name=f"Stormer-Verlet, {what}",
            source=f"Verlet 1967; {HLW}, I.1.17",
            cite=("verlet1967", "hairer2006"),
        )
        for id, what, substeps in (
            ("stormer-verlet", "kick-drift-kick", ((HALF, 0, 1), (HALF, 1, 0))),
            ("stormer-verlet-dkd", "drift-kick-drift", ((HALF, 1, 0), (HALF, 0, 1))),
        )
    ),
    Method(
        id="rk4",
        name="the classical Runge-Kutta method",
        family="runge_kutta",
        order=4,
        source="Kutta 1901",
        cite=("kutta1901",),
        data=(
            *((0, 0, 0, 0), (HALF, 0, 0, 0), (0, HALF, 0, 0), (0, 0, 1, 0)),
            (Fraction(1, 6), Fraction(1, 3), Fraction(1, 3), Fraction(1, 6)),
        ),
        **DRIFTING,
    ),
)
BY_ID = {m.id: m for m in METHODS}
