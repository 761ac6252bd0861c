"""Records of methods in extended phase space: with two copies of the state, substeps are explicit for every H.

Methods that set both copies to their mean after every step are explicit Runge-Kutta methods (`coefficients.copies`);
these cannot be symplectic for every H, which would need b_i^2 = 0.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from phasebench.integrators.coefficients.copies import midpoint_tableau
from phasebench.integrators.coefficients.fractions import triple_jump
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import BOUNDED, DRIFTING, NONE, SYMPLECTIC, Method

CANONICAL = {"requires": ("canonical",)}


def _composed(order: int, source: str, *cite: str) -> dict[str, Any]:
    """The source and its keys of a method of order 2, and with Yoshida's those of the triple jump of a higher order."""
    more = order > 2
    return {"source": source + "; Yoshida 1990" * more, "cite": (*cite, *("yoshida1990",) * more), "order": order}


def _tao(order: int) -> Method:
    def data(omega: Fraction | float) -> dict[str, Any]:
        if omega < 0:
            raise InvalidInput(f"omega is {float(omega):g}; the copies are bound by a number that is not negative")
        return {"data": lambda: (triple_jump(order), Fraction(omega))}

    omega = Fraction(20)
    return Method(
        id=f"tao-{order}",
        name=f"Tao's method of order {order}, extended phase space with bound copies",
        family="extended",
        parameters={"omega": omega},
        with_parameters=data,
        **data(omega),
        **_composed(order, "Tao 2016", "tao2016"),
        **(DRIFTING | CANONICAL | {"energy": BOUNDED, "quadratic": BOUNDED}),
    )


def _semiexplicit(order: int) -> Method:
    return Method(
        id=f"jayawardana-ohsawa-{order}",
        name=f"semiexplicit method of order {order}, extended phase space with symmetric projection",
        family="semiexplicit",
        data=lambda: (triple_jump(order),),
        **_composed(order, "Jayawardana & Ohsawa 2023; Ohsawa 2023", "jayawardana-ohsawa2023", "ohsawa2023"),
        **SYMPLECTIC,
        **CANONICAL,
    )


METHODS: tuple[Method, ...] = (
    *map(_tao, (2, 4, 6)),
    Method(
        id="pihajoki-2",
        name="Pihajoki's leapfrog, extended phase space with free copies",
        family="extended",
        order=2,
        source="Pihajoki 2015, without mixing",
        cite=("pihajoki2015",),
        data=lambda: (triple_jump(2), None),
        **(DRIFTING | CANONICAL | {"energy": NONE, "quadratic": NONE}),
    ),
    *map(_semiexplicit, (2, 4)),
    Method(
        id="extended-midpoint-4",
        name="extended phase space of order 4, copies projected to their midpoint",
        family="runge_kutta",
        order=4,
        source="Luo, Wu, Huang & Liu 2017; the abstract of Mei, Wu & Jiang 2025",
        cite=("luo2017", "mei2025", "yoshida1990"),
        data=lambda: midpoint_tableau(triple_jump(4)),
        **DRIFTING,
        **CANONICAL,
    ),
)
