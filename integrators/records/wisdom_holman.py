"""Records of Wisdom-Holman splittings for planetary systems."""

from __future__ import annotations

from typing import Any

import mpmath

from phasebench.integrators import coefficients
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import BOUNDED, ROUND_OFF, Method

HALF = mpmath.mpf(1) / 2
#: The correctors that are published (Wisdom 2006, table 1).
CORRECTORS = (3, 5, 7, 11, 17)
WISDOM_HOLMAN = (HALF, HALF), (mpmath.mpf(1),)


def splitting(name: str) -> tuple[tuple, tuple]:
    """The weights (drifts, kicks) of the table ``name`` of `coefficients`, which must begin and end with a drift."""
    steps = coefficients.steps(name)
    drifts, kicks = steps[::2], steps[1::2]
    if {letter for letter, _ in drifts} != {"A"} or {letter for letter, _ in kicks} != {"B"}:
        raise ValueError(f"the table {name} does not alternate from a drift to a drift")
    return tuple(x for _, x in drifts), tuple(x for _, x in kicks)


def _record(*, id: str, name: str, source: str, cite: tuple[str, ...], data: tuple[Any, ...], **facts: Any) -> Method:
    facts = {"order": 2, "symmetric": True} | facts
    return Method(
        id=id,
        name=name,
        family="wisdom_holman",
        symplectic=True,
        energy=BOUNDED,
        quadratic=ROUND_OFF,
        source=source,
        cite=cite,
        requires=("canonical", "separable", "quadratic kinetic energy", "Kepler part"),
        data=data,
        **facts,
    )


def _corrector_facts(corrector: int) -> dict[str, Any]:
    if corrector not in CORRECTORS:
        raise InvalidInput(f"correctors are of the orders {', '.join(map(str, CORRECTORS))}, not {corrector}")
    return {"data": (*WISDOM_HOLMAN, corrector)}


def _near_integrable_method(table: str, order: int, name: str, source: str, cite: tuple[str, ...]) -> Method:
    return _record(
        id=f"wisdom-holman-{name}",
        name=f"{table.upper()} with Kepler drifts",
        source=source,
        cite=cite,
        data=(*splitting(table), 1),
        order=order,
    )


METHODS: tuple[Method, ...] = (
    _record(
        id="wisdom-holman",
        name="Wisdom-Holman, drift-kick-drift",
        source="Wisdom & Holman 1991; Rein & Tamayo 2015",
        cite=("wisdom-holman1991", "rein-tamayo2015"),
        data=(*WISDOM_HOLMAN, 1),
    ),
    _record(
        id="wisdom-holman-corrector",
        name="Wisdom-Holman with a symplectic corrector",
        source="Wisdom, Holman & Touma 1996; Wisdom 2006",
        cite=("wisdom-holman-touma1996", "wisdom2006"),
        symmetric=False,
        parameters={"corrector": 17},
        with_parameters=_corrector_facts,
        **_corrector_facts(17),
    ),
    _near_integrable_method(
        table="saba-2", order=2, name="saba-2", source="Laskar & Robutel 2001, SABA_2", cite=("laskar-robutel2001",)
    ),
    _near_integrable_method(
        table="saba-4", order=2, name="saba-4", source="Laskar & Robutel 2001, SABA_4", cite=("laskar-robutel2001",)
    ),
    _near_integrable_method(
        table="aba-864",
        order=4,
        name="aba-8-6-4",
        source="Blanes et al. 2013, ABA(8,6,4); Farres et al. 2013",
        cite=("blanes2013", "farres2013"),
    ),
    _near_integrable_method(
        table="aba-1064",
        order=4,
        name="aba-10-6-4",
        source="Blanes et al. 2013, ABA(10,6,4); Farres et al. 2013",
        cite=("blanes2013", "farres2013"),
    ),
)
