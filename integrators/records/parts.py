"""Records of splitting methods for an H that is a sum of any number of parts with exact flows.

The data are a pair: the substeps of a step, rows (c, mu, lambda) as from `strang`; and the substeps of the processor,
the map that a processed method applies before its steps and undoes after them, or () for other methods.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import Any

from phasebench.integrators import coefficients
from phasebench.integrators.coefficients.fractions import DIGITS, substeps
from phasebench.integrators.compile.lazy import mpmath
from phasebench.integrators.record import SYMPLECTIC, Method

from .processed import parts_of

HALF = Fraction(1, 2)
STRANG = ((HALF, 0, 1), (HALF, 1, 0))


def strang(fractions: Iterable[mpmath.mpf]) -> tuple[tuple, ...]:
    """The substeps of Strang's steps, composed over these fractions of h: rows (c, mu, lambda), two for each fraction.

    A substep has the length c h; it goes through all parts in order, (mu, lambda) = (0, 1), or backwards, (1, 0).
    """
    with mpmath.workdps(DIGITS):
        return tuple((f / 2, *half[1:]) for f in fractions for half in STRANG)


def parts(id: str, name: str, order: int, source: str, cite: tuple[str, ...], data: Any, **facts: Any) -> Method:
    """Make the record of a method whose substeps go through the flows of all parts of H, in order or backwards."""
    fields = SYMPLECTIC | {"id": id, "name": name, "order": order, "source": source, "cite": cite, "data": data}
    return Method(family="parts", requires=("parts",), **(fields | facts))


def with_weights(id: str, what: str, table: str, data: Callable[[], tuple], **facts: Any) -> Method:
    """Make the record of a method that is made of the numbers of a table of `coefficients`, for two parts of H.

    The order conditions are the same for more parts, of which a step is the composition of a first-order step through
    all of them with its adjoint.
    """
    found = coefficients.table(table)
    return parts(
        id,
        f"{what} through all parts, with the weights of {table}",
        found.classical_order,
        f"{found.source}; with parts as McLachlan 1995",
        (*found.cite, "mclachlan1995"),
        data,
        **facts,
    )


PROCESSED = "blanes-casas-murua-p11-6"

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
        lambda: (strang(coefficients.steps("forest-ruth")), ()),
    ),
    *(
        with_weights(id, "splitting", table, lambda table=table: (substeps(coefficients.steps(table)), ()))
        for id, table in (("abc-4", "blanes-moan-s6"), ("abc-6", "blanes-moan-s10"))
    ),
    with_weights(
        "abc-processed-6",
        "processed splitting",
        PROCESSED,
        lambda: tuple(map(strang, parts_of(coefficients.table(PROCESSED)))),
        symmetric=False,
    ),
)
