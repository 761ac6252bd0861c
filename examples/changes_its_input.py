"""A faulty leapfrog: it works in place, so that the arrays of the caller's state are overwritten.

`phasebench validate` must find the fault.
"""

CLAIMS = {"order": 2, "symplectic": True}
REQUIRES = ("separable",)


def step(system, q, p, h):
    p -= h / 2 * system.dH_dq(q, p)
    q += h * system.dH_dp(q, p)
    p -= h / 2 * system.dH_dq(q, p)
    return q, p
