r"""Geodesics around a rotating black hole (Kerr), in a time in which H is a sum of parts with exact flows.

In Boyer-Lindquist coordinates q = (r, theta), p = (p_r, p_theta), with M = c = G = 1, spin a, energy E and angular
momentum L, :math:`\Sigma = r^2 + a^2\cos^2\theta` and :math:`\Delta = r^2 - 2r + a^2`, the geodesics of proper time are
those of :math:`K = \bigl(\Delta p_r^2 + p_\theta^2 + W\bigr)/2\Sigma = -\tfrac12`,

.. math::
    W = \Bigl(\frac L{\sin\theta} - aE\sin\theta\Bigr)^2 - \frac{\bigl((r^2 + a^2)E - aL\bigr)^2}\Delta .

The system here is :math:`H = g\,(K + \tfrac12) = 0` with :math:`g = \Sigma / r^2`, in a time w with
:math:`d\tau = g\,dw`:

.. math::
    H = \frac{p_r^2}2 - \frac{p_r^2}r + \frac{a^2 p_r^2}{2r^2} + \frac{p_\theta^2}{2r^2} + \frac{W + \Sigma}{2r^2} .

Carter's constant :math:`p_\theta^2 + \cos^2\theta\,\bigl(a^2(1 - E^2) + L^2/\sin^2\theta\bigr)` is conserved on H = 0.

Start: in the equatorial plane with p_r = 0; p_theta is what H = 0 gives.
"""

from __future__ import annotations

from math import pi, sqrt

import sympy as sp

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.parts import SplitHamiltonian

from .base import Orbit, Pace, Problem, decades

PARAMETERS = {"a": 0.5, "E": 0.995, "L": 4.6}
RADIUS = 11.0


def make(a: float, E: float, L: float) -> Problem:
    """Make the problem of spin |``a``| < 1, energy ``E``, momentum ``L``; InvalidInput if no orbit passes `RADIUS`."""
    if not abs(a) < 1:
        raise InvalidInput(f"the spin a is {a}; it must be between -1 and 1")
    delta = RADIUS**2 - 2 * RADIUS + a**2
    square = ((RADIUS**2 + a**2) * E - a * L) ** 2 / delta - (L - a * E) ** 2 - RADIUS**2
    if not square > 0:
        raise InvalidInput(f"no orbit passes r = {RADIUS:g} with a = {a:g}, E = {E:g}, L = {L:g}")
    r, theta, pr, pt = sp.symbols("r theta p_r p_theta", real=True)
    a_, E_, L_ = map(sp.Rational, (a, E, L))
    sine, cosine = sp.sin(theta), sp.cos(theta)
    hole = r**2 - 2 * r + a_**2
    W = (L_ / sine - a_ * E_ * sine) ** 2 - ((r**2 + a_**2) * E_ - a_ * L_) ** 2 / hole
    parts = [pr**2 / 2, -(pr**2) / r, pt**2 / (2 * r**2), (W + r**2 + a_**2 * cosine**2) / (2 * r**2)]
    if a:
        parts.insert(2, a_**2 * pr**2 / (2 * r**2))
    return Problem(
        id="kerr",
        name="geodesics of the Kerr metric, in a time that splits H",
        source="Carter 1968; Wu, Wang, Sun & Liu 2021, Astrophys. J. 914, 63; data: this suite",
        cite=("carter1968", "wu2021"),
        system=SplitHamiltonian(q=[r, theta], p=[pr, pt], parts=parts, singular=[sp.numer(sp.together(hole))]),
        orbits=(Orbit("bound", (RADIUS, pi / 2), (0.0, sqrt(square)), "from r = 11 with p_r = 0", decades(1000.0)),),
        pace=Pace(unit=36.0, step=7.0, span=115.0, later=40.0),
    )
