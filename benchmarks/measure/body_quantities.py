r"""Quantities of one body, such as jupiter.longitude or jupiter.x, in systems with named bodies.

Longitude, latitude and distance are relative to the central body; x, y, z, vx, vy, vz are in the frame of the table of
bodies: heliocentric or barycentric.  The longitude is the true longitude :math:`\Omega + \omega + f`, measured in the
body's own osculating orbit, so that it tells the motion whatever the inclination: the plane of the orbit, of unit
normal n, is turned about its node into the plane of coordinates, where

.. math:: \lambda = \operatorname{atan2}\Bigl(y - \frac{z\,n_y}{1 + n_z},\ x - \frac{z\,n_x}{1 + n_z}\Bigr).

If the orbit is retrograde at the start, z and :math:`n_z` have the other sign: :math:`\lambda = \Omega - \omega - f`.

The elements a, e, inc, Omega, pomega are those of the osculating orbit about the central body, angles in radians.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks.problems.bodies import CARTESIAN, HELIOCENTRIC

from .quantities import Quantity

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.benchmarks.problems.planetary import PlanetarySystem

SPACE = 3
#: Cosine of an inclination that differs from 90 degrees by rounding alone.
RIGHT = 1e-9
#: Type of (problem, index of the body, q and p rows (n, d)) -> array (n, 3).
Vectors = Callable[..., np.ndarray]


def position(problem: Problem, body: int, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return the position of a body, by its index, relative to the central one: array (n, 3)."""
    return q[:, SPACE * body : SPACE * (body + 1)] - q[:, :SPACE]


def _cartesian(name: str, component: int) -> Callable:
    """The function (problem, body, q, p) -> (n,) of x, y, z (0-2) or vx, vy, vz (3-5) in the table's frame."""
    axis = component % SPACE

    def value(problem: PlanetarySystem, body: int, q: np.ndarray, p: np.ndarray) -> np.ndarray:
        found = problem.bodies
        rows, over = (q, np.ones(len(found.masses))) if component < SPACE else (p, 1 / np.array(found.masses))
        about = rows[-1:, axis] * over[0] if found.frame == HELIOCENTRIC else 0.0
        return rows[-1:, SPACE * body + axis] * over[body] - about

    return value


def _orbit(problem: PlanetarySystem, body: int, q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, ...]:
    """Position, velocity and their cross product about the central body, arrays (n, 3)."""
    x = position(problem, body, q, p)
    v = position(problem, body, p / np.repeat(problem.bodies.masses, SPACE), p)
    return x, v, np.cross(x, v)


def _element(name: str) -> Callable:
    """The function (problem, body, q, p) -> (1,) of an element of the osculating orbit at the end."""

    def value(problem: PlanetarySystem, body: int, q: np.ndarray, p: np.ndarray) -> np.ndarray:
        masses = problem.bodies.masses
        mu = problem.bodies.units.G * (masses[0] + masses[body])
        x, v, L = (part[-1] for part in _orbit(problem, body, q[-1:], p[-1:]))
        r = np.linalg.norm(x)
        e = np.cross(v, L) / mu - x / r  # points to the pericentre, of the size of the eccentricity
        sign = -1.0 if L[2] < 0 else 1.0
        node = np.arctan2(L[0], -L[1])
        towards = np.array([np.cos(node), np.sin(node), 0.0])
        pericentre = np.arctan2(np.cross(towards, e) @ L / np.linalg.norm(L), towards @ e)
        found = {
            "a": 1 / (2 / r - v @ v / mu),
            "e": np.linalg.norm(e),
            "inc": np.arctan2(np.hypot(L[0], L[1]), L[2]),
            "Omega": node,
            "pomega": node + sign * pericentre,
        }
        return np.array([found[name]])

    return value


def _longitude(problem: PlanetarySystem, body: int, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    x, _, normal = _orbit(problem, body, q, p)
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    sign = -1.0 if normal[0, 2] < -RIGHT else 1.0
    tilt = sign * x[-1, 2] / (1 + sign * normal[-1, 2])
    return np.arctan2(x[-1:, 1] - tilt * normal[-1:, 1], x[-1:, 0] - tilt * normal[-1:, 0])


def _latitude(problem: PlanetarySystem, body: int, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    x = position(problem, body, q[-1:], p)
    return np.arctan2(x[:, 2], np.hypot(x[:, 0], x[:, 1]))


def _distance(problem: PlanetarySystem, body: int, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    return np.linalg.norm(position(problem, body, q[-1:], p), axis=1)


#: Name -> (description, unit, function of the rows, whose last is the end, True if it is taken modulo 2 pi).
KINDS: dict[str, tuple[str, str, Callable, bool]] = {
    "longitude": ("the true longitude about the central body, in its own orbit", "rad", _longitude, True),
    "latitude": ("the latitude over the plane of coordinates, seen from the central body", "rad", _latitude, False),
    "distance": ("the distance from the central body", "length", _distance, False),
    "a": ("the semi-major axis of the osculating orbit", "length", _element("a"), False),
    "e": ("the eccentricity of the osculating orbit", "", _element("e"), False),
    "inc": ("the inclination of the osculating orbit", "rad", _element("inc"), False),
    "Omega": ("the longitude of the node of the osculating orbit", "rad", _element("Omega"), True),
    "pomega": ("the longitude of the pericentre of the osculating orbit", "rad", _element("pomega"), True),
    **{
        name: (f"{name} in the frame of the table", "length" if k < SPACE else "speed", _cartesian(name, k), False)
        for k, name in enumerate(CARTESIAN)
    },
}


def of_bodies(problem: Problem) -> Iterator[Quantity]:
    """Yield a `Quantity` for every body and kind (longitude, distance, x, ...) of a problem; none without bodies."""
    found = getattr(problem, "bodies", None)
    for body, name in enumerate(found.names if found is not None else ()):
        for kind in KINDS if body else CARTESIAN if found.frame != HELIOCENTRIC else ():
            about, unit, value, angle = KINDS[kind]
            values = partial(_of_rows, value, body)
            yield Quantity(f"{name}.{kind}", f"of {name} {about}, at the end", unit, values, angle=angle)


def _of_rows(
    value: Callable, body: int, problem: PlanetarySystem, t: np.ndarray, q: np.ndarray, p: np.ndarray
) -> np.ndarray:
    return value(problem, body, q, p)
