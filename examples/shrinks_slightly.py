"""A faulty leapfrog: each step shrinks the momenta by the share 5e-11 h^3, so it is slightly not symplectic.

`phasebench validate` does not judge the claim that it is symplectic: so small a defect may be round-off.
"""

CLAIMS = {"order": 2, "symplectic": True}
REQUIRES = ("separable",)


def step(system, q, p, h):
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    p = p - h / 2 * system.dH_dq(q, p)
    return q, p * (1 - 5e-11 * h**3)
