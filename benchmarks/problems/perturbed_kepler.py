"""The Kepler problem with the Schwarzschild term, H = |p|^2 / 2 - 1 / r - mu / (3 r^3): the orbit precesses."""

import sympy as sp

from phasebench.integrators.families.wisdom_holman import KeplerPart
from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import DRIFT, ORDER, Problem, Scene, decades, halvings
from .kepler import PACE, pericentre, plane

PARAMETERS = {"e": 0.6, "mu": 0.0075}
SCENES = (
    Scene("perturbed-kepler-t1", "perturbed-kepler", ORDER, 1.0, halvings(0.04, 6)),
    Scene("perturbed-kepler-t1000", "perturbed-kepler", DRIFT, 1000.0, (0.05, 0.02, 0.01, 0.005), trajectory=1e-9),
)


def make(e: float, mu: float) -> Problem:
    """Make the problem; 0 <= ``e`` < 1 is the eccentricity of the orbit without the term, from the same start."""
    q1, q2, p1, p2, r, L = plane()
    H = (p1**2 + p2**2) / 2 - 1 / r - sp.Rational(mu) / (3 * r**3)
    return Problem(
        id="perturbed-kepler",
        name="Kepler problem with the Schwarzschild term",
        source="Wang, Bo & Cai (talk), (29)-(30); Hairer, Lubich & Wanner 2006, exercise I.12",
        cite=("wang-talk", "hairer2006"),
        system=Hamiltonian(q=[q1, q2], p=[p1, p2], H=H, singular=[r], invariants=[L], kepler=KeplerPart(2, (1,), (1,))),
        orbits=(pericentre(e, decades(1000.0)),),
        invariants={"angular-momentum": L},
        pace=PACE,
    )
