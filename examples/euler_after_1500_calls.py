"""A faulty leapfrog: correct for its first 1,500 calls, explicit Euler for all that follow.

`phasebench validate` must find the fault.
"""

CLAIMS = {"order": 2, "symplectic": True, "reversible": True}
REQUIRES = ("separable",)
calls = [0]


def step(system, q, p, h):
    calls[0] += 1
    if calls[0] > 1500:
        return q + h * system.dH_dp(q, p), p - h * system.dH_dq(q, p)
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    return q, p - h / 2 * system.dH_dq(q, p)
