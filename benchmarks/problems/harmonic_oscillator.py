"""The harmonic oscillator H = (p^2 + omega^2 q^2) / 2: linear, so every stability limit is known in closed form."""

import sympy as sp

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import Orbit, Problem

PARAMETERS = {"omega": 1.0}


def make(omega: float) -> Problem:
    """The problem at frequency ``omega`` > 0."""
    if omega <= 0:
        raise InvalidInput(f"the frequency omega is {omega}; it must be positive")
    q, p = sp.symbols("q p", real=True)
    w = sp.Rational(omega)  # exactly the double
    return Problem(
        id="harmonic-oscillator",
        name="harmonic oscillator",
        source="Hairer, Lubich & Wanner 2006, I.1",
        cite=("hairer2006",),
        system=Hamiltonian(q=[q], p=[p], H=p**2 / 2 + w**2 * q**2 / 2, frequencies=[w]),
        orbits=(Orbit("unit", (1.0,), (0.0,), "at rest at unit distance"),),
        parameters={"omega": omega},
    )
