"""The solar system: the Sun and eight planets about their barycentre, the Earth with the Moon as one body; d = 27.

Units: astronomical units, days, solar masses; the planes are those of the ecliptic and the mean equinox of J2000.
H = sum |p_i|^2 / (2 m_i) - G sum m_i m_j / |q_i - q_j|, with the momenta m v rounded to double.

The orbits are the Keplerian elements that JPL publishes for approximate positions, at their epoch J2000 without their
rates, taken as osculating about the Sun.  They are a fit to 1800-2050, so that positions are off by up to some minutes
of arc: this is a solar system for comparing integrators, no ephemeris.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from . import planetary
from .base import Pace, Problem, decades
from .bodies import Bodies, bodies
from .units import Units

PARAMETERS: dict[str, float] = {}
#: Name -> (mass of the Sun over the planet's; a in AU, e, inclination, mean longitude, longitudes of the perihelion and
#: of the ascending node in degrees).  Masses: JPL DE405.
PLANETS = {
    "mercury": (6023600.0, "0.38709927", "0.20563593", "7.00497902", "252.25032350", "77.45779628", "48.33076593"),
    "venus": (408523.71, "0.72333566", "0.00677672", "3.39467605", "181.97909950", "131.60246718", "76.67984255"),
    "earth": (328900.5614, "1.00000261", "0.01671123", "-0.00001531", "100.46457166", "102.93768193", "0.0"),
    "mars": (3098708.0, "1.52371034", "0.09339410", "1.84969142", "-4.55343205", "-23.94362959", "49.55953891"),
    "jupiter": (1047.3486, "5.20288700", "0.04838624", "1.30439695", "34.39644051", "14.72847983", "100.47390909"),
    "saturn": (3497.898, "9.53667594", "0.05386179", "2.48599187", "49.95424423", "92.59887831", "113.66242448"),
    "uranus": (22902.98, "19.18916464", "0.04725744", "0.77263783", "313.23810451", "170.95427630", "74.01692503"),
    "neptune": (19412.24, "30.06992276", "0.00859048", "1.77004347", "-55.12002969", "44.96476227", "131.78422574"),
}


def table() -> Bodies:
    """Return the table of the Sun and eight planets with their masses, positions and velocities about the Sun."""
    rows: list[dict[str, object]] = [{"name": "sun", "m": 1.0}]
    for name, (mass, a, e, inc, longitude, pericentre, node) in PLANETS.items():
        degrees = {"inc": inc, "Omega": node, "omega": _minus(pericentre, node), "M": _minus(longitude, pericentre)}
        rows.append({"name": name, "m": 1 / mass, "a": a, "e": e} | degrees)
    return bodies([(str(row["name"]), row) for row in rows], Units(), None, "the solar system", list(rows[1]))


def _minus(a: str, b: str) -> float:
    return float(sp.Rational(a) - sp.Rational(b))


def make() -> Problem:
    """Make the problem of the solar system, which has no parameters."""
    made = planetary.build(table())
    about = "the elements at the epoch J2000"
    return replace(
        made,
        id="solar-system",
        name="solar system of eight planets",
        source="Standish, Keplerian Elements for Approximate Positions of the Major Planets (JPL), table 1",
        cite=("standish-williams2013", "standish1998"),
        orbits=(replace(made.start, name="j2000", about=about, times=decades(3652.5)),),
        invariants={name: e for name, e in made.invariants.items() if "momentum" in name},
        pace=Pace(unit=9.0, step=3.0, span=150.0, later=15.0),
    )
