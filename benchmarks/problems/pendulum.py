"""The mathematical pendulum H = p^2 / 2 - cos q (mass, length and gravity 1)."""

import sympy as sp

from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import DRIFT, ORDER, Orbit, Problem, Scene, decades, halvings

PARAMETERS: dict[str, float] = {}
SCENES = (
    Scene("pendulum-t2", "pendulum:swinging", ORDER, 2.0, halvings(0.2, 6)),
    Scene("pendulum-t1000", "pendulum:swinging", DRIFT, 1000.0, (0.1, 0.05, 0.02)),
)


def make() -> Problem:
    """Make the pendulum problem; one orbit swings between -2 and 2 radians, one rotates."""
    q, p = sp.symbols("q p", real=True)
    return Problem(
        id="pendulum",
        name="mathematical pendulum",
        source="Hairer, Lubich & Wanner 2006, I.1.3; talk on symplectic integration, 'The Pendulum Problem'",
        cite=("hairer2006", "wang-talk"),
        system=Hamiltonian(q=[q], p=[p], H=p**2 / 2 - sp.cos(q)),
        orbits=(
            Orbit("swinging", (2.0,), (0.0,), "released at 2 radians", (1.0, 2.0, 10.0, 100.0, 1000.0)),
            Orbit("rotating", (0.0,), (2.5,), "turns over: H = 2.125 > 1", decades(1000.0)),
        ),
    )
