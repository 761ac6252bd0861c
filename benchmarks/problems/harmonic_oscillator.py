"""The harmonic oscillator H = (p^2 + omega^2 q^2) / 2: linear, so every stability limit is known in closed form."""

import sympy as sp

from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import ORDER, Orbit, Pace, Problem, Scene, check_positive, halvings

PARAMETERS = {"omega": 1.0}
SCENES = (Scene("oscillator-t2", "harmonic-oscillator", ORDER, 2.0, halvings(0.2, 6)),)


def make(omega: float) -> Problem:
    """Make the harmonic oscillator of frequency ``omega`` > 0."""
    check_positive("the oscillator", omega=omega)
    q, p = sp.symbols("q p", real=True)
    w = sp.Rational(omega)  # exactly the double
    return Problem(
        id="harmonic-oscillator",
        name="harmonic oscillator",
        source="Hairer, Lubich & Wanner 2006, I.1",
        cite=("hairer2006",),
        system=Hamiltonian(q=[q], p=[p], H=p**2 / 2 + w**2 * q**2 / 2, frequencies=[w]),
        orbits=(Orbit("unit", (1.0,), (0.0,), "at rest at unit distance", (1.0, 2.0, 10.0, 100.0, 1000.0)),),
        pace=Pace(step=0.1, span=1.0, later=0.0),
    )
