"""Quantities of one body, such as jupiter.longitude or jupiter.x, in systems with named bodies.

Longitude, latitude and distance are relative to the central body; x, y, z, vx, vy, vz are in the frame of the table of
bodies: heliocentric or barycentric.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks.problems.bodies import CARTESIAN, HELIOCENTRIC

from .quantities import Quantity

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.benchmarks.problems.planetary import PlanetarySystem

SPACE = 3
#: Type of (problem, index of the body, q and p rows (n, d)) -> array (n, 3).
Vectors = Callable[..., np.ndarray]


def position(problem: Problem, body: int, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return the position of a body relative to the central body at n times, array (n, 3).

    ``body`` is its index (0: the central one); q has shape (n, d), body after body.  problem and p are not used.
    """
    return q[:, SPACE * body : SPACE * (body + 1)] - q[:, :SPACE]


def _cartesian(name: str, component: int) -> Callable:
    """Make the function (problem, body, q, p) -> array (n,) of one coordinate or velocity component of a body.

    ``component`` is 0-2 for x, y, z and 3-5 for vx, vy, vz, in the frame of the table of bodies.
    """
    axis = component % SPACE

    def value(problem: PlanetarySystem, body: int, q: np.ndarray, p: np.ndarray) -> np.ndarray:
        found = problem.bodies
        rows, over = (q, np.ones(len(found.masses))) if component < SPACE else (p, 1 / np.array(found.masses))
        about = rows[:, axis] * over[0] if found.frame == HELIOCENTRIC else 0.0
        return rows[:, SPACE * body + axis] * over[body] - about

    return value


def _longitude(problem: PlanetarySystem, body: int, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    x = position(problem, body, q, p)
    return np.arctan2(x[:, 1], x[:, 0])


def _latitude(problem: PlanetarySystem, body: int, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    x = position(problem, body, q, p)
    return np.arctan2(x[:, 2], np.hypot(x[:, 0], x[:, 1]))


def _distance(problem: PlanetarySystem, body: int, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    return np.linalg.norm(position(problem, body, q, p), axis=1)


#: Name -> (description, unit, function, True for an angle).
KINDS: dict[str, tuple[str, str, Callable, bool]] = {
    "longitude": ("the longitude about the central body, in the plane of coordinates", "rad", _longitude, True),
    "latitude": ("the latitude over the plane of coordinates, seen from the central body", "rad", _latitude, True),
    "distance": ("the distance from the central body", "length", _distance, False),
    **{
        name: (f"{name} in the frame of the table", "length" if k < SPACE else "speed", _cartesian(name, k), False)
        for k, name in enumerate(CARTESIAN)
    },
}


def of_body(name: str, body: int, kind: str) -> Quantity:
    """Make the `Quantity` that measures ``kind`` (a key of `KINDS`, such as "longitude") of a body at a run's end.

    ``name`` and ``body`` are the body's name and index.
    """
    about, unit, value, angle = KINDS[kind]

    def values(problem: PlanetarySystem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> np.ndarray:
        return value(problem, body, q[-1:], p[-1:])

    return Quantity(f"{name}.{kind}", f"of {name} {about}, at the end", unit, values, angle=angle)


def of_bodies(problem: Problem) -> Iterator[Quantity]:
    """Yield a `Quantity` for every body and kind (longitude, distance, x, ...) of a problem; none without bodies."""
    found = getattr(problem, "bodies", None)
    for body, name in enumerate(found.names if found is not None else ()):
        yield from (of_body(name, body, kind) for kind in KINDS if body or found.frame != HELIOCENTRIC)


def body_of(problem: Problem, quantity: Quantity) -> str | None:
    """Return the name of the body of a quantity such as jupiter.longitude; None if it is not a body's quantity."""
    found = getattr(problem, "bodies", None)
    name, mark, kind = quantity.name.rpartition(".")
    return name if found is not None and mark and kind in KINDS and name in found.names else None
