"""Records of methods in extended phase space: with two copies of the state, substeps are explicit for every H.

Methods that set both copies to their mean after every step are explicit Runge-Kutta methods (`coefficients.copies`);
these cannot be symplectic for every H, which would need b_i^2 = 0.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import mpmath

from phasebench.integrators.coefficients.copies import midpoint_tableau
from phasebench.integrators.coefficients.fractions import triple_jump
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import BOUNDED, DRIFT, NONE, ROUND_OFF, Method

ONE = (mpmath.mpf(1),)


def _tao(order: int) -> Method:
    fractions = triple_jump(order)

    def data(omega: Fraction | float) -> dict[str, Any]:
        if omega < 0:
            raise InvalidInput(f"omega is {float(omega):g}; the copies are bound by a number that is not negative")
        return {"data": (fractions, Fraction(omega))}

    omega = Fraction(20)
    return Method(
        id=f"tao-{order}",
        name=f"Tao's method of order {order}, extended phase space with bound copies",
        family="extended",
        order=order,
        symmetric=False,
        symplectic=False,
        energy=BOUNDED,
        quadratic=BOUNDED,
        source="Tao 2016" + ("" if order == 2 else "; Yoshida 1990"),
        cite=("tao2016", *(() if order == 2 else ("yoshida1990",))),
        requires=("canonical",),
        parameters={"omega": omega},
        with_parameters=data,
        **data(omega),
    )


def _semiexplicit(order: int) -> Method:
    return Method(
        id=f"jayawardana-ohsawa-{order}",
        name=f"semiexplicit method of order {order}, extended phase space with symmetric projection",
        family="semiexplicit",
        order=order,
        symmetric=True,
        symplectic=True,
        energy=BOUNDED,
        quadratic=ROUND_OFF,
        source="Jayawardana & Ohsawa 2023; Ohsawa 2023" + ("" if order == 2 else "; Yoshida 1990"),
        cite=("jayawardana-ohsawa2023", "ohsawa2023", *(() if order == 2 else ("yoshida1990",))),
        requires=("canonical",),
        data=(triple_jump(order),),
    )


def midpoint_method(order: int) -> Method:
    """Make the record of the explicit method of an even order that sets both copies to their mean after each step."""
    return Method(
        id=f"extended-midpoint-{order}",
        name=f"extended phase space of order {order}, copies projected to their midpoint",
        family="runge_kutta",
        order=order,
        symmetric=False,
        symplectic=False,
        energy=DRIFT,
        quadratic=DRIFT,
        source="Luo, Wu, Huang & Liu 2017; the abstract of Mei, Wu & Jiang 2025",
        cite=("luo2017", "mei2025", "yoshida1990"),
        requires=("canonical",),
        data=midpoint_tableau(triple_jump(order)),
    )


METHODS: tuple[Method, ...] = (
    *map(_tao, (2, 4, 6)),
    Method(
        id="pihajoki-2",
        name="Pihajoki's leapfrog, extended phase space with free copies",
        family="extended",
        order=2,
        symmetric=False,
        symplectic=False,
        energy=NONE,
        quadratic=NONE,
        source="Pihajoki 2015, without mixing",
        cite=("pihajoki2015",),
        requires=("canonical",),
        data=(ONE, None),
    ),
    *map(_semiexplicit, (2, 4)),
    midpoint_method(4),
)
