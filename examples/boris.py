"""Boris's method, a step of a charged particle: x, v, E and B are arrays (3,), v' = E(x) + v x B(x)."""

import numpy as np

CLAIMS = {"order": 2, "symmetric": True, "volume": True, "symplectic": False}
REQUIRES = ("magnetic",)


def step(system, x, v, h):
    """Return (x, v) after a step h: half a drift, half a kick by E, rotation of v about B, half a kick, half a drift.

    Position x and velocity v are arrays (3,); ``system`` gives the fields E(x) and B(x).
    """
    x = x + h / 2 * v
    kick, t = h / 2 * system.E(x), h / 2 * system.B(x)
    v = v + kick
    v = v + np.cross(v + np.cross(v, t), 2 * t / (1 + t @ t))
    v = v + kick
    return x + h / 2 * v, v
