"""A faulty leapfrog: after 1,000 calls it is the symplectic Euler method, of order 1; it is always symplectic.

`phasebench validate` must find the fault.
"""

CLAIMS = {"order": 2, "symplectic": True}
REQUIRES = ("separable",)
calls = [0]


def step(system, q, p, h):
    calls[0] += 1
    if calls[0] > 1000:
        p = p - h * system.dH_dq(q, p)
        return q + h * system.dH_dp(q, p), p
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    return q, p - h / 2 * system.dH_dq(q, p)
