"""Euler's methods, the midpoint rule, Stormer-Verlet, the classical Runge-Kutta method."""

from __future__ import annotations

from fractions import Fraction

from phasebench.integrators.record import BOUNDED, DRIFT, ROUND_OFF, Method

HALF = Fraction(1, 2)
HLW = "Hairer, Lubich & Wanner 2006"


def one_stage(id, name, substeps, source, **facts):
    """A method of substeps (c, mu, lambda) of the family `parametric`."""
    facts = {"order": 1, "symmetric": False, "symplectic": True, "energy": BOUNDED, "quadratic": ROUND_OFF} | facts
    return Method(id=id, name=name, family="parametric", data=(1, substeps), source=source, **facts)


_RK4 = ((0, 0, 0, 0), (HALF, 0, 0, 0), (0, HALF, 0, 0), (0, 0, 1, 0)) + (
    (Fraction(1, 6), Fraction(1, 3), Fraction(1, 3), Fraction(1, 6)),
)

METHODS: tuple[Method, ...] = (
    Method(
        "explicit-euler",
        "explicit Euler",
        "runge_kutta",
        1,
        False,
        False,
        DRIFT,
        DRIFT,
        "Euler 1768",
        data=((0,), (1,)),
        cite=("euler1768",),
    ),
    one_stage(
        "implicit-euler",
        "implicit Euler",
        ((1, 1, 1),),
        f"{HLW}, I.1.2",
        symplectic=False,
        energy=DRIFT,
        quadratic=DRIFT,
        cite=("hairer2006",),
    ),
    one_stage(
        "symplectic-euler-p",
        "symplectic Euler, implicit in p",
        ((1, 0, 1),),
        f"de Vogelaere 1956; {HLW}, I.1.9",
        cite=("devogelaere1956", "hairer2006"),
    ),
    one_stage(
        "symplectic-euler-q",
        "symplectic Euler, implicit in q",
        ((1, 1, 0),),
        f"de Vogelaere 1956; {HLW}, I.1.9",
        cite=("devogelaere1956", "hairer2006"),
    ),
    one_stage(
        "implicit-midpoint",
        "implicit midpoint rule",
        ((1, HALF, HALF),),
        f"{HLW}, VI.3.4",
        order=2,
        symmetric=True,
        cite=("hairer2006",),
    ),
    one_stage(
        "stormer-verlet",
        "Stormer-Verlet, kick-drift-kick",
        ((HALF, 0, 1), (HALF, 1, 0)),
        f"Verlet 1967; {HLW}, I.1.17",
        order=2,
        symmetric=True,
        cite=("verlet1967", "hairer2006"),
    ),
    one_stage(
        "stormer-verlet-dkd",
        "Stormer-Verlet, drift-kick-drift",
        ((HALF, 1, 0), (HALF, 0, 1)),
        f"Verlet 1967; {HLW}, I.1.17",
        order=2,
        symmetric=True,
        cite=("verlet1967", "hairer2006"),
    ),
    Method(
        "rk4",
        "the classical Runge-Kutta method",
        "runge_kutta",
        4,
        False,
        False,
        DRIFT,
        DRIFT,
        "Kutta 1901",
        ("kutta1901",),
        data=_RK4,
    ),
)
