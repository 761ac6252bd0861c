"""Records of energy-preserving methods: averaged vector fields and discrete gradients."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

from phasebench.integrators.coefficients.fractions import suzuki, times, triple_jump
from phasebench.integrators.compile.lazy import mpmath
from phasebench.integrators.record import CONSERVING, NONE, Method

HALF = Fraction(1, 2)
#: The first words of names and the works of the averaged and the partitioned averaged vector field, and Itoh and Abe's.
AVF = ("averaged vector field", "Quispel & McLaren 2008", "quispel2008")
PAVF = ("partitioned averaged vector field", "Cai, Li & Wang 2018", "cai2018")
ITOH_ABE = ("Itoh-Abe discrete gradient", "Itoh & Abe 1988, section 3", "itoh1988")
GONZALEZ = ("Gonzalez' discrete gradient", "Gonzalez 1996", "gonzalez1996")
#: Paths, the order in which the variables change: all at once, momenta and then coordinates, one after the other.
WHOLE, PARTITIONED, COMPONENTS = "whole", "momenta, coordinates", "components"
#: The path, its reverse, the mean of both.
FORTH, BACK, MEAN = 1, -1, 0


def conserving_method(
    id: str,
    field: tuple[str, str, str],
    what: str,
    data: Callable[[], tuple[Any, ...]] | tuple[Any, ...],
    **facts: Any,
) -> Method:
    """Make the record of a method that conserves H on every canonical system, by default symmetric and of order 2.

    ``field`` has the first words of its name, the source and its key; ``what`` are further words.  ``data`` are
    substeps (fraction of h, path, direction) of averaged fields, or fractions of h for Gonzalez' gradient.
    """
    name, source, cite = field
    family = "discrete_gradient" if field is GONZALEZ else "averaged"
    common = CONSERVING | {"order": 2, "requires": ("canonical",), "name": name + what, "source": source}
    return Method(id=id, family=family, data=data, **(common | {"cite": (cite,)} | facts))


def composed(
    id: str, field: tuple[str, str, str], scheme: str, data: Callable[[Callable[..., tuple]], tuple[Any, ...]]
) -> Method:
    """Make the record of a composition of order 4; ``data`` maps the fractions of the steps to the record's data."""
    fractions = {"yoshida": triple_jump, "suzuki": suzuki}[scheme]
    return conserving_method(
        id,
        field,
        f", {scheme.capitalize()} composition of order 4",
        lambda: data(fractions(4)),
        order=4,
        source=f"{field[1]}; {scheme.capitalize()} 1990",
        cite=(field[2], f"{scheme}1990"),
    )


def with_adjoint(path: str, fractions: tuple[Fraction | mpmath.mpf, ...] = (Fraction(1),)) -> tuple[tuple, ...]:
    """Substeps that compose the first-order map along a path, over f/2, with its adjoint, for all fractions f of h."""
    return tuple((times(f, HALF), path, direction) for f in fractions for direction in (FORTH, BACK))


METHODS: tuple[Method, ...] = (
    conserving_method("avf", AVF, "", ((1, WHOLE, FORTH),)),
    *(
        composed(f"avf-{scheme}-4", AVF, scheme, lambda fractions: tuple((f, WHOLE, FORTH) for f in fractions))
        for scheme in ("yoshida", "suzuki")
    ),
    conserving_method("pavf", PAVF, ", momenta first", ((1, PARTITIONED, FORTH),), order=1, symmetric=False),
    conserving_method("pavf-adjoint", PAVF, ", coordinates first", ((1, PARTITIONED, BACK),), order=1, symmetric=False),
    conserving_method("pavf-c", PAVF, ", composition with its adjoint", with_adjoint(PARTITIONED)),
    conserving_method("pavf-p", PAVF, ", mean with its adjoint", ((1, PARTITIONED, MEAN),)),
    composed("pavf-c-yoshida-4", PAVF, "yoshida", lambda fractions: with_adjoint(PARTITIONED, fractions)),
    # It promises nothing of quadratic invariants; on perturbed Kepler L oscillates without a drift.
    conserving_method("itoh-abe", ITOH_ABE, "", ((1, COMPONENTS, FORTH),), order=1, symmetric=False, quadratic=NONE),
    conserving_method("itoh-abe-symmetrized", ITOH_ABE, ", mean with the reverse path", ((1, COMPONENTS, MEAN),)),
    conserving_method("itoh-abe-c", ITOH_ABE, ", composition with its adjoint", with_adjoint(COMPONENTS)),
    conserving_method("gonzalez", GONZALEZ, "", (1,), name="Gonzalez' midpoint discrete gradient"),
    composed("gonzalez-yoshida-4", GONZALEZ, "yoshida", lambda fractions: fractions),
)
