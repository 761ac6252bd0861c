"""A useless step, which returns the state unchanged: symplectic and reversible, but it solves no equation.

`phasebench validate` must find the fault.
"""

CLAIMS = {"order": 1, "symplectic": True, "reversible": True}


def step(system, q, p, h):
    return q, p
