"""Records of implicit Runge-Kutta methods and of their energy-preserving relatives (HBVM, Petrov-Galerkin, EQUIP)."""

from __future__ import annotations

from typing import Any

from phasebench.integrators.coefficients import dop853
from phasebench.integrators.record import CONSERVING, DRIFTING, ROUND_OFF, SYMPLECTIC, Method

HLW = "Hairer, Lubich & Wanner 2006"
BIT = "Brugnano, Iavernaro & Trigiante"
CANONICAL = {"requires": ("canonical",)}


def collocation(*, data: tuple[str | int, ...], family: str = "collocation", **facts: Any) -> Method:
    """Make the record of an implicit multi-stage method.

    ``data`` are the kind of the method, such as "gauss" or "radau-iia", and its number s of stages; for "hbvm" also the
    number of nodes.  The other arguments are fields of the record.
    """
    return Method(family=family, data=data, **facts)


def gauss(s: int) -> Method:
    """Make the record of the Gauss method of s stages."""
    return collocation(
        id=f"gauss-{s}",
        name=f"Gauss, {s} stages",
        order=2 * s,
        source=f"Butcher 1964; Sanz-Serna 1988; {HLW}, II.1.3; rounding: Hairer, McLachlan & Razakarivony 2008",
        cite=("butcher1964", "sanzserna1988", "hairer2006", "hairer2008"),
        data=("gauss", s),
        **SYMPLECTIC,
    )


def hbvm(k: int, s: int) -> Method:
    """Make the record of the Hamiltonian boundary value method with k nodes and polynomials of degree s."""
    return collocation(
        id=f"hbvm-{k}-{s}",
        name=f"HBVM({k}, {s}), which keeps polynomials H of degree up to {2 * k // s}",
        order=2 * s,
        source=f"{BIT} 2010",
        cite=("brugnano2010",),
        data=("hbvm", s, k),
        **CONSERVING,
        **CANONICAL,
    )


def petrov_galerkin(s: int) -> Method:
    """Make the record of the continuous Petrov-Galerkin method of degree s."""
    return collocation(
        id=f"cpg-{s}",
        name=f"continuous Petrov-Galerkin of degree {s}",
        order=2 * s,
        source=f"Betsch & Steinmann 2000; Hairer 2010; the limit of HBVM(k, {s})",
        cite=("betsch2000", "hairer2010", "brugnano2010"),
        data=("cpg", s),
        **CONSERVING,
        **CANONICAL,
    )


def lobatto(s: int) -> Method:
    """Make the record of the Lobatto IIIA-IIIB pair of s stages."""
    return collocation(
        id=f"lobatto-iiia-iiib-{s}",
        name=f"Lobatto IIIA - IIIB, {s} stages",
        order=2 * s - 2,
        source=f"Sun 1993; {HLW}, II.2.2 and VI.4.5",
        cite=("sun1993", "hairer2006"),
        data=("lobatto-iiia-iiib", s),
        **SYMPLECTIC,
    )


def radau(s: int) -> Method:
    """Make the record of the Radau IIA method of s stages, a dissipative method for comparison."""
    return collocation(
        id=f"radau-iia-{s}",
        name=f"Radau IIA, {s} stages",
        order=2 * s - 1,
        source="Ehle 1969; Hairer & Wanner 1996, IV.5",
        cite=("ehle1969", "hairer1996"),
        data=("radau-iia", s),
        **DRIFTING,
    )


def equip(s: int) -> Method:
    """Make the record of EQUIP: the Gauss method of s stages with a parameter, chosen in each step to keep H."""
    return collocation(
        id=f"gauss-equip-{s}",
        name=f"EQUIP: Gauss, {s} stages, with the parameter that keeps the energy",
        family="equip",
        order=2 * s,
        source=f"{BIT} 2012",
        cite=("brugnano2012",),
        data=(s,),
        **(CONSERVING | CANONICAL | {"quadratic": ROUND_OFF}),
    )


DOP853 = Method(
    id="dop853",
    name="the method of order 8 of Dormand and Prince, with a fixed step",
    family="runge_kutta",
    order=8,
    source="Hairer, Norsett & Wanner 1993, II.5 (DOP853)",
    cite=("hairer1993",),
    data=dop853.tableau,
    **DRIFTING,
)

METHODS: tuple[Method, ...] = (
    *(gauss(s) for s in range(1, 9)),
    *(lobatto(s) for s in (2, 3, 4)),
    *(radau(s) for s in (2, 3)),
    *(hbvm(2 * s, s) for s in (1, 2, 3, 4)),
    *(petrov_galerkin(s) for s in (1, 2, 3, 4)),
    *(equip(s) for s in (2, 3, 4)),
    DOP853,
)
