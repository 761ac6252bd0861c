"""Records of methods for planetary systems along the Kepler flow: Wisdom-Holman splittings, and Gauss's method."""

from __future__ import annotations

from typing import Any

from phasebench.integrators import coefficients
from phasebench.integrators.compile.lazy import mpmath
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import SYMPLECTIC, Method

#: The correctors that are published (Wisdom 2006, table 1).
CORRECTORS = (3, 5, 7, 11, 17)
#: The largest number of stages of `fcirk`, and that of the published implementation.
MOST, USUAL = 12, 8


def splitting(name: str) -> tuple[tuple, tuple]:
    """The weights (drifts, kicks) of the table ``name`` of `coefficients`, which must begin and end with a drift."""
    steps = coefficients.steps(name)
    drifts, kicks = steps[::2], steps[1::2]
    if {letter for letter, _ in drifts} != {"A"} or {letter for letter, _ in kicks} != {"B"}:
        raise ValueError(f"the table {name} does not alternate from a drift to a drift")
    return tuple(x for _, x in drifts), tuple(x for _, x in kicks)


def _record(family: str = "wisdom_holman", **facts: Any) -> Method:
    common = SYMPLECTIC | {
        "requires": ("canonical", "separable", "quadratic kinetic energy", "constant mass matrix", "Kepler part")
    }
    return Method(family=family, **(common | facts))


def _corrected(corrector: int) -> dict[str, Any]:
    if corrector not in CORRECTORS:
        raise InvalidInput(f"correctors are of the orders {', '.join(map(str, CORRECTORS))}, not {corrector}")
    return {"data": lambda: _wisdom_holman(corrector)}


def _wisdom_holman(corrector: int) -> tuple:
    half = mpmath.mpf(1) / 2
    return (half, half), (2 * half,), corrector


def _gauss(stages: int) -> dict[str, Any]:
    if not 1 <= stages <= MOST:
        raise InvalidInput(f"stages is {stages}; take 1 to {MOST} of Gauss's method, for the order 2 stages")
    return {"data": (stages,), "order": 2 * stages}


METHODS: tuple[Method, ...] = (
    _record(
        id="wisdom-holman",
        name="Wisdom-Holman, drift-kick-drift",
        order=2,
        source="Wisdom & Holman 1991; Rein & Tamayo 2015",
        cite=("wisdom-holman1991", "rein-tamayo2015"),
        data=lambda: _wisdom_holman(1),
    ),
    _record(
        id="wisdom-holman-corrector",
        name="Wisdom-Holman with a symplectic corrector",
        order=2,
        source="Wisdom, Holman & Touma 1996; Wisdom 2006",
        cite=("wisdom-holman-touma1996", "wisdom2006"),
        symmetric=False,
        parameters={"corrector": 17},
        with_parameters=_corrected,
        **_corrected(17),
    ),
    *(
        _record(
            id=f"wisdom-holman-{name}",
            name=f"{table.upper()} with Kepler drifts",
            source=source,
            cite=cite,
            data=lambda table=table: (*splitting(table), 1),
            order=order,
        )
        for table, order, name, source, cite in (
            ("saba-2", 2, "saba-2", "Laskar & Robutel 2001, SABA_2", ("laskar-robutel2001",)),
            ("saba-4", 2, "saba-4", "Laskar & Robutel 2001, SABA_4", ("laskar-robutel2001",)),
            (
                *("aba-864", 4, "aba-8-6-4", "Blanes et al. 2013, ABA(8,6,4); Farres et al. 2013"),
                ("blanes2013", "farres2013"),
            ),
            (
                *("aba-1064", 4, "aba-10-6-4", "Blanes et al. 2013, ABA(10,6,4); Farres et al. 2013"),
                ("blanes2013", "farres2013"),
            ),
        )
    ),
    _record(
        id="fcirk",
        name="flow-composed implicit Runge-Kutta: Gauss for the perturbation of Kepler orbits, along their flow",
        family="fcirk",
        source="Antonana, Makazaga & Murua 2017; Antonana, Alberdi, Makazaga & Murua 2022",
        cite=("antonana2017", "antonana2022", "butcher1964"),
        parameters={"stages": USUAL},
        with_parameters=_gauss,
        **_gauss(USUAL),
    ),
)
