"""The Kepler problem H = |p|^2 / 2 - 1 / |q| from pericentre at eccentricity e; the period is 2 pi."""

from __future__ import annotations

from math import pi

import sympy as sp

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families.wisdom_holman import KeplerPart
from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import DRIFT, ORDER, Orbit, Pace, Problem, Scene, halvings

PARAMETERS = {"e": 0.6}
#: The period, and the times of certified states: 1, and 1, 10 and 100 periods.
PERIOD = 2 * pi
TIMES = (1.0, PERIOD, 10 * PERIOD, 100 * PERIOD)
PACE = Pace(step=0.15, later=0.7)
SCENES = (
    Scene("kepler-t1", "kepler", ORDER, 1.0, halvings(0.04, 6)),
    Scene("kepler-100-orbits", "kepler", DRIFT, 200 * pi, (pi / 60, pi / 150, pi / 300), trajectory=1e-9),
)


def plane() -> tuple[sp.Symbol, sp.Symbol, sp.Symbol, sp.Symbol, sp.Expr, sp.Expr]:
    """Return (q1, q2, p1, p2, r, L) of motion in the plane: four SymPy symbols, and expressions.

    r is the distance from the origin, L the angular momentum.
    """
    q1, q2, p1, p2 = sp.symbols("q1 q2 p1 p2", real=True)
    return q1, q2, p1, p2, sp.sqrt(q1**2 + q2**2), q1 * p2 - q2 * p1


def pericentre(e: float, times: tuple[float, ...]) -> Orbit:
    """Make the Kepler orbit from the pericentre, q = (1 - e, 0), p = (0, sqrt((1 + e)/(1 - e))), in doubles.

    ``times`` are those at which reference states with a proven error are stored; there may be none.  Raises
    InvalidInput unless 0 <= e < 1.
    """
    if not 0 <= e < 1:
        raise InvalidInput(f"the eccentricity e is {e}; it must be at least 0 and less than 1")
    return Orbit("e", (1.0 - e, 0.0), (0.0, ((1.0 + e) / (1.0 - e)) ** 0.5), f"pericentre of eccentricity {e:g}", times)


def make(e: float) -> Problem:
    """Make the Kepler problem at eccentricity 0 <= ``e`` < 1."""
    q1, q2, p1, p2, r, L = plane()
    return Problem(
        id="kepler",
        name="Kepler problem",
        source="Hairer, Lubich & Wanner 2006, I.2.2",
        cite=("hairer2006",),
        system=Hamiltonian(
            q=[q1, q2],
            p=[p1, p2],
            H=(p1**2 + p2**2) / 2 - 1 / r,
            singular=[r],
            invariants=[L],
            kepler=KeplerPart(2, (1,), (1,)),
        ),
        orbits=(pericentre(e, TIMES),),
        invariants={
            "angular-momentum": L,
            "laplace-runge-lenz-1": p2 * L - q1 / r,
            "laplace-runge-lenz-2": -p1 * L - q2 / r,
        },
        pace=PACE,
    )
