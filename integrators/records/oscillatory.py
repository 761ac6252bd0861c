"""Records of trigonometric integrators and of multiple time stepping (family `trigonometric`).

A trigonometric integrator is given by two filters, functions of h omega: psi_1 = psi / sinc multiplies a kick, and phi
the q at which the kick's force is evaluated; each record names the published psi and phi.
A quadratic invariant q.D p is conserved to round-off if it belongs to a rotation among components of equal frequency,
else only up to a bounded error; a record's field ``quadratic`` states the weaker of the two, "bounded".
"""

from __future__ import annotations

from typing import Any

from phasebench.integrators.coefficients import filters
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import BOUNDED, SYMPLECTIC, Method

HLW = "Hairer, Lubich & Wanner 2006, XIII"
#: The most substeps of a step of multiple time stepping.
LARGEST = 10_000


def oscillatory_method(*, filters: tuple[Any, ...], symplectic: bool = False, **facts: Any) -> Method:
    """Make the record of a symmetric method of order 2 for systems with a fast linear part.

    ``filters`` are three functions of h omega, from `coefficients.filters`: the propagator of the linear part, the
    filter psi_1 that multiplies a kick, and the filter phi of the q at which its force is evaluated; after these come
    further arguments of the propagator, if it has any.  ``facts`` are further fields of the record.
    """
    common = SYMPLECTIC | {"symplectic": symplectic, "quadratic": BOUNDED}
    return Method(family="trigonometric", order=2, requires=("linear fast part",), data=filters, **common, **facts)


def _respa(substeps: int) -> dict[str, Any]:
    if not 1 <= substeps <= LARGEST:
        raise InvalidInput(f"substeps is {substeps}; it must be at least 1 and at most {LARGEST}")
    return {"data": (filters.verlet_power, filters.one, filters.one, substeps)}


METHODS: tuple[Method, ...] = (
    oscillatory_method(
        id="gautschi",
        name="Gautschi's method, psi = sinc^2(xi/2), phi = 1",
        source=f"Gautschi 1961; {HLW}.2 (A)",
        cite=("gautschi1961", "hairer2006"),
        filters=(filters.rotation, filters.tanc_half, filters.one),
    ),
    oscillatory_method(
        id="deuflhard",
        name="Deuflhard's method, psi = sinc(xi), phi = 1: the impulse method with the exact fast flow",
        source=f"Deuflhard 1979; {HLW}.2 (B)",
        cite=("deuflhard1979", "hairer2006"),
        filters=(filters.rotation, filters.one, filters.one),
        symplectic=True,
    ),
    oscillatory_method(
        id="mollified-impulse",
        name="the mollified impulse method, psi = sinc(xi) phi, phi = sinc(xi)",
        source=f"Garcia-Archilla, Sanz-Serna & Skeel 1999; {HLW}.2 (C)",
        cite=("garcia-archilla1999", "hairer2006"),
        filters=(filters.rotation, filters.sinc, filters.sinc),
        symplectic=True,
    ),
    oscillatory_method(
        id="hochbruck-lubich",
        name="the method of Hochbruck and Lubich, psi = sinc^2(xi/2), phi = sinc(xi) (1 + sin^2(xi/2) / 3)",
        source=f"Hochbruck & Lubich 1999; {HLW}.2 (D)",
        cite=("hochbruck1999", "hairer2006"),
        filters=(filters.rotation, filters.tanc_half, filters.hochbruck_lubich),
    ),
    oscillatory_method(
        id="hairer-lubich",
        name="the method of Hairer and Lubich, psi = sinc^2(xi), phi = 1",
        source=f"Hairer & Lubich 2000; {HLW}.2 (E)",
        cite=("hairer2000", "hairer2006"),
        filters=(filters.rotation, filters.sinc, filters.one),
    ),
    oscillatory_method(
        id="grimm-hochbruck",
        name="the method of Grimm and Hochbruck, psi = sinc^3(xi), phi = sinc(xi)",
        source="Grimm & Hochbruck 2006",
        cite=("grimm2006",),
        filters=(filters.rotation, filters.sinc_squared, filters.sinc),
    ),
    oscillatory_method(
        id="r-respa",
        name="r-RESPA, the impulse method with Stormer-Verlet substeps",
        source="Tuckerman, Berne & Martyna 1992; Grubmueller, Heller, Windemuth & Schulten 1991",
        cite=("tuckerman1992", "grubmueller1991"),
        symplectic=True,
        parameters={"substeps": 10},
        with_parameters=_respa,
        filters=_respa(10)["data"],
    ),
    oscillatory_method(
        id="imex",
        name="the implicit-explicit method: the impulse method with the implicit midpoint rule",
        source="Zhang & Skeel 1997; Stern & Grinspun 2009",
        cite=("zhang1997", "stern2009"),
        filters=(filters.cayley, filters.one, filters.one),
        symplectic=True,
    ),
)
