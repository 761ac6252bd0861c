"""The record of flow-composed implicit Runge-Kutta methods: Gauss's method on the perturbations of Kepler orbits."""

from __future__ import annotations

from typing import Any

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import BOUNDED, ROUND_OFF, Method

#: The largest number of stages, and that of the published implementation.
MOST, USUAL = 12, 8


def _facts(stages: int) -> dict[str, Any]:
    if not 1 <= stages <= MOST:
        raise InvalidInput(f"stages is {stages}; take 1 to {MOST} of Gauss's method, for the order 2 stages")
    return {"data": (stages,), "order": 2 * stages}


METHODS: tuple[Method, ...] = (
    Method(
        id="fcirk",
        name="flow-composed implicit Runge-Kutta: Gauss for the perturbation of Kepler orbits, along their flow",
        family="fcirk",
        symmetric=True,
        symplectic=True,
        energy=BOUNDED,
        quadratic=ROUND_OFF,
        source="Antonana, Makazaga & Murua 2017; Antonana, Alberdi, Makazaga & Murua 2022",
        cite=("antonana2017", "antonana2022", "butcher1964"),
        requires=("canonical", "separable", "quadratic kinetic energy", "Kepler part"),
        parameters={"stages": USUAL},
        with_parameters=_facts,
        **_facts(USUAL),
    ),
)
