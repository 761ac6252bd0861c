"""Records of energy-preserving methods: averaged vector fields and discrete gradients."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from phasebench.integrators.coefficients.fractions import suzuki, times, triple_jump
from phasebench.integrators.record import BOUNDED, NONE, ROUND_OFF, Method

if TYPE_CHECKING:
    import mpmath

HALF = Fraction(1, 2)
GONZALEZ = "Gonzalez 1996"
AVF, PAVF, ITOH_ABE = "Quispel & McLaren 2008", "Cai, Li & Wang 2018", "Itoh & Abe 1988, section 3"
WHOLE, PARTITIONED, COMPONENTS = "whole", "momenta, coordinates", "components"
#: The path, its reverse, the mean of both.
FORTH, BACK, MEAN = 1, -1, 0


def conserving_method(
    *, id: str, name: str, source: str, cite: tuple[str, ...], data: Iterable[Any], **facts: Any
) -> Method:
    """Make the record of a method that conserves H on every canonical system.

    The arguments are fields of the record; by default the method has order 2, is symmetric, and keeps quadratic
    invariants up to a bounded error.
    """
    facts = {"order": 2, "symmetric": True, "quadratic": BOUNDED} | facts
    common = {"symplectic": False, "energy": ROUND_OFF, "requires": ("canonical",)}
    return Method(id=id, name=name, source=source, cite=cite, data=tuple(data), **common, **facts)


def averaged_method(**facts: Any) -> Method:
    """Make the record of an averaged vector field method from fields of the record.

    ``data`` are substeps (fraction of h, path, direction).  The path is the order in which the variables change:
    `WHOLE` (all at once), `PARTITIONED` (momenta, then coordinates) or `COMPONENTS` (one after the other); the
    direction is `FORTH` (in this order), `BACK` (in the reverse order) or `MEAN` (the mean of both).
    """
    return conserving_method(family="averaged", **facts)


def gonzalez(**facts: Any) -> Method:
    """Make the record of a composition of Gonzalez' discrete gradient method; ``data`` are fractions of the step."""
    return conserving_method(family="discrete_gradient", **facts)


def compose_with_adjoint(
    path: str, fractions: Iterable[Fraction | mpmath.mpf] = (Fraction(1),)
) -> list[tuple[Fraction | mpmath.mpf, str, int]]:
    """The substeps (length, path, direction) of a composition of a first-order map with its adjoint.

    For each of the ``fractions`` f of the step there are two, the map over f/2 and its adjoint over f/2.  ``path`` is
    the order in which the map changes the variables, and the direction `FORTH` for the map and `BACK` for its adjoint,
    as in `averaged_method`.
    """
    return [(times(f, HALF), path, direction) for f in fractions for direction in (FORTH, BACK)]


METHODS: tuple[Method, ...] = (
    averaged_method(
        id="avf", name="averaged vector field", source=AVF, cite=("quispel2008",), data=[(1, WHOLE, FORTH)]
    ),
    averaged_method(
        id="avf-yoshida-4",
        name="averaged vector field, Yoshida composition of order 4",
        source=f"{AVF}; Yoshida 1990",
        cite=("quispel2008", "yoshida1990"),
        data=[(f, WHOLE, FORTH) for f in triple_jump(4)],
        order=4,
    ),
    averaged_method(
        id="avf-suzuki-4",
        name="averaged vector field, Suzuki composition of order 4",
        source=f"{AVF}; Suzuki 1990",
        cite=("quispel2008", "suzuki1990"),
        data=[(f, WHOLE, FORTH) for f in suzuki(4)],
        order=4,
    ),
    averaged_method(
        id="pavf",
        name="partitioned averaged vector field, momenta first",
        source=PAVF,
        cite=("cai2018",),
        data=[(1, PARTITIONED, FORTH)],
        order=1,
        symmetric=False,
    ),
    averaged_method(
        id="pavf-adjoint",
        name="partitioned averaged vector field, coordinates first",
        source=PAVF,
        cite=("cai2018",),
        data=[(1, PARTITIONED, BACK)],
        order=1,
        symmetric=False,
    ),
    averaged_method(
        id="pavf-c",
        name="partitioned averaged vector field, composition with its adjoint",
        source=PAVF,
        cite=("cai2018",),
        data=compose_with_adjoint(PARTITIONED),
    ),
    averaged_method(
        id="pavf-p",
        name="partitioned averaged vector field, mean with its adjoint",
        source=PAVF,
        cite=("cai2018",),
        data=[(1, PARTITIONED, MEAN)],
    ),
    averaged_method(
        id="pavf-c-yoshida-4",
        name="partitioned averaged vector field, Yoshida composition of order 4",
        source=f"{PAVF}; Yoshida 1990",
        cite=("cai2018", "yoshida1990"),
        data=compose_with_adjoint(PARTITIONED, triple_jump(4)),
        order=4,
    ),
    averaged_method(
        id="itoh-abe",
        name="Itoh-Abe discrete gradient",
        source=ITOH_ABE,
        cite=("itoh1988",),
        data=[(1, COMPONENTS, FORTH)],
        order=1,
        symmetric=False,
        quadratic=NONE,  # it promises none; on perturbed Kepler L oscillates without a drift
    ),
    averaged_method(
        id="itoh-abe-symmetrized",
        name="Itoh-Abe discrete gradient, mean with the reverse path",
        source=ITOH_ABE,
        cite=("itoh1988",),
        data=[(1, COMPONENTS, MEAN)],
    ),
    averaged_method(
        id="itoh-abe-c",
        name="Itoh-Abe discrete gradient, composition with its adjoint",
        source=ITOH_ABE,
        cite=("itoh1988",),
        data=compose_with_adjoint(COMPONENTS),
    ),
    gonzalez(
        id="gonzalez", name="Gonzalez' midpoint discrete gradient", source=GONZALEZ, cite=("gonzalez1996",), data=(1,)
    ),
    gonzalez(
        id="gonzalez-yoshida-4",
        name="Gonzalez' discrete gradient, Yoshida composition of order 4",
        source=f"{GONZALEZ}; Yoshida 1990",
        cite=("gonzalez1996", "yoshida1990"),
        data=triple_jump(4),
        order=4,
    ),
)
