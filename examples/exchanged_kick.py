"""A faulty leapfrog: kick, drift, kick, drift, half a step h each, which is symplectic but only of order 1.

`phasebench validate` must find the fault.
"""

CLAIMS = {"order": 2, "symplectic": True}
REQUIRES = ("separable",)


def step(system, q, p, h):
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h / 2 * system.dH_dp(q, p)
    p = p - h / 2 * system.dH_dq(q, p)
    return q + h / 2 * system.dH_dp(q, p), p
