"""Quantities of a body: jupiter.longitude, jupiter.x, of any system that knows its bodies.

A longitude, a latitude and a distance are about the central body; x, y, z, vx, vy, vz about what the frame of the table
says: the central body (heliocentric) or the barycentre.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from phasebench.benchmarks.problems.bodies import CARTESIAN, HELIOCENTRIC

from .quantities import Quantity

SPACE = 3
#: (problem, the body's number, q and p rows (n, d)) -> an array (n, 3).
Vectors = Callable[..., np.ndarray]


def position(problem, body: int, q, p) -> np.ndarray:
    """Where a body is about the central one, rows (n, 3)."""
    return q[:, SPACE * body : SPACE * (body + 1)] - q[:, :SPACE]


def _cartesian(name: str, component: int) -> Callable:
    """Component of (position, velocity) in the frame of the table."""
    axis = component % SPACE

    def value(problem, body: int, q, p) -> np.ndarray:
        found = problem.bodies
        rows, over = (q, np.ones(len(found.masses))) if component < SPACE else (p, 1 / np.array(found.masses))
        about = rows[:, axis] * over[0] if found.frame == HELIOCENTRIC else 0.0
        return rows[:, SPACE * body + axis] * over[body] - about

    return value


def _longitude(problem, body: int, q, p) -> np.ndarray:
    x = position(problem, body, q, p)
    return np.arctan2(x[:, 1], x[:, 0])


def _latitude(problem, body: int, q, p) -> np.ndarray:
    x = position(problem, body, q, p)
    return np.arctan2(x[:, 2], np.hypot(x[:, 0], x[:, 1]))


def _distance(problem, body: int, q, p) -> np.ndarray:
    return np.linalg.norm(position(problem, body, q, p), axis=1)


#: Name -> (what it is, unit, function, whether it is an angle).
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
    """A quantity of the body of that name and number, at the end."""
    about, unit, value, angle = KINDS[kind]

    def values(problem, t, q, p) -> np.ndarray:
        return value(problem, body, q[-1:], p[-1:])

    return Quantity(f"{name}.{kind}", f"of {name} {about}, at the end", unit, values, angle=angle)


def of_bodies(problem) -> Iterator[Quantity]:
    """All of a problem that has ``bodies``; none of any other."""
    found = getattr(problem, "bodies", None)
    for body, name in enumerate(found.names if found is not None else ()):
        yield from (of_body(name, body, kind) for kind in KINDS if body or found.frame != HELIOCENTRIC)


def body_of(problem, quantity: Quantity) -> str | None:
    """The name of the body that a quantity is of; None where it is not of a body."""
    found = getattr(problem, "bodies", None)
    name, mark, kind = quantity.name.rpartition(".")
    return name if found is not None and mark and kind in KINDS and name in found.names else None
