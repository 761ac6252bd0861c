"""Records of Euler's methods, the midpoint rule, Stormer-Verlet and the classical Runge-Kutta method."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from phasebench.integrators.record import BOUNDED, DRIFT, ROUND_OFF, Method

HALF = Fraction(1, 2)
HLW = "Hairer, Lubich & Wanner 2006"


def one_stage(*, id: str, name: str, substeps: tuple[tuple[Any, Any, Any], ...], source: str, **facts: Any) -> Method:
    """Make the record of a method of one-stage substeps (c, mu, lambda); ``facts`` are further fields of the record.

    A substep has the length c h and evaluates the field at (q + mu (Q - q), p + lambda (P - p)), where (q, p) is the
    state before the substep and (Q, P) the state after it.
    """
    facts = {"order": 1, "symmetric": False, "symplectic": True, "energy": BOUNDED, "quadratic": ROUND_OFF} | facts
    return Method(id=id, name=name, family="parametric", data=(1, substeps), source=source, **facts)


_RK4 = ((0, 0, 0, 0), (HALF, 0, 0, 0), (0, HALF, 0, 0), (0, 0, 1, 0)) + (
    (Fraction(1, 6), Fraction(1, 3), Fraction(1, 3), Fraction(1, 6)),
)

METHODS: tuple[Method, ...] = (
    Method(
        id="explicit-euler",
        name="explicit Euler",
        family="runge_kutta",
        order=1,
        symmetric=False,
        symplectic=False,
        energy=DRIFT,
        quadratic=DRIFT,
        source="Euler 1768",
        data=((0,), (1,)),
        cite=("euler1768",),
    ),
    one_stage(
        id="implicit-euler",
        name="implicit Euler",
        substeps=((1, 1, 1),),
        source=f"{HLW}, I.1.2",
        symplectic=False,
        energy=DRIFT,
        quadratic=DRIFT,
        cite=("hairer2006",),
    ),
    one_stage(
        id="symplectic-euler-p",
        name="symplectic Euler, implicit in p",
        substeps=((1, 0, 1),),
        source=f"de Vogelaere 1956; {HLW}, I.1.9",
        cite=("devogelaere1956", "hairer2006"),
    ),
    one_stage(
        id="symplectic-euler-q",
        name="symplectic Euler, implicit in q",
        substeps=((1, 1, 0),),
        source=f"de Vogelaere 1956; {HLW}, I.1.9",
        cite=("devogelaere1956", "hairer2006"),
    ),
    one_stage(
        id="implicit-midpoint",
        name="implicit midpoint rule",
        substeps=((1, HALF, HALF),),
        source=f"{HLW}, VI.3.4",
        order=2,
        symmetric=True,
        cite=("hairer2006",),
    ),
    one_stage(
        id="stormer-verlet",
        name="Stormer-Verlet, kick-drift-kick",
        substeps=((HALF, 0, 1), (HALF, 1, 0)),
        source=f"Verlet 1967; {HLW}, I.1.17",
        order=2,
        symmetric=True,
        cite=("verlet1967", "hairer2006"),
    ),
    one_stage(
        id="stormer-verlet-dkd",
        name="Stormer-Verlet, drift-kick-drift",
        substeps=((HALF, 1, 0), (HALF, 0, 1)),
        source=f"Verlet 1967; {HLW}, I.1.17",
        order=2,
        symmetric=True,
        cite=("verlet1967", "hairer2006"),
    ),
    Method(
        id="rk4",
        name="the classical Runge-Kutta method",
        family="runge_kutta",
        order=4,
        symmetric=False,
        symplectic=False,
        energy=DRIFT,
        quadratic=DRIFT,
        source="Kutta 1901",
        cite=("kutta1901",),
        data=_RK4,
    ),
)
