r"""A charged particle around a Schwarzschild black hole in a uniform magnetic field.

In q = (r, theta), p = (p_r, p_theta), with M = c = G = 1, energy E and angular momentum L,

.. math::
    H = -\frac{E^2}{2(1 - 2/r)} + \frac{(L - \tfrac\beta2 r^2\sin^2\theta)^2}{2 r^2\sin^2\theta}
        + \frac{p_r^2}2 - \frac{p_r^2}r + \frac{p_\theta^2}{2 r^2} ,

a sum of four parts with exact flows: the first two terms together, and each of the others.  On the orbits H = -1/2, and
the time is the particle's proper time.
Without the field it is integrable; with it orbits may be chaotic.  The horizon r = 2 is a singularity.

Start: in the equatorial plane with p_r = 0; p_theta is what H = -1/2 gives.
"""

from __future__ import annotations

from math import pi, sqrt

import sympy as sp

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.parts import SplitHamiltonian

from .base import Orbit, Pace, Problem, decades

PARAMETERS = {"E": 0.995, "L": 4.6, "beta": 8.9e-4}
RADII = {"inner": 11.0, "outer": 70.0}


def start(r: float, E: float, L: float, beta: float) -> float:
    """Return p_theta > 0 with H = -1/2 at ``r``, theta = pi/2, p_r = 0; raise InvalidInput if there is none."""
    square = r * r * (E * E / (1 - 2 / r) - 1) - (L - beta / 2 * r * r) ** 2
    if not square > 0:
        raise InvalidInput(f"no orbit passes r = {r:g} with E = {E:g}, L = {L:g}, beta = {beta:g}")
    return sqrt(square)


def make(E: float, L: float, beta: float) -> Problem:
    """Make the problem of a particle of energy ``E``, angular momentum ``L``, and charge times the field ``beta``."""
    r, theta, pr, pt = sp.symbols("r theta p_r p_theta", real=True)
    E_, L_, b = map(sp.Rational, (E, L, beta))
    rho = r**2 * sp.sin(theta) ** 2
    V = -(E_**2) / (2 * (1 - 2 / r)) + (L_ - b / 2 * rho) ** 2 / (2 * rho)
    return Problem(
        id="magnetized-schwarzschild",
        name="charged particle around a Schwarzschild black hole in a magnetic field",
        source="Wang, Sun, Liu & Wu 2021, Astrophys. J. 907, 66; data: this suite",
        cite=("wang2021",),
        system=SplitHamiltonian(
            q=[r, theta],
            p=[pr, pt],
            parts=[pr**2 / 2, -(pr**2) / r, pt**2 / (2 * r**2), V],
            singular=[r - 2],
        ),
        orbits=tuple(
            Orbit(name, (x, pi / 2), (0.0, start(x, E, L, beta)), f"from r = {x:g} with p_r = 0", decades(1000.0))
            for name, x in RADII.items()
        ),
        pace=Pace(unit=36.0, step=7.0, span=115.0, later=40.0),
    )
