"""A step that does nothing: symplectic, reversible, of no use."""

CLAIMS = {"order": 1, "symplectic": True, "reversible": True}


def step(system, q, p, h):
    return q, p
