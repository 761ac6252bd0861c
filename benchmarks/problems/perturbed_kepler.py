"""The Kepler problem with the Schwarzschild term, H = |p|^2 / 2 - 1 / r - mu / (3 r^3): the orbit precesses."""

import sympy as sp

from phasebench.integrators.families.wisdom_holman import KeplerPart
from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import Problem
from .kepler import pericentre, plane

PARAMETERS = {"e": 0.6, "mu": 0.0075}


def make(e: float, mu: float) -> Problem:
    """The problem at eccentricity 0 <= ``e`` < 1 of the unperturbed orbit and strength ``mu`` of the term."""
    q1, q2, p1, p2, r, L = plane()
    H = (p1**2 + p2**2) / 2 - 1 / r - sp.Rational(mu) / (3 * r**3)
    return Problem(
        id="perturbed-kepler",
        name="Kepler problem with the Schwarzschild term",
        source="Wang, Bo & Cai (talk), (29)-(30); Hairer, Lubich & Wanner 2006, exercise I.12",
        cite=("wang-talk", "hairer2006"),
        system=Hamiltonian(q=[q1, q2], p=[p1, p2], H=H, singular=[r], invariants=[L], kepler=KeplerPart(2, (1,), (1,))),
        orbits=(pericentre(e),),
        invariants={"angular-momentum": L},
        parameters={"e": e, "mu": mu},
    )
