"""The true longitude of a body from its position and velocity, as a textbook computes it."""

from __future__ import annotations

from math import pi

import numpy as np


def true_longitude(x: np.ndarray, v: np.ndarray) -> float:
    """Omega, and from the node on the angle in the orbit, of a body at x with velocity v about the origin."""
    n = np.cross(x, v)
    node = np.array([-n[1], n[0], 0.0]) / np.hypot(n[0], n[1])
    along = np.cross(n, node) / np.linalg.norm(n)
    turn = np.arctan2(node[1], node[0]) + (1 if n[2] > 0 else -1) * np.arctan2(x @ along, x @ node)
    return (turn + pi) % (2 * pi) - pi
