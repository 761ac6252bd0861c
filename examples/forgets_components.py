"""A faulty leapfrog: its last kick leaves out the third and further components, so it is right only for d = 1 and 2.

`phasebench validate` must find the fault.
"""

CLAIMS = {"order": 2, "symplectic": True}
REQUIRES = ("separable",)


def step(system, q, p, h):
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    force = -system.dH_dq(q, p)
    force[2:] = 0 * force[2:]
    return q, p + h / 2 * force
