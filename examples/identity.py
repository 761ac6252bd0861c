"""A useless step, which returns the state unchanged: symplectic and reversible, but it solves no equation."""

CLAIMS = {"order": 1, "symplectic": True, "reversible": True}


def step(system, q, p, h):
    return q, p
