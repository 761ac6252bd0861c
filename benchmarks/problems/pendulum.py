"""The mathematical pendulum H = p^2 / 2 - cos q (mass, length and gravity 1)."""

import sympy as sp

from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import Orbit, Problem

PARAMETERS: dict[str, float] = {}


def make() -> Problem:
    """The problem; its orbits swing to 2 radians and turn over."""
    q, p = sp.symbols("q p", real=True)
    return Problem(
        id="pendulum",
        name="mathematical pendulum",
        source="Hairer, Lubich & Wanner 2006, I.1.3; talk on symplectic integration, 'The Pendulum Problem'",
        cite=("hairer2006", "wang-talk"),
        system=Hamiltonian(q=[q], p=[p], H=p**2 / 2 - sp.cos(q)),
        orbits=(
            Orbit("swinging", (2.0,), (0.0,), "released at 2 radians"),
            Orbit("rotating", (0.0,), (2.5,), "turns over: H = 2.125 > 1"),
        ),
    )
