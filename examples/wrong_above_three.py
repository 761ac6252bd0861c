"""A faulty leapfrog: right for up to three degrees of freedom, explicit Euler for more.

`phasebench validate` must find the fault.
"""

CLAIMS = {"order": 2, "symplectic": True, "energy": "bounded"}
REQUIRES = ("separable",)


def step(system, q, p, h):
    if len(q) > 3:
        return q + h * system.dH_dp(q, p), p - h * system.dH_dq(q, p)
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    return q, p - h / 2 * system.dH_dq(q, p)
