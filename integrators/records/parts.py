"""Records of splitting methods for an H that is a sum of any number of parts with exact flows."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction

import mpmath

from phasebench.integrators import coefficients
from phasebench.integrators.coefficients.fractions import DIGITS, substeps
from phasebench.integrators.record import BOUNDED, ROUND_OFF, Method

from .processed import parts_of

HALF = Fraction(1, 2)
STRANG = ((HALF, 0, 1), (HALF, 1, 0))
MCLACHLAN = "with parts as McLachlan 1995"


def strang(fractions: Iterable[mpmath.mpf]) -> tuple[tuple, ...]:
    """The substeps of Strang's steps, composed over these fractions of h: rows (c, mu, lambda), two for each fraction.

    A substep has the length c h; it goes through all parts in order, (mu, lambda) = (0, 1), or backwards, (1, 0).
    """
    with mpmath.workdps(DIGITS):
        return tuple((f / 2, *half[1:]) for f in fractions for half in STRANG)


def parts(
    id: str, name: str, order: int, source: str, cite: tuple[str, ...], data: tuple, *, symmetric: bool = True
) -> Method:
    """Make the record of a method whose substeps go through the flows of all parts of H, in order or backwards.

    ``data`` is a pair: the substeps of a step, rows (c, mu, lambda) as from `strang`; and the substeps of the
    processor, the map that a processed method applies before its steps and undoes after them, or () for other methods.
    The other arguments are fields of the record.
    """
    return Method(
        id=id,
        name=name,
        family="parts",
        order=order,
        symmetric=symmetric,
        symplectic=True,
        energy=BOUNDED,
        quadratic=ROUND_OFF,
        source=source,
        cite=cite,
        requires=("parts",),
        data=data,
    )


def composed(id: str, order: int, table: str) -> Method:
    """Make the record of a composition of the first-order step through all parts of H with its adjoint.

    Its coefficients are those of the splitting of two parts whose table in `coefficients` has the name ``table``; the
    order conditions are the same.
    """
    found = coefficients.table(table)
    return parts(
        id,
        f"splitting through all parts, with the weights of {table}",
        order,
        f"{found.source}; {MCLACHLAN}",
        (*found.cite, "mclachlan1995"),
        (substeps(coefficients.steps(table)), ()),
    )


def processed_parts(id: str, table: str) -> Method:
    """Make the record of a processed composition P K^n P^-1 of Strang's step through all parts of H.

    ``table`` is the name of a table of `coefficients`, which has the coefficients of kernel K and processor P.
    """
    found = coefficients.table(table)
    kernel, pre = parts_of(found)
    return parts(
        id,
        f"processed splitting through all parts, with the weights of {table}",
        found.classical_order,
        f"{found.source}; {MCLACHLAN}",
        (*found.cite, "mclachlan1995"),
        (strang(kernel), strang(pre)),
        symmetric=False,
    )


METHODS: tuple[Method, ...] = (
    parts(
        "abc-2",
        "Strang splitting through all parts",
        2,
        "Strang 1968; Wang, Sun, Liu & Wu 2021",
        ("strang1968", "wang2021"),
        (STRANG, ()),
    ),
    parts(
        "abc-yoshida-4",
        "splitting through all parts, three Strang steps by the triple jump",
        4,
        "Yoshida 1990; Wang, Sun, Liu & Wu 2021",
        ("yoshida1990", "wang2021"),
        (strang(coefficients.steps("forest-ruth")), ()),
    ),
    composed("abc-4", 4, "blanes-moan-s6"),
    composed("abc-6", 6, "blanes-moan-s10"),
    processed_parts("abc-processed-6", "blanes-casas-murua-p11-6"),
)
